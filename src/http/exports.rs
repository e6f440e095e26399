//! Exports: an orientation, or all of a block, as the files that other software reads.

use std::collections::HashMap;
use std::io::Write as _;

use axum::extract::State;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::area::known_crs;
use super::extract::{Path, Query};
use super::openapi::Binary;
use super::problem::Problem;
use super::state::AppState;
use crate::exports::{self, ExportError, File, Format, Photograph};
use crate::geometry::CrsError;
use crate::jobs::camera_model::camera_model;
use crate::jobs::exports::{ExportWanted, Exportable, ExportableError};
use crate::jobs::request::CameraModel;
use crate::store::exported::ExportedRow;
use crate::store::orientations::Status;

/// More photographs are exported in several requests, or block by block.
const MOST_PHOTOGRAPHS: u32 = 5_000;

/// What is lost of a photograph in a single file.
const RESIDUAL_HEADER: HeaderName = HeaderName::from_static("gable-residual-max-px");

/// The routes of the exports.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(of_orientation)).routes(routes!(of_block))
}

/// How an export is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ExportQuery {
    /// `manifest`, `opk_csv`, `patb`, `inpho`, `bingo`, `applanix`, `orthority`, `opensfm`, `odm`, `pix4d`, `colmap`,
    /// `micmac`, `esri`, `rpc` or `footprints`.
    #[param(example = "orthority", pattern = "^[a-z0-9_]+$")]
    format: String,
    /// The CRS of formats in a map grid: a grid, or a topocentric frame. Default: that of the result, or where that has
    /// degrees the UTM zone with the same heights.
    #[param(example = "EPSG:25832", min_length = 1)]
    crs: Option<String>,
    /// Gives heights above the geoid in a map grid: ellipsoidal height - this. Default: that of the result, if `crs` is
    /// left out too.
    geoid_undulation_m: Option<f64>,
    /// Mean height of the ground above the ellipsoid, to which orientations in a map grid are fitted. Default: that of the
    /// control that was used.
    #[param(minimum = -1000, maximum = 10000)]
    ground_height_m: Option<f64>,
    /// How far the ground reaches above and below that. Default: 5 % of the flying height.
    #[param(minimum = 0, maximum = 5000)]
    relief_m: Option<f64>,
    /// Side of a pixel of a digital camera, for formats in millimetres. Default: 4.
    #[param(minimum = 0.1, maximum = 1000)]
    pixel_size_um: Option<f64>,
    /// A ZIP archive with the manifest beside the files, also where the format is a single file. Formats of several files
    /// always come so.
    #[serde(default)]
    archive: bool,
    /// Of a block: also what is neither green nor accepted by staff, as long as there is an orientation that nobody has
    /// rejected. Of one orientation: also if it is red or staff have rejected it.
    #[serde(default)]
    all: bool,
}

impl ExportQuery {
    fn format(&self) -> Result<Format, Problem> {
        Format::from_name(&self.format).ok_or_else(|| {
            let names = Format::ALL.map(Format::name).join(", ");
            Problem::invalid_field("?format", format!("format is {:?}; it must be one of {names}", self.format))
        })
    }

    fn wanted(&self) -> Result<ExportWanted, Problem> {
        let within = |name: &str, value: Option<f64>, least: f64, most: f64| match value {
            Some(value) if !(least..=most).contains(&value) => {
                let detail = format!("{name} is {value}; it must be from {least} to {most}");
                Err(Problem::invalid_field(format!("?{name}"), detail))
            }
            value => Ok(value),
        };
        Ok(ExportWanted {
            crs: self.crs.as_deref().map(|given| known_crs(given, self.geoid_undulation_m)).transpose()?,
            geoid_undulation_m: within("geoid_undulation_m", self.geoid_undulation_m, -150.0, 150.0)?,
            ground_height_m: within("ground_height_m", self.ground_height_m, -1000.0, 10_000.0)?,
            relief_m: within("relief_m", self.relief_m, 0.0, 5000.0)?,
            pixel_size_um: within("pixel_size_um", self.pixel_size_um, 0.1, 1000.0)?,
            all: self.all,
        })
    }
}

/// Export an orientation
///
/// As the files that other software reads; where staff have accepted a correction, that. Software that takes a map grid for
/// a Cartesian frame gets the orientation fitted to the ground in the grid, unless more than 5 px would be lost; the manifest
/// states what remains of the fit, the verdict, what staff have decided, and five check points with their pixels by which
/// every import can be verified. A format of one file is that file, one of several a ZIP archive with the manifest.
#[utoipa::path(
    get, path = "/orientations/{id}/export", operation_id = "export_orientation", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id"), ExportQuery),
    responses(
        (status = 200, description = "The file, or an archive of files", headers(("Gable-Residual-Max-Px" = f64, description = "Of a single file to which an orientation was fitted: what remains of the fit at its worst point, in pixels; of an archive the manifest says it")), content((inline(Binary) = "application/zip"), (String = "text/plain"), (String = "text/csv"), (serde_json::Value = "application/json"), (serde_json::Value = "application/geo+json"))),
        (status = 404, description = "There is no such orientation, or nothing was found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet; or it is red or staff have rejected it, and `all` was not given", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "It cannot be exported so", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn of_orientation(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<ExportQuery>,
) -> Result<Response, Problem> {
    let row = state.store.exported(id).await?;
    let row = row.ok_or_else(|| Problem::not_found("There is no orientation with this id."))?;
    let status = row.status.as_deref().and_then(Status::from_name);
    if !status.is_some_and(Status::is_final) {
        return Err(Problem::conflict("It has not ended yet.").with_retry_after(1));
    }
    export(&state, &[row], &query, false, &format!("orientation-{id}")).await
}

/// Export a block
///
/// All orientations of a block that are green or accepted by staff, as for one orientation; `left_out.csv` in the archive
/// names the others and says why.
#[utoipa::path(
    get, path = "/blocks/{id}/export", operation_id = "export_block", tag = "blocks",
    params(("id" = Uuid, Path, description = "The block's id"), ExportQuery),
    responses(
        (status = 200, description = "An archive of files", content((inline(Binary) = "application/zip"))),
        (status = 404, description = "There is no such block", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "There is nothing to export yet", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "It cannot be exported so", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn of_block(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<ExportQuery>,
) -> Result<Response, Problem> {
    super::blocks::found(&state, id).await?;
    let rows = state.store.exported_of_block(id, MOST_PHOTOGRAPHS + 1).await?;
    if rows.len() > MOST_PHOTOGRAPHS as usize {
        return Err(Problem::invalid(format!(
            "The block has more than {MOST_PHOTOGRAPHS} images; export them one by one."
        )));
    }
    export(&state, &rows, &query, true, &format!("block-{id}")).await
}

/// Why an image of a block is not exported.
fn left_out(row: &ExportedRow, all: bool) -> Option<&'static str> {
    match (row.status.as_deref(), row.review.as_deref(), row.verdict.as_deref()) {
        (None, ..) => Some("there is no orientation"),
        (Some("queued" | "running"), ..) => Some("it has not ended yet"),
        (Some("failed" | "cancelled"), ..) => Some("it has failed or was cancelled"),
        (_, Some("rejected"), _) => Some("staff have rejected it"),
        (_, Some("accepted"), _) | (_, _, Some("green")) => None,
        _ if all => None,
        _ => Some("it is neither green nor accepted by staff"),
    }
}

async fn export(
    state: &AppState,
    rows: &[ExportedRow],
    query: &ExportQuery,
    is_block: bool,
    title: &str,
) -> Result<Response, Problem> {
    let (format, wanted) = (query.format()?, query.wanted()?);
    let mut cameras: HashMap<Uuid, (String, CameraModel)> = HashMap::new();
    let (mut chosen, mut others) = (Vec::new(), Vec::new());
    for row in rows {
        if let Some(why) = left_out(row, query.all).filter(|_| is_block) {
            others.push((name_of(row), why.to_owned()));
            continue;
        }
        let (Some(text), Some(camera)) = (row.corrected.as_ref().or(row.result.as_ref()), row.camera_id) else {
            others.push((name_of(row), "nothing was found".to_owned()));
            continue;
        };
        if let std::collections::hash_map::Entry::Vacant(vacant) = cameras.entry(camera) {
            vacant.insert(camera_of(state, camera).await?);
        }
        let exportable = Exportable::read(text).map_err(|error| Problem::internal(&error))?;
        chosen.push((name_of(row), camera, exportable.with_review(row.review.clone())));
    }
    let archive = query.archive;
    let work = move || -> Result<(Vec<File>, Option<f64>), ExportableError> {
        let mut photographs: Vec<Photograph> = Vec::with_capacity(chosen.len());
        let mut target = None;
        for (name, camera, exportable) in &chosen {
            let Some((camera_name, model)) = cameras.get(camera) else { continue };
            match exportable.photograph((name, camera_name), model, &wanted) {
                Ok(photograph) => photographs.push(photograph),
                Err(ExportableError::NotOriented) => {
                    others.push((name.clone(), ExportableError::NotOriented.to_string()));
                    continue;
                }
                Err(error) => return Err(error),
            }
            if target.is_none() {
                target = Some(exportable.target(&wanted)?);
            }
        }
        let target = target.ok_or(ExportableError::NotOriented)?;
        let mut files = exports::write(format, &photographs, &target)?;
        if (files.len() > 1 || archive || is_block) && format != Format::Manifest {
            files.extend(exports::write(Format::Manifest, &photographs, &target)?);
        }
        if is_block {
            files.push(left_out_file(&others));
        }
        // an archive has its manifest to say so
        let residual_px = match &files[..] {
            [_] => exports::residual_max_px(format, &photographs, &target)?,
            _ => None,
        };
        Ok((files, residual_px))
    };
    let done = tokio::task::spawn_blocking(work).await.map_err(|error| Problem::internal(&error))?;
    let (mut files, residual_px) = done.map_err(|error| match error {
        ExportableError::NotOriented if is_block => Problem::conflict(
            "Nothing of this block can be exported yet: no image is green or accepted by staff. Wait for its images, review \
             them, or give all=true for those that are neither.",
        ),
        error => error.into(),
    })?;
    if files.len() == 1 && !archive {
        let file = files.remove(0);
        let mut answer = attachment(&file.name, file.media_type, file.text.into_bytes());
        if let Some(residual_px) = residual_px {
            let value =
                HeaderValue::try_from(format!("{residual_px:.4}")).map_err(|error| Problem::internal(&error))?;
            answer.headers_mut().insert(RESIDUAL_HEADER, value);
        }
        return Ok(answer);
    }
    let zipped = zipped(&files).map_err(|error| Problem::internal(&error))?;
    Ok(attachment(&format!("{title}-{}.zip", format.name()), "application/zip", zipped))
}

fn name_of(row: &ExportedRow) -> String {
    let by_id = || row.image_id.map_or_else(|| "image".to_owned(), |id| id.to_string());
    row.name.clone().unwrap_or_else(by_id)
}

async fn camera_of(state: &AppState, id: Uuid) -> Result<(String, CameraModel), Problem> {
    let gone = || Problem::gone("The camera was deleted.");
    let named = state.store.camera(&id.to_string()).await?.ok_or_else(gone)?;
    let model = camera_model(&state.store, &id.to_string()).await.map_err(|error| Problem::internal(&error))?;
    Ok((named.name, model.ok_or_else(gone)?))
}

fn left_out_file(others: &[(String, String)]) -> File {
    let mut table = csv::Writer::from_writer(Vec::new());
    let rows = std::iter::once(("name", "why")).chain(others.iter().map(|(name, why)| (name.as_str(), why.as_str())));
    for (name, why) in rows {
        // into memory, where nothing fails
        let _ = table.write_record([name, why]);
    }
    let text = String::from_utf8(table.into_inner().unwrap_or_default()).unwrap_or_default();
    File { name: "left_out.csv".into(), media_type: "text/csv; charset=utf-8", text }
}

fn zipped(files: &[File]) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for file in files {
        archive.start_file(&file.name, options)?;
        archive.write_all(file.text.as_bytes())?;
    }
    Ok(archive.finish()?.into_inner())
}

fn attachment(name: &str, media_type: &str, body: Vec<u8>) -> Response {
    let disposition = format!("attachment; filename=\"{name}\"");
    ([(header::CONTENT_TYPE, media_type.to_owned()), (header::CONTENT_DISPOSITION, disposition)], body).into_response()
}

impl From<ExportableError> for Problem {
    fn from(error: ExportableError) -> Self {
        let detail = error.to_string();
        match error {
            ExportableError::NotOriented => Self::not_found("Nothing was found that could be exported."),
            ExportableError::Doubtful { .. } => Self::conflict(detail),
            ExportableError::NoGround => Self::invalid_field("?ground_height_m", detail),
            ExportableError::Export(ExportError::Crs(
                CrsError::Undulation { .. }
                | CrsError::UndulationBesideCompound { .. }
                | CrsError::UndulationWithoutHeight { .. },
            )) => Self::invalid_field("?geoid_undulation_m", detail),
            ExportableError::Crs(_)
            | ExportableError::Export(
                ExportError::Geographic { .. } | ExportError::Crs(_) | ExportError::PoorFit { .. },
            ) => Self::invalid_field("?crs", detail),
            ExportableError::Export(ExportError::Name { .. }) => Self::invalid(detail),
            ExportableError::Export(ExportError::Camera { .. }) => Self::invalid_field("?format", detail),
            ExportableError::Export(_) => Self::invalid_field("?ground_height_m", detail),
            error => Self::internal(&error),
        }
    }
}
