//! Lists of control points.

use axum::extract::State;
use chrono::NaiveDate;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::health::{self, HealthInShort};
use crate::control::geojson::{self, ControlPointFeature, ControlPointProperties, MultiLineString};
use crate::control::points::{self, Filter, Kept};
use crate::control::{Source, sets};
use crate::http::area::{AreaQuery, DEFAULT_CRS, Rectangle, cursor, known_crs};
use crate::http::extract::{Query, searched};
use crate::http::page::{Page, Wanted};
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Which control points are wanted, in which CRS, and what is to be told of them.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// Only those that touch this rectangle: `min_x,min_y,max_x,max_y` in `crs`.
    #[param(example = "16.63,52.77,16.64,52.78")]
    bbox: Option<String>,
    /// Only those with this in their name, in small or capital letters.
    #[param(max_length = 200)]
    q: Option<String>,
    /// Only those of these sets, by their names with commas between; default: of all.
    #[param(example = "default")]
    sets: Option<String>,
    /// Only those that stand like this on that day; default: whenever they stand.
    #[param(example = "2024-05-17")]
    date: Option<NaiveDate>,
    /// Whether to tell how each does in accepted images.
    #[serde(default)]
    health: bool,
    /// The CRS of `bbox` and of the answer; default: EPSG:4979. What it does not reach is left out.
    #[param(example = "EPSG:4979", min_length = 1)]
    crs: Option<String>,
    /// Gives heights above the geoid: ellipsoidal height - this.
    geoid_undulation_m: Option<f64>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(min_length = 1)]
    cursor: Option<String>,
}

/// A control point of a list: a GeoJSON feature, its positions in the CRS asked for.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ListedControlPoint {
    /// Always `Feature`.
    #[schema(example = "Feature")]
    r#type: &'static str,
    /// Its edges.
    geometry: MultiLineString,
    /// Its name, accuracy and reference point, and how it does, if that was asked for.
    properties: ListedProperties,
}

/// What a control point is called, how good it is, where its reference point lies, and how it does.
#[derive(Debug, Serialize, ToSchema)]
struct ListedProperties {
    #[serde(flatten)]
    properties: ControlPointProperties,
    /// How it does in accepted images, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    health: Option<HealthInShort>,
}

impl From<ControlPointFeature> for ListedControlPoint {
    fn from(feature: ControlPointFeature) -> Self {
        let ControlPointFeature { r#type, geometry, properties } = feature;
        Self { r#type, geometry, properties: ListedProperties { properties, health: None } }
    }
}

/// List control points
///
/// Each item is a GeoJSON feature, as it is imported. Without `bbox`, all of them.
#[utoipa::path(
    get, path = "/control-points", operation_id = "list_control_points", tag = "control points", params(ListQuery),
    responses(
        (status = 200, description = "One page", body = Page<ListedControlPoint>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn list(
    State(state): State<AppState>,
    Query(query): Query<ListQuery>,
) -> Result<axum::Json<Page<ListedControlPoint>>, Problem> {
    let with_health = query.health;
    let Page { items, next_cursor } = page(&state, query).await?;
    let mut items: Vec<ListedControlPoint> = items.into_iter().map(ListedControlPoint::from).collect();
    if with_health {
        let names: Vec<&str> = items.iter().map(|item| item.properties.properties.name.as_str()).collect();
        let mut health = health::of_all(&state, &names).await?;
        for item in &mut items {
            item.properties.health = health.remove(&item.properties.properties.name);
        }
    }
    Ok(axum::Json(Page { items, next_cursor }))
}

async fn page(state: &AppState, query: ListQuery) -> Result<Page<ControlPointFeature>, Problem> {
    let ListQuery { bbox, q, sets: of_sets, date, crs, geoid_undulation_m, limit, cursor: begin, .. } = query;
    let area = AreaQuery { bbox, crs, geoid_undulation_m, limit, cursor: begin };
    let crs = area.crs()?;
    let limit = Wanted::new(area.limit, None)?.limit as usize;
    let rectangle = area.bbox.as_deref().map(Rectangle::parse).transpose()?;
    let region = rectangle.as_ref().map(|rectangle| rectangle.region(&crs)).transpose()?;
    let filter = Filter {
        sets: of_sets.filter(|names| !names.is_empty()).map(|names| names.split(',').map(str::to_owned).collect()),
        date,
        name: searched("q", q.as_deref())?.map(str::to_owned),
    };
    let sets = sets::all(state.store.database()).await?;
    let name_of = |id: i64| sets.iter().find(|set| set.id == id).map_or("", |set| set.name.as_str());
    let mut after = cursor(area.cursor.as_deref())?;
    let target = Source { crs: &crs, geoid_undulation_m };
    let mut items = Vec::new();
    loop {
        // one more than fits, to know whether there is a next page
        let found = points::listed(state.store.database(), region, &filter, after, limit + 1).await?;
        let last = found.len() <= limit;
        for Kept { id, set_id, point } in found {
            if items.len() == limit {
                return Ok(Page { items, next_cursor: Some(after.to_string()) });
            }
            after = id;
            let feature = geojson::feature(&point, name_of(set_id), &target);
            items
                .extend(feature.filter(|f| rectangle.as_ref().is_none_or(|rectangle| rectangle.touches(positions(f)))));
        }
        if last {
            return Ok(Page { items, next_cursor: None });
        }
    }
}

fn positions(feature: &ControlPointFeature) -> impl Iterator<Item = [f64; 3]> {
    feature.geometry.coordinates.iter().flatten().copied().chain([feature.properties.reference])
}

/// In which CRS the extent is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ExtentQuery {
    /// The CRS of the answer; default: EPSG:4979.
    #[param(example = "EPSG:4979", min_length = 1)]
    crs: Option<String>,
}

/// Where all control points lie.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ExtentAnswer {
    /// How many there are.
    count: u64,
    /// A rectangle around them, `[min_x, min_y, max_x, max_y]`, rather too large than too small; left out if there are
    /// none. Longitudes may leave -180 to 180 by a building at the antimeridian.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    bbox: Option<[f64; 4]>,
}

/// Show where all control points lie
#[utoipa::path(
    get, path = "/control-points/extent", operation_id = "show_control_points_extent", tag = "control points",
    params(ExtentQuery),
    responses(
        (status = 200, description = "How many there are, and a rectangle around them", body = ExtentAnswer),
        (status = 422, description = "The CRS is unknown, or does not reach them", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn extent(
    State(state): State<AppState>,
    Query(query): Query<ExtentQuery>,
) -> Result<axum::Json<ExtentAnswer>, Problem> {
    let crs = known_crs(query.crs.as_deref().unwrap_or(DEFAULT_CRS), None)?;
    let (count, region) = points::extent(state.store.database()).await?;
    let rectangle = region.map(|region| Rectangle::around(region, &crs)).transpose()?;
    Ok(axum::Json(ExtentAnswer { count, bbox: rectangle.map(|rectangle| rectangle.bounds()) }))
}
