//! What has become of the orientations, for those who look after the service.

use std::collections::HashMap;

use axum::extract::State;
use chrono::{DateTime, NaiveTime, TimeDelta, Utc};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::Query;
use super::problem::Problem;
use super::state::AppState;
use crate::store::now;
use crate::store::statistics::{Span, Step, Tally};

/// The most steps of an answer.
const STEPS_MAX: i64 = 1000;
/// Days of an answer if the query does not say.
const DAYS_DEFAULT: i64 = 7;
/// The most codes that are told of one kind.
const CODES_MAX: usize = 20;

/// The routes of the statistics.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(show))
}

/// How long the steps are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum StepLength {
    /// Hours of UTC.
    Hour,
    /// Days of UTC.
    #[default]
    Day,
}

impl From<StepLength> for Step {
    fn from(length: StepLength) -> Self {
        match length {
            StepLength::Hour => Self::Hour,
            StepLength::Day => Self::Day,
        }
    }
}

/// Which part of time is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct StatisticsQuery {
    /// From this time on (RFC 3339), from 1970; if it is left out, the last seven days of UTC, that of `until` included.
    since: Option<DateTime<Utc>>,
    /// Before this time (RFC 3339), up to the year 9999; if it is left out, until now.
    until: Option<DateTime<Utc>>,
    /// `hour` or `day` (default).
    #[serde(default)]
    #[param(inline)]
    step: StepLength,
}

impl StatisticsQuery {
    fn span(&self, now: DateTime<Utc>) -> Result<Span, Problem> {
        let until = self.until.unwrap_or(now);
        let six_days_before = until.checked_sub_signed(TimeDelta::days(DAYS_DEFAULT - 1)).unwrap_or(until);
        let since = self.since.unwrap_or(six_days_before.date_naive().and_time(NaiveTime::MIN).and_utc());
        if since >= until {
            return Err(Problem::invalid_field("?since", "since must be before until"));
        }
        // the last second of 9999, which is the last that texts of times can have
        if since.timestamp() < 0 || until.timestamp() > 253_402_300_799 {
            return Err(Problem::invalid_field("?since", "since and until must be from 1970 to 9999"));
        }
        let step = Step::from(self.step);
        let steps = last_step(Span { since, until }, step) - step.number(since) + 1;
        if steps > STEPS_MAX {
            let detail = format!("there would be {steps} steps; ask for {STEPS_MAX} at the most");
            return Err(Problem::invalid_field("?step", detail));
        }
        Ok(Span { since, until })
    }
}

fn last_step(span: Span, step: Step) -> i64 {
    step.number(span.until - TimeDelta::microseconds(1))
}

/// What has become of the orientations in a part of time.
#[derive(Debug, Serialize, ToSchema)]
struct StatisticsAnswer {
    /// Its begin.
    since: DateTime<Utc>,
    /// Its end, which does not belong to it.
    until: DateTime<Utc>,
    /// How long the steps are: `hour` or `day`.
    #[schema(value_type = String, example = "day")]
    step: StepLength,
    /// All steps, also empty ones, the earliest first.
    steps: Vec<StepAnswer>,
    /// How many wait at present.
    queued: i64,
    /// How many run at present.
    running: i64,
    /// When the one was asked for that waits for longest, if any does.
    #[serde(skip_serializing_if = "Option::is_none")]
    oldest_queued_at: Option<DateTime<Utc>>,
    /// Yellow ones that nobody has decided about, of all times.
    doubtful: i64,
    /// How long the last attempts have taken of those that have succeeded or failed, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<SecondsAnswer>,
    /// Why orientations have failed, the most frequent code first, at most 20.
    failures: Vec<CodeCount>,
    /// The reasons of the verdicts, the most frequent code first, at most 20.
    reasons: Vec<CodeCount>,
}

/// What has happened in a step.
#[derive(Debug, Default, PartialEq, Serialize, ToSchema)]
struct StepAnswer {
    /// When it begins.
    at: DateTime<Utc>,
    /// Orientations asked for.
    submitted: i64,
    /// Those that have ended with a result.
    succeeded: i64,
    /// Those that have failed.
    failed: i64,
    /// Those that were cancelled.
    cancelled: i64,
    /// Of those that have succeeded, the green ones.
    green: i64,
    /// The yellow ones.
    yellow: i64,
    /// The red ones.
    red: i64,
    /// Of those that have succeeded, the ones that staff have accepted since.
    accepted: i64,
    /// The ones that staff have rejected since.
    rejected: i64,
}

impl StepAnswer {
    fn add(&mut self, tally: &Tally) {
        let Tally { ended, verdict, review, count, .. } = tally;
        let ended = match ended.as_deref() {
            None => &mut self.submitted,
            Some("succeeded") => &mut self.succeeded,
            Some("failed") => &mut self.failed,
            Some(_) => &mut self.cancelled,
        };
        *ended += count;
        match verdict.as_deref() {
            Some("green") => self.green += count,
            Some("yellow") => self.yellow += count,
            Some("red") => self.red += count,
            _ => {}
        }
        match review.as_deref() {
            Some("accepted") => self.accepted += count,
            Some("rejected") => self.rejected += count,
            _ => {}
        }
    }
}

/// How long attempts have taken.
#[derive(Debug, Serialize, ToSchema)]
struct SecondsAnswer {
    /// Half of them at most so long.
    median: f64,
    /// 19 of 20 at most so long.
    p95: f64,
}

/// How often something was told.
#[derive(Debug, PartialEq, Eq, Serialize, ToSchema)]
struct CodeCount {
    /// A stable word for programs.
    #[schema(example = "few_control_points")]
    code: String,
    /// How often.
    count: i64,
}

/// Show statistics
///
/// How many orientations were asked for, have ended and were reviewed, step by step, and how the service stands. An
/// orientation that was removed is not counted any more.
#[utoipa::path(
    get, path = "/statistics", operation_id = "show_statistics", tag = "service", params(StatisticsQuery),
    responses(
        (status = 200, description = "The figures", body = StatisticsAnswer),
        (status = 422, description = "A parameter makes no sense, or there would be too many steps", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn show(
    State(state): State<AppState>,
    Query(query): Query<StatisticsQuery>,
) -> Result<axum::Json<StatisticsAnswer>, Problem> {
    let (span, step) = (query.span(now())?, Step::from(query.step));
    let tallies = state.store.tallies(span, step).await?;
    let present = state.store.present().await?;
    let durations = state.store.durations(span).await?;
    let reasons = state.store.reasons(span).await?;
    Ok(axum::Json(StatisticsAnswer {
        since: span.since,
        until: span.until,
        step: query.step,
        steps: steps(span, step, &tallies),
        queued: present.queued,
        running: present.running,
        oldest_queued_at: present.oldest_queued_at,
        doubtful: present.doubtful,
        seconds: durations.map(|d| SecondsAnswer { median: d.median_s, p95: d.p95_s }),
        failures: failures(&tallies),
        reasons: reasons.into_iter().map(|(code, count)| CodeCount { code, count }).collect(),
    }))
}

fn steps(span: Span, step: Step, tallies: &[Tally]) -> Vec<StepAnswer> {
    let first = step.number(span.since);
    let begin = |number: i64| DateTime::from_timestamp(number * step.seconds(), 0).unwrap_or(span.since);
    let empty = |number| StepAnswer { at: begin(number), ..StepAnswer::default() };
    let mut steps: Vec<StepAnswer> = (first..=last_step(span, step)).map(empty).collect();
    for tally in tallies {
        let place = usize::try_from(tally.number - first).ok();
        if let Some(step) = place.and_then(|place| steps.get_mut(place)) {
            step.add(tally);
        }
    }
    steps
}

fn failures(tallies: &[Tally]) -> Vec<CodeCount> {
    let mut counts: HashMap<&str, i64> = HashMap::new();
    for tally in tallies {
        if let Some(code) = &tally.error_code {
            *counts.entry(code).or_default() += tally.count;
        }
    }
    let mut counts: Vec<CodeCount> =
        counts.into_iter().map(|(code, count)| CodeCount { code: code.to_owned(), count }).collect();
    counts.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.code.cmp(&b.code)));
    counts.truncate(CODES_MAX);
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(since: Option<&str>, until: Option<&str>, step: StepLength) -> StatisticsQuery {
        let time = |text: &str| text.parse().unwrap();
        StatisticsQuery { since: since.map(time), until: until.map(time), step }
    }

    #[test]
    fn the_last_seven_days_are_those_up_to_now() {
        let now = "2024-03-01T15:30:00Z".parse().unwrap();
        let span = query(None, None, StepLength::Day).span(now).unwrap();
        assert_eq!(span, Span { since: "2024-02-24T00:00:00Z".parse().unwrap(), until: now });
        assert_eq!(steps(span, Step::Day, &[]).len(), 7);
        assert_eq!(steps(span, Step::Hour, &[]).len(), 6 * 24 + 16);
    }

    #[test]
    fn every_step_is_there_and_counts_what_lies_in_it() {
        let span = query(Some("2024-02-28T23:30:00Z"), Some("2024-02-29T02:00:00Z"), StepLength::Hour).span(now());
        let span = span.unwrap();
        let tally = |hour: &str, ended: Option<&str>, verdict: Option<&str>, review: Option<&str>, count| Tally {
            number: Step::Hour.number(hour.parse().unwrap()),
            ended: ended.map(str::to_owned),
            verdict: verdict.map(str::to_owned),
            review: review.map(str::to_owned),
            error_code: (ended == Some("failed")).then(|| "timeout".to_owned()),
            count,
        };
        let tallies = [
            tally("2024-02-29T00:10:00Z", None, None, None, 5),
            tally("2024-02-29T00:20:00Z", Some("succeeded"), Some("green"), Some("accepted"), 2),
            tally("2024-02-29T00:20:00Z", Some("succeeded"), Some("red"), None, 1),
            tally("2024-02-29T01:00:00Z", Some("failed"), None, None, 3),
            tally("2024-02-29T01:00:00Z", Some("cancelled"), None, None, 4),
        ];
        let steps = steps(span, Step::Hour, &tallies);
        let at = |text: &str| text.parse().unwrap();
        let expected = [
            StepAnswer { at: at("2024-02-28T23:00:00Z"), ..StepAnswer::default() },
            StepAnswer {
                at: at("2024-02-29T00:00:00Z"),
                submitted: 5,
                succeeded: 3,
                green: 2,
                red: 1,
                accepted: 2,
                ..StepAnswer::default()
            },
            StepAnswer { at: at("2024-02-29T01:00:00Z"), failed: 3, cancelled: 4, ..StepAnswer::default() },
        ];
        assert_eq!(steps, expected);
        assert_eq!(failures(&tallies), [CodeCount { code: "timeout".into(), count: 3 }]);
    }

    #[test]
    fn spans_that_make_no_sense_are_refused() {
        let refused = |since, until, step| query(Some(since), Some(until), step).span(now()).is_err();
        assert!(refused("2024-01-02T00:00:00Z", "2024-01-02T00:00:00Z", StepLength::Day));
        assert!(refused("2024-01-02T00:00:00Z", "2024-01-01T00:00:00Z", StepLength::Day));
        assert!(refused("1969-12-31T23:59:59Z", "1970-01-02T00:00:00Z", StepLength::Day));
        assert!(refused("9999-12-31T00:00:00Z", "+10000-01-01T00:00:00Z", StepLength::Day));
        // 1000 days are allowed, and no more
        assert!(!refused("2021-01-01T00:00:00Z", "2023-09-28T00:00:00Z", StepLength::Day));
        assert!(refused("2021-01-01T00:00:00Z", "2023-09-28T00:00:00.000001Z", StepLength::Day));
    }
}
