//! The files of a classifier: its three texts, and pictures of its cost curve and calibration.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};

use super::{found, missing, usable};
use crate::classifiers::{Texts, plot, shipped};
use crate::diagnosis::judge::threshold;
use crate::http::extract::Path;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// The names of the files.
pub(super) const NAMES: [&str; 5] =
    ["model.svm", "scaling.range", "classifier.json", "cost-curve.svg", "calibration.svg"];

/// Get a file of a classifier
///
/// `model.svm` (LIBSVM's model), `scaling.range` (svm-scale's ranges) and `classifier.json` (all the rest) make a folder
/// that `gable evaluate --classifier` reads; `cost-curve.svg` and `calibration.svg` are pictures.
#[utoipa::path(
    get, path = "/classifiers/{id}/{file}", operation_id = "show_classifier_file", tag = "diagnosis",
    params(
        ("id" = String, Path, description = "The classifier's id, or `shipped`"),
        ("file" = String, Path, description = "`model.svm`, `scaling.range`, `classifier.json`, `cost-curve.svg` or `calibration.svg`"),
    ),
    responses(
        (status = 200, description = "The file", content(
            (String = "text/plain"), (serde_json::Value = "application/json"), (String = "image/svg+xml"),
        )),
        (status = 404, description = "There is no such classifier, it has no such file, or it is not trained", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn file(
    State(state): State<AppState>,
    Path((id, file)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let stored = found(&state, &id).await?;
    let loaded = usable(stored.as_ref())?.ok_or_else(|| Problem::not_found("This classifier is not trained."))?;
    let texts = match &stored {
        None => shipped::texts(),
        Some(stored) => {
            let texts = stored.texts.clone().ok_or_else(missing)?;
            Texts { model: texts.model, scaling: texts.scaling, description: texts.description }
        }
    };
    let policy = state.configuration.policy();
    let evaluation = &loaded.description.evaluation;
    let (kind, content) = match file.as_str() {
        "model.svm" => ("text/plain; charset=utf-8", texts.model),
        "scaling.range" => ("text/plain; charset=utf-8", texts.scaling),
        "classifier.json" => ("application/json", texts.description),
        "cost-curve.svg" => {
            let decides = threshold(&loaded.classifier, &policy);
            ("image/svg+xml", plot::cost_curve(evaluation, &policy.costs, decides))
        }
        "calibration.svg" => ("image/svg+xml", plot::calibration(evaluation)),
        _ => return Err(Problem::not_found(format!("A classifier has the files {}.", NAMES.join(", ")))),
    };
    Ok(([(header::CONTENT_TYPE, kind)], content).into_response())
}
