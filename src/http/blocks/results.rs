//! The results of a block as one file, streamed: a row an image.

use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use futures_util::stream;
use serde::Deserialize;
use serde_json::json;
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use super::{found, settings_of};
use crate::http::extract::{Path, Query};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::Store;
use crate::store::blocks::BlockRow;

/// Rows fetched at a time.
const BATCH: u32 = 100;

/// How the results are to be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum ResultFormat {
    /// A table with a header.
    #[default]
    Csv,
    /// A `FeatureCollection` of points.
    GeoJson,
}

/// How the results are to be written.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ResultsQuery {
    /// `csv` (default) or `geojson`.
    #[serde(default)]
    #[param(inline)]
    format: ResultFormat,
}

/// What of a result is told of an image of a block.
#[derive(Debug, Deserialize)]
pub(super) struct Found {
    projection_centre: Option<Centre>,
    rotation: Option<Angles>,
    covariance: Option<Covariance>,
    pub(super) diagnosis: Diagnosis,
}

#[derive(Debug, Deserialize)]
struct Centre {
    crs: String,
    coordinates: [f64; 3],
}

#[derive(Debug, Deserialize)]
struct Angles {
    omega_deg: f64,
    phi_deg: f64,
    kappa_deg: f64,
}

#[derive(Debug, Deserialize)]
struct Covariance {
    matrix: [[f64; 6]; 6],
}

#[derive(Debug, Deserialize)]
pub(super) struct Diagnosis {
    pub(super) score: Option<f64>,
    probability_correct: Option<f64>,
    reasons: Vec<Reason>,
}

#[derive(Debug, Deserialize)]
struct Reason {
    code: String,
}

impl Found {
    pub(super) fn of(result: Option<&str>) -> Result<Option<Self>, Problem> {
        result.map(serde_json::from_str).transpose().map_err(|error| Problem::internal(&error))
    }

    /// Standard deviations: metres, metres, metres, degrees, degrees, degrees.
    fn sigmas(&self) -> Option<[f64; 6]> {
        let matrix = self.covariance.as_ref()?.matrix;
        Some(std::array::from_fn(|k| {
            let sigma = matrix[k][k].sqrt();
            if k < 3 { sigma } else { sigma.to_degrees() }
        }))
    }
}

const COLUMNS: [&str; 20] = [
    "name",
    "image",
    "orientation",
    "status",
    "verdict",
    "score",
    "probability_correct",
    "crs",
    "x",
    "y",
    "z",
    "omega_deg",
    "phi_deg",
    "kappa_deg",
    "sigma_x_m",
    "sigma_y_m",
    "sigma_z_m",
    "sigma_omega_deg",
    "sigma_phi_deg",
    "sigma_kappa_deg",
];

/// The results of a block
///
/// A row an image, in the order of the list: name, image, orientation, status, verdict, score, probability, the
/// projection centre in the output CRS, omega, phi and kappa about its axes (see `rotation.frame` of a result), their
/// standard deviations (square roots of the covariance's diagonal) and the codes of the reasons. In CSV a text that a
/// spreadsheet would take for a formula begins with an apostrophe. In GeoJSON the coordinates are those of the output CRS,
/// which the member `crs` names; an image without a result has no geometry.
#[utoipa::path(
    get, path = "/blocks/{id}/results", operation_id = "block_results", tag = "blocks",
    params(("id" = Uuid, Path, description = "The block's id"), ResultsQuery),
    responses(
        (status = 200, description = "The results so far", content((String = "text/csv"), (serde_json::Value = "application/geo+json"))),
        (status = 404, description = "There is no such block", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn results(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<ResultsQuery>,
) -> Result<Response, Problem> {
    let block = found(&state, id).await?;
    let (kind, ending) = match query.format {
        ResultFormat::Csv => ("text/csv; charset=utf-8", "csv"),
        ResultFormat::GeoJson => ("application/geo+json", "geojson"),
    };
    let crs = settings_of(&block)?.output_crs.unwrap_or(block.crs);
    let writing = Writing { store: state.store, block: id, format: query.format, crs, after: 0, begun: false };
    let body = Body::from_stream(stream::try_unfold(Some(writing), |writing| async {
        let Some(writing) = writing else { return Ok(None) };
        writing.next().await.map(Some)
    }));
    let disposition = format!("attachment; filename=\"block-{id}.{ending}\"");
    Ok(([(header::CONTENT_TYPE, kind.to_owned()), (header::CONTENT_DISPOSITION, disposition)], body).into_response())
}

/// Results that are being written.
struct Writing {
    store: Store,
    block: Uuid,
    format: ResultFormat,
    crs: String,
    after: i64,
    begun: bool,
}

impl Writing {
    /// The next piece, and what goes on after it. An error cuts the answer off, so that nobody takes it for whole.
    async fn next(mut self) -> Result<(Bytes, Option<Self>), std::io::Error> {
        let rows = self.store.block_rows(self.block, self.after, BATCH).await.map_err(std::io::Error::other)?;
        let last = rows.len() < BATCH as usize;
        let piece = match self.format {
            ResultFormat::Csv => self.table(&rows),
            ResultFormat::GeoJson => self.features(&rows, last),
        };
        let piece = piece.map_err(std::io::Error::other)?;
        self.after = rows.last().map_or(self.after, |row| row.number);
        self.begun = true;
        Ok((piece.into(), (!last).then_some(self)))
    }

    fn table(&self, rows: &[BlockRow]) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
        let mut table = csv::Writer::from_writer(Vec::new());
        if !self.begun {
            table.write_record(COLUMNS.into_iter().chain(["reasons"]))?;
        }
        for row in rows {
            let found = Found::of(row.result.as_deref())?;
            table.write_record(cells(row, found.as_ref()))?;
        }
        Ok(table.into_inner()?)
    }

    fn features(&self, rows: &[BlockRow], last: bool) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
        let mut text = String::new();
        if !self.begun {
            let crs = json!({"type": "name", "properties": {"name": self.crs}});
            text.push_str(&format!("{{\"type\":\"FeatureCollection\",\"crs\":{crs},\"features\":["));
        }
        for (index, row) in rows.iter().enumerate() {
            let separator = if self.begun || index > 0 { ",\n" } else { "\n" };
            let found = Found::of(row.result.as_deref())?;
            text.push_str(separator);
            text.push_str(&feature(row, found.as_ref()).to_string());
        }
        if last {
            text.push_str("\n]}\n");
        }
        Ok(text.into_bytes())
    }
}

fn cells(row: &BlockRow, found: Option<&Found>) -> Vec<String> {
    let id = |id: Option<Uuid>| id.map_or_else(String::new, |id| id.to_string());
    let real = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let centre = found.and_then(|found| found.projection_centre.as_ref());
    let angles = found.and_then(|found| found.rotation.as_ref());
    let sigmas = found.and_then(Found::sigmas);
    let mut cells = vec![row.name.clone(), id(row.image_id), id(row.orientation_id), status(row).to_owned()];
    cells.push(row.verdict.clone().unwrap_or_default());
    cells.push(real(found.and_then(|found| found.diagnosis.score)));
    cells.push(real(found.and_then(|found| found.diagnosis.probability_correct)));
    cells.push(centre.map_or_else(String::new, |centre| centre.crs.clone()));
    cells.extend((0..3).map(|k| real(centre.map(|centre| centre.coordinates[k]))));
    cells.extend([angles.map(|a| a.omega_deg), angles.map(|a| a.phi_deg), angles.map(|a| a.kappa_deg)].map(real));
    cells.extend((0..6).map(|k| real(sigmas.map(|sigmas| sigmas[k]))));
    cells.push(found.map_or_else(String::new, |found| codes(found).join(" ")));
    cells.into_iter().map(harmless).collect()
}

fn status(row: &BlockRow) -> &str {
    row.status.as_deref().unwrap_or("listed")
}

fn codes(found: &Found) -> Vec<&str> {
    found.diagnosis.reasons.iter().map(|reason| reason.code.as_str()).collect()
}

/// A cell that no spreadsheet takes for a formula.
fn harmless(cell: String) -> String {
    match cell.starts_with(['=', '+', '-', '@', '\t', '\r']) && cell.parse::<f64>().is_err() {
        true => format!("'{cell}"),
        false => cell,
    }
}

fn feature(row: &BlockRow, found: Option<&Found>) -> serde_json::Value {
    let centre = found.and_then(|found| found.projection_centre.as_ref());
    let geometry = centre.map(|centre| json!({"type": "Point", "coordinates": centre.coordinates}));
    let mut properties = json!({
        "name": row.name,
        "image": row.image_id,
        "orientation": row.orientation_id,
        "status": status(row),
        "verdict": row.verdict,
    });
    if let Some(found) = found {
        properties["score"] = json!(found.diagnosis.score);
        properties["probability_correct"] = json!(found.diagnosis.probability_correct);
        properties["reasons"] = json!(codes(found));
        if let Some(centre) = centre {
            properties["crs"] = json!(centre.crs);
        }
        if let Some(Angles { omega_deg, phi_deg, kappa_deg }) = found.rotation {
            for (name, angle) in [("omega_deg", omega_deg), ("phi_deg", phi_deg), ("kappa_deg", kappa_deg)] {
                properties[name] = json!(angle);
            }
        }
        for (name, sigma) in COLUMNS[14..].iter().zip(found.sigmas().into_iter().flatten()) {
            properties[*name] = json!(sigma);
        }
    }
    json!({"type": "Feature", "geometry": geometry, "properties": properties})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_is_a_formula() {
        for formula in ["=1+1", "+cmd", "-2+3", "@sum", "\tx", "-", "\r"] {
            assert_eq!(harmless(formula.to_owned()), format!("'{formula}"));
        }
        for harmless_text in ["-12.5", "+3", "a=b", "", "1e-3"] {
            assert_eq!(harmless(harmless_text.to_owned()), harmless_text);
        }
    }
}
