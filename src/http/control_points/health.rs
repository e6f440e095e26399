//! How a control point does in accepted images: is it out of date?

use std::collections::HashMap;

use axum::extract::State;
use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;

use super::SetQuery;
use crate::control::points;
use crate::control::sets::DEFAULT_SET;
use crate::http::extract::{Path, Query};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::sightings::SightingCounts;

/// Where nothing is known of control points in general, so many of those in view are found.
const USUALLY_FOUND: f64 = 0.6;
/// In fewer images than this nothing is out of date.
const LEAST_FAILURES: u32 = 3;
/// A sound control point fails as often as one that is reported in this share of all cases.
const SIGNIFICANCE: f64 = 0.01;

/// What accepted images say of a control point. Of several orientations of one image the last one counts.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub(super) struct HealthAnswer {
    /// Its name.
    name: String,
    /// Accepted images that should show it.
    seen_in: u32,
    /// Images in which it was found where it should be.
    found: u32,
    /// Images in which nothing was found of it.
    missed: u32,
    /// Images in which it was found, but not where all other control points expect it.
    contradicts: u32,
    /// The share of control points that are usually found in accepted images of this service.
    usually_found_share: f64,
    /// The probability that a sound control point fails at least as often.
    probability_if_sound: f64,
    /// Whether it is probably out of date: it fails in at least three images, and more often than chance explains.
    outdated: bool,
    /// A sentence for staff.
    detail: String,
    /// When it was last found.
    last_found_at: Option<DateTime<Utc>>,
    /// When it last failed.
    last_failed_at: Option<DateTime<Utc>>,
}

/// Show the health of a control point
///
/// How often accepted images have shown it where it should be. A control point that fails in several of them is out of
/// date, or was measured wrongly. Control points of the same name in several sets are the same building: they have their
/// health in common.
#[utoipa::path(
    get, path = "/control-points/{name}/health", operation_id = "show_control_point_health", tag = "control points",
    params(("name" = String, Path, description = "Its name"), SetQuery),
    responses(
        (status = 200, description = "Its health", body = HealthAnswer),
        (status = 404, description = "There is no such control point", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn health(
    State(state): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<SetQuery>,
) -> Result<axum::Json<HealthAnswer>, Problem> {
    let set = query.set.as_deref().unwrap_or(DEFAULT_SET);
    if points::by_name(state.store.database(), set, &name).await?.is_none() {
        return Err(Problem::not_found("There is no control point of this name in this set."));
    }
    let counts = state.store.sightings(&name).await?;
    let usually_found = state.store.found_share().await?.unwrap_or(USUALLY_FOUND);
    Ok(axum::Json(judged(name, &counts, usually_found)))
}

/// How a control point does, in short.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(super) struct HealthInShort {
    /// Accepted images that should show it.
    seen_in: u32,
    /// Images in which it was found where it should be.
    found: u32,
    /// Images in which nothing was found of it.
    missed: u32,
    /// Images in which it was found, but not where all other control points expect it.
    contradicts: u32,
    /// Whether it is probably out of date.
    outdated: bool,
    /// When it was last found.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_found_at: Option<DateTime<Utc>>,
    /// When it last failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_failed_at: Option<DateTime<Utc>>,
}

/// How each of these control points does, by name.
pub(super) async fn of_all(state: &AppState, names: &[&str]) -> Result<HashMap<String, HealthInShort>, Problem> {
    let mut counts = state.store.sightings_of(names).await?;
    let usually_found = state.store.found_share().await?.unwrap_or(USUALLY_FOUND);
    let health = |name: &&str| {
        let judged = judged((*name).to_owned(), &counts.remove(*name).unwrap_or_default(), usually_found);
        let HealthAnswer { name, seen_in, found, missed, contradicts, outdated, last_found_at, last_failed_at, .. } =
            judged;
        (name, HealthInShort { seen_in, found, missed, contradicts, outdated, last_found_at, last_failed_at })
    };
    Ok(names.iter().map(health).collect())
}

fn judged(name: String, counts: &SightingCounts, usually_found: f64) -> HealthAnswer {
    let SightingCounts { found, missed, contradicts, last_found_at, last_failed_at } = *counts;
    let (seen_in, failures) = (found + missed + contradicts, missed + contradicts);
    // if nothing was ever found, or everything, nothing could be told
    let usually_found = usually_found.clamp(0.05, 0.95);
    let probability_if_sound = at_most(found, seen_in, usually_found);
    let outdated = failures >= LEAST_FAILURES && probability_if_sound < SIGNIFICANCE;
    let detail = if seen_in == 0 {
        "no accepted image has shown this place yet".to_owned()
    } else if outdated {
        format!(
            "it was found where it should be in {found} of {seen_in} accepted images only: probably out of date or \
             measured wrongly; measure it anew, or remove it"
        )
    } else {
        format!(
            "it was found where it should be in {found} of {seen_in} accepted images, as control points usually are"
        )
    };
    HealthAnswer {
        name,
        seen_in,
        found,
        missed,
        contradicts,
        usually_found_share: usually_found,
        probability_if_sound,
        outdated,
        detail,
        last_found_at,
        last_failed_at,
    }
}

/// Probability of at most `most` successes in `trials` of probability `p` each.
fn at_most(most: u32, trials: u32, p: f64) -> f64 {
    let mut term = (1.0 - p).powf(f64::from(trials));
    let mut sum = term;
    for k in 0..most.min(trials) {
        term *= f64::from(trials - k) / f64::from(k + 1) * p / (1.0 - p);
        sum += term;
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(found: u32, missed: u32, contradicts: u32) -> SightingCounts {
        SightingCounts { found, missed, contradicts, last_found_at: None, last_failed_at: None }
    }

    #[test]
    fn what_fails_more_often_than_chance_explains_is_outdated() {
        let outdated =
            |found, missed, contradicts| judged("a".into(), &counts(found, missed, contradicts), 0.7).outdated;
        // 0.3^3 is 2.7 %, 0.3^4 is 0.8 %
        assert!(!outdated(0, 3, 0));
        assert!(outdated(0, 4, 0));
        assert!(outdated(1, 4, 3));
        assert!(!outdated(7, 3, 0));
        assert!(!outdated(0, 0, 0));
        assert!(judged("a".into(), &counts(0, 0, 0), 0.7).detail.starts_with("no accepted image"));
    }

    #[test]
    fn the_probability_is_that_of_the_binomial_distribution() {
        assert!((at_most(0, 4, 0.7) - 0.0081).abs() < 1e-12);
        assert!((at_most(2, 5, 0.5) - 0.5).abs() < 1e-12);
        assert!((at_most(9, 9, 0.3) - 1.0).abs() < 1e-12);
        assert_eq!(at_most(0, 0, 0.3), 1.0);
    }
}
