//! Control points.

mod health;
mod list;

use std::sync::Arc;

use axum::body::{Body, to_bytes};
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::StatusCode;
use bytes::Bytes;
use chrono::NaiveDate;
use futures_util::StreamExt as _;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::area::{DEFAULT_CRS, known_crs};
use super::extract::{Path, Query, body_problem, media_type, refuse_encoded};
use super::images::{content_length, refuse_if_no_room};
use super::problem::Problem;
use super::state::AppState;
use crate::buildings::{self, ModelError};
use crate::control::geojson::{self, ControlPointFeature, Defaults};
use crate::control::points::{self, Import, ImportError};
use crate::control::sets::{DEFAULT_SET, NewSet};
use crate::control::{
    CollectionError, ControlError, FileFormat, GeoPackageError, ImportReport, Mode, ReadError, Reading, Source, Use,
    Validity,
};
use crate::report::Warning;
use crate::store::images::Received;

/// The routes of the control points.
pub fn routes() -> OpenApiRouter<AppState> {
    // the import has a limit of its own
    let import = OpenApiRouter::new().routes(routes!(import)).layer(DefaultBodyLimit::disable());
    OpenApiRouter::new()
        .routes(routes!(list::list))
        .routes(routes!(list::extent))
        .routes(routes!(read, remove))
        .routes(routes!(health::health))
        .merge(import)
}

/// A GeoJSON `FeatureCollection` of control points; what else it has is ignored.
#[derive(ToSchema)]
#[schema(as = ControlPointCollection)]
#[expect(dead_code, reason = "only describes the body, which is read a feature at a time")]
struct Collection {
    /// Always `FeatureCollection`.
    #[schema(example = "FeatureCollection", pattern = "^FeatureCollection$")]
    r#type: String,
    /// Each as it is listed: a `MultiLineString`, and the properties `name`, `sigma_m` and, if need be, `reference`. Those
    /// that are none are told in the answer.
    #[schema(value_type = Vec<serde_json::Value>)]
    features: Vec<ControlPointFeature>,
}

/// Where an import comes from, and where it goes.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ImportQuery {
    /// The CRS of the coordinates: `EPSG:<code>` or a PROJ string. A building model or a GeoPackage may say so itself;
    /// then it may be left out, and must not contradict.
    #[param(example = "EPSG:25832", min_length = 1)]
    crs: Option<String>,
    /// What makes the heights ellipsoidal: height above the geoid + this = ellipsoidal height.
    geoid_undulation_m: Option<f64>,
    /// What becomes of control points whose name is known in the set: `insert` rejects them, `upsert` (default) updates
    /// them, `replace` updates them and removes all others of the set.
    #[serde(default)]
    #[param(inline)]
    mode: Mode,
    /// The set that they belong to, which is made if there is none; default: `default`.
    #[param(example = "default", min_length = 1, max_length = 100)]
    set: Option<String>,
    /// The year of the survey of that set.
    #[param(minimum = 1800, maximum = 2200)]
    year: Option<i64>,
    /// What is in that set.
    #[param(max_length = 1000)]
    description: Option<String>,
    /// What they are there for, where a feature does not say: `check` is never used, and reported with every orientation.
    #[serde(default, rename = "use")]
    #[param(inline)]
    purpose: Use,
    /// The first day on which the buildings stand like this, where a feature does not say.
    valid_from: Option<NaiveDate>,
    /// The last day on which they do.
    valid_to: Option<NaiveDate>,
    /// Standard deviation of the coordinates in metres, where a feature does not say; of building models 0.15 if left out.
    #[param(exclusive_minimum = 0.0, maximum = 100.0)]
    sigma_m: Option<f64>,
}

impl ImportQuery {
    fn plan(&self) -> Result<Import, Problem> {
        let Self { set, year, description, mode, .. } = self;
        let name = set.clone().unwrap_or(NewSet::default().name);
        let set = NewSet { name, survey_year: *year, description: description.clone() };
        set.check().map_err(|detail| Problem::invalid_field("?set", detail))?;
        Ok(Import { set, mode: *mode, ..Import::default() })
    }

    fn reading(&self, format: FileFormat) -> Result<Reading, Problem> {
        let crs = self.crs.as_deref().map(|crs| known_crs(crs, self.geoid_undulation_m)).transpose()?;
        let validity = Validity { from: self.valid_from, to: self.valid_to };
        let defaults = Defaults { sigma_m: self.sigma_m, purpose: self.purpose, validity };
        defaults.check().map_err(|detail| Problem::invalid_field("?sigma_m", detail))?;
        let heights_assumed = Arc::default();
        Ok(Reading { format, crs, geoid_undulation_m: self.geoid_undulation_m, defaults, heights_assumed })
    }
}

/// A building model: CityJSON 1.0, 1.1 or 2.0, CityJSONSeq, or CityGML 1.0, 2.0 or 3.0.
#[derive(ToSchema)]
#[schema(as = BuildingModel, value_type = String, format = Binary)]
#[expect(dead_code, reason = "only describes the body, which is read a building at a time")]
struct Model(Vec<u8>);

/// A GeoPackage with tables of `LINESTRING`, `MULTILINESTRING`, `POLYGON` or `MULTIPOLYGON` with Z.
#[derive(ToSchema)]
#[schema(as = GeoPackage, value_type = String, format = Binary)]
#[expect(dead_code, reason = "only describes the body, which is read a row at a time")]
struct Package(Vec<u8>);

/// What an import did.
#[derive(Debug, Serialize, ToSchema)]
struct ImportAnswer {
    #[serde(flatten)]
    report: ImportReport,
    /// What the client should know besides.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<Warning>,
}

/// Import control points
///
/// A GeoJSON `FeatureCollection`; each feature is one control point: a `MultiLineString` of segments (lines of two 3D
/// positions), with the properties `name` (unique in its set), `sigma_m` (standard deviation of its coordinates) and, if
/// wanted, `reference` (`[x, y, z]`; default: the mean of the segments' midpoints), `use`, `valid_from`, `valid_to`, and
/// for each line `edge_kinds` and `edge_sigma_m`. Or a building model, of which each building is one control point, its
/// roof edges as good as their kind allows. Or a GeoPackage with the columns `name`, `cp_id` or `building_id` (rows with the
/// same one are one building), `sigma_m` (or `sigma_xy` and `sigma_z`), `edge_type`, `use`, `valid_from` and `valid_to`: its
/// lines are edges, and of its surfaces the edges are found as in a building model. One bad feature never loses the others. Of a large file what is good before a
/// fault in the file itself stays.
#[utoipa::path(
    post, path = "/control-points", operation_id = "import_control_points", tag = "control points", params(ImportQuery),
    request_body(content(
        (Collection = "application/geo+json"), (Collection = "application/json"),
        (Model = "application/city+json"), (Model = "application/city+json-seq"), (Model = "application/gml+xml"),
        (Package = "application/geopackage+sqlite3"),
    )),
    responses(
        (status = 200, description = "What was imported, updated and rejected", body = ImportAnswer),
        (status = 400, description = "Not JSON, or not XML", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Larger than this service accepts", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Not a FeatureCollection, a building model or a GeoPackage, or an unknown CRS", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn import(
    State(state): State<AppState>,
    Query(query): Query<ImportQuery>,
    request: Request,
) -> Result<axum::Json<ImportAnswer>, Problem> {
    let (format, max_bytes) = format_of(&state, media_type(request.headers()).as_deref())?;
    let (plan, reading) = (query.plan()?, query.reading(format)?);
    if format == FileFormat::GeoJson && reading.crs.is_none() {
        return Err(Problem::invalid_field("?crs", "GeoJSON does not say in which CRS it is; give crs"));
    }
    refuse_encoded(request.headers())?;
    let received = received(&state, request, max_bytes).await?;
    // each keeps the writers of others waiting
    let _permit = state.imports.acquire().await.map_err(|error| Problem::internal(&error))?;
    let heights_assumed = reading.heights_assumed.clone();
    let read = points::import(
        state.store.database(),
        &plan,
        reading,
        move |reading, each| {
            if reading.format == FileFormat::GeoPackage {
                return reading.read_geopackage(received.path(), &mut |_| {}, each);
            }
            let file = std::fs::File::open(received.path()).map_err(ModelError::Input)?;
            reading.read(&mut std::io::BufReader::with_capacity(1 << 20, file), each)
        },
        |_| {},
    );
    let report = read.await?;
    let ImportReport { imported, updated, rejected_count, .. } = &report;
    tracing::info!(imported, updated, rejected = rejected_count, set = plan.set.name, "imported");
    let warnings = Vec::from_iter(heights_assumed.get().map(|crs| Warning::vertical_assumed_ellipsoidal(crs)));
    Ok(axum::Json(ImportAnswer { report, warnings }))
}

/// The format of a body by its type, and how large it may be.
fn format_of(state: &AppState, kind: Option<&str>) -> Result<(FileFormat, u64), Problem> {
    let model = |format| Ok((FileFormat::Model(format), state.configuration.model_max_bytes));
    match kind {
        Some("application/geo+json" | "application/json") => {
            Ok((FileFormat::GeoJson, state.configuration.import_max_bytes as u64))
        }
        Some("application/city+json") => model(buildings::Format::CityJson),
        Some("application/city+json-seq") => model(buildings::Format::CityJsonSeq),
        Some("application/gml+xml") => model(buildings::Format::CityGml),
        Some("application/geopackage+sqlite3") => Ok((FileFormat::GeoPackage, state.configuration.model_max_bytes)),
        given => Err(Problem::unsupported_type(format!(
            "Content-Type is {}; it must be application/geo+json, application/city+json, application/city+json-seq, \
             application/gml+xml or application/geopackage+sqlite3",
            given.unwrap_or("none")
        ))),
    }
}

/// The body, streamed to a file that goes when it was read.
async fn received(state: &AppState, request: Request, max_bytes: u64) -> Result<Received, Problem> {
    let declared = content_length(request.headers()).unwrap_or(0);
    if declared > max_bytes {
        return Err(too_large(max_bytes));
    }
    refuse_if_no_room(state, declared)?;
    let mut upload = state.store.begin_upload()?;
    let mut chunks = request.into_body().into_data_stream();
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(|error| body_problem(&error, StatusCode::BAD_REQUEST))?;
        if upload.size_bytes() + chunk.len() as u64 > max_bytes {
            return Err(too_large(max_bytes));
        }
        upload.write(&chunk).await?;
    }
    Ok(upload.complete().await?)
}

fn too_large(max_bytes: u64) -> Problem {
    Problem::too_large(format!("The body is larger than the {max_bytes} bytes that this service accepts."))
}

pub(super) async fn whole_body(body: Body, max_bytes: usize) -> Result<Bytes, Problem> {
    to_bytes(body, max_bytes).await.map_err(|error| {
        let source = std::error::Error::source(&error);
        if source.is_some_and(|source| source.is::<http_body_util::LengthLimitError>()) {
            return too_large(max_bytes as u64);
        }
        body_problem(&error, StatusCode::BAD_REQUEST)
    })
}

/// Which set a control point is of.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct SetQuery {
    /// The set that it belongs to; default: `default`.
    #[param(example = "default", min_length = 1, max_length = 100)]
    set: Option<String>,
}

/// Which set a control point is of, and in which CRS it is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ReadQuery {
    /// The set that it belongs to; default: `default`.
    #[param(example = "default", min_length = 1, max_length = 100)]
    set: Option<String>,
    /// The CRS of the answer; default: EPSG:4979.
    #[param(min_length = 1)]
    crs: Option<String>,
    /// Gives heights above the geoid: ellipsoidal height - this.
    geoid_undulation_m: Option<f64>,
}

/// Show a control point
#[utoipa::path(
    get, path = "/control-points/{name}", operation_id = "show_control_point", tag = "control points",
    params(("name" = String, Path, description = "Its name"), ReadQuery),
    responses(
        (status = 200, description = "The control point as a GeoJSON feature", body = ControlPointFeature),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<ReadQuery>,
) -> Result<axum::Json<ControlPointFeature>, Problem> {
    let crs = known_crs(query.crs.as_deref().unwrap_or(DEFAULT_CRS), query.geoid_undulation_m)?;
    let set = query.set.as_deref().unwrap_or(DEFAULT_SET);
    let kept = points::by_name(state.store.database(), set, &name).await?;
    let kept = kept.ok_or_else(|| Problem::not_found("There is no control point of this name in this set."))?;
    let feature =
        geojson::feature(&kept.point, set, &Source { crs: &crs, geoid_undulation_m: query.geoid_undulation_m });
    let feature =
        feature.ok_or_else(|| Problem::invalid_field("?crs", format!("the control point does not lie in {crs}")));
    Ok(axum::Json(feature?))
}

/// Remove a control point
///
/// Orientations under way may still use it; results keep it.
#[utoipa::path(
    delete, path = "/control-points/{name}", operation_id = "remove_control_point", tag = "control points",
    params(("name" = String, Path, description = "Its name"), SetQuery),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(
    State(state): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<SetQuery>,
) -> Result<StatusCode, Problem> {
    let set = query.set.as_deref().unwrap_or(DEFAULT_SET);
    if points::remove(state.store.database(), set, &name).await? {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::not_found("There is no control point of this name in this set."))
}

impl From<ControlError> for Problem {
    fn from(error: ControlError) -> Self {
        match error {
            ControlError::Database(error) => error.into(),
            ControlError::SetRemoved => Self::conflict(error.to_string()),
            error => Self::internal(&error),
        }
    }
}

impl From<CollectionError> for Problem {
    fn from(error: CollectionError) -> Self {
        match error {
            CollectionError::Syntax(error) => Self::bad_request(format!("The body is not valid JSON: {error}")),
            error => Self::invalid_field("", error.to_string()),
        }
    }
}

impl From<ReadError> for Problem {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Collection(error) => error.into(),
            ReadError::Model(ModelError::Input(error)) | ReadError::GeoPackage(GeoPackageError::Input(error)) => {
                Self::internal(&error)
            }
            ReadError::Model(
                error @ (ModelError::Xml { .. } | ModelError::Json { .. } | ModelError::NotUtf8 { .. }),
            ) => Self::bad_request(error.to_string()),
            ReadError::GeoPackage(error @ GeoPackageError::OtherCrs { .. }) => {
                Self::invalid_field("?crs", error.to_string())
            }
            ReadError::GeoPackage(error) => Self::invalid_field("", error.to_string()),
            ReadError::Model(error) => Self::invalid_field("", error.to_string()),
            error => Self::invalid_field("?crs", error.to_string()),
        }
    }
}

impl From<ImportError> for Problem {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Control(error) => error.into(),
            ImportError::Read(error) => error.into(),
            error => Self::internal(&error),
        }
    }
}
