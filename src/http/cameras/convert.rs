//! Cameras out of the calibrations of other programs.

use axum::http::HeaderMap;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::cameras::conversion::WARN_PX;
use crate::cameras::{CameraFileError, Conversion, Converted, Format, Given, usgs};
use crate::http::extract::media_type;
use crate::http::problem::Problem;
use crate::jobs::film_camera::FilmCameraRequest;

/// How the body is to be read, if it is not the contract's own JSON.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CalibrationQuery {
    /// The program that wrote the body: `opencv`, `colmap`, `opensfm`, `metashape`, `pix4d`, `australis`, `inpho`, or `usgs` for the
    /// text of a calibration report of a film camera; left out, the body is the JSON of this contract.
    #[param(example = "opencv", min_length = 1)]
    pub(super) format: Option<String>,
    /// With `format`: name of the camera. Default: as the file calls it.
    #[param(min_length = 1, max_length = 200)]
    name: Option<String>,
    /// With `format`: which of the cameras in the file, where there are several.
    #[param(min_length = 1)]
    camera: Option<String>,
    /// With `format`: columns and rows of the images, `width,height`, where the file does not tell.
    #[param(example = "4000,3000")]
    image_size_px: Option<String>,
    /// With `format`: side of a pixel, where the file does not tell.
    #[param(exclusive_minimum = 0.0)]
    pixel_size_mm: Option<f64>,
    /// With `usgs`: what the fiducial marks look like, as in `fiducials`; the report does not tell.
    #[param(example = "leica_rc30", min_length = 1)]
    template: Option<String>,
}

/// What is left between the camera and the calibration that it was made from.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ConversionAnswer {
    /// The program of the calibration.
    format: String,
    /// Whether its model is the one of this contract, so that nothing was fitted.
    exact: bool,
    /// The largest residual.
    max_px: f64,
    /// Root mean square of the residuals.
    rms_px: f64,
    /// The residuals over the image.
    residuals: Vec<ResidualAnswer>,
    /// What should be known before the camera is used.
    warnings: Vec<String>,
}

/// The pixel that the camera has for a ray, minus the one that the calibration has.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ResidualAnswer {
    /// Where the calibration has it.
    #[schema(min_items = 2, max_items = 2)]
    position_px: [f64; 2],
    /// The difference.
    #[schema(min_items = 2, max_items = 2)]
    residual_px: [f64; 2],
}

impl CalibrationQuery {
    /// The camera of a body, with its name.
    ///
    /// # Errors
    /// 415 for pictures and the like, 422 where the body is no such calibration or lacks what is not given beside it.
    pub(super) fn read(&self, format: &str, body: &[u8]) -> Result<(String, Conversion, ConversionAnswer), Problem> {
        let format: Format = format.parse().map_err(|error: CameraFileError| of_fault(&error))?;
        let given = Given {
            text: text(body)?,
            camera: self.camera.as_deref(),
            image_size_px: self.image_size()?,
            pixel_size_mm: self.pixel_size()?,
        };
        let Converted { name, conversion, mut warnings } = format.read(&given).map_err(|error| of_fault(&error))?;
        if conversion.max_px > WARN_PX {
            warnings.push(format!("the camera is up to {:.2} px from the calibration", conversion.max_px));
        }
        let name = self.name.clone().or(name).ok_or_else(|| {
            Problem::invalid_field("?name", "the calibration does not name its camera: give name in the query")
        })?;
        let answer = answer(format, &conversion, warnings);
        Ok((name, conversion, answer))
    }

    /// The film camera of a calibration report.
    ///
    /// # Errors
    /// 422 where the body is no such report, or what it does not tell is not given beside it.
    pub(super) fn read_report(&self, body: &[u8]) -> Result<FilmCameraRequest, Problem> {
        let report = usgs::read(text(body)?).map_err(|error| of_fault(&error))?;
        let missing =
            |name: &str, what: &str| Problem::invalid_field(format!("?{name}"), format!("{what}: give {name}"));
        let template = self.template.clone();
        let template =
            template.ok_or_else(|| missing("template", "the report does not tell what its marks look like"))?;
        let name = self.name.clone().or_else(|| report.name.clone());
        let name = name.ok_or_else(|| missing("name", "the report does not name its camera"))?;
        Ok(FilmCameraRequest::of_report(name, &report, &template))
    }

    /// Refuses what only tells something of a calibration where there is none.
    ///
    /// # Errors
    /// 422.
    pub(super) fn refuse_without_format(&self) -> Result<(), Problem> {
        let given = [
            ("name", self.name.is_some()),
            ("camera", self.camera.is_some()),
            ("image_size_px", self.image_size_px.is_some()),
            ("pixel_size_mm", self.pixel_size_mm.is_some()),
            ("template", self.template.is_some()),
        ];
        match given.iter().find(|(_, given)| *given) {
            Some((name, _)) => Err(Problem::invalid_field(format!("?{name}"), "it belongs to a format; give that too")),
            None => Ok(()),
        }
    }

    fn image_size(&self) -> Result<Option<[u32; 2]>, Problem> {
        let Some(text) = &self.image_size_px else { return Ok(None) };
        let sides = text.split_once(',').and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
        sides.map(Some).ok_or_else(|| {
            Problem::invalid_field("?image_size_px", "it must be two whole numbers, as width,height: 4000,3000")
        })
    }

    fn pixel_size(&self) -> Result<Option<f64>, Problem> {
        match self.pixel_size_mm {
            Some(side) if !(side > 0.0 && side <= 1.0) => {
                Err(Problem::invalid_field("?pixel_size_mm", format!("{side} is not above 0 and at most 1 mm")))
            }
            side => Ok(side),
        }
    }
}

/// Refuses bodies that are no text.
///
/// # Errors
/// 415.
pub(super) fn refuse_other_than_text(headers: &HeaderMap) -> Result<(), Problem> {
    let kind = media_type(headers).unwrap_or_default();
    let is_text = kind.starts_with("text/")
        || ["json", "xml", "yaml"].iter().any(|ending| kind.starts_with("application/") && kind.ends_with(ending));
    if is_text {
        return Ok(());
    }
    let given = if kind.is_empty() { "none" } else { kind.as_str() };
    let wanted = "text/plain, application/json, application/xml or application/yaml";
    Err(Problem::unsupported_type(format!("Content-Type is {given}; a calibration is {wanted}")))
}

fn text(body: &[u8]) -> Result<&str, Problem> {
    std::str::from_utf8(body)
        .map_err(|error| Problem::invalid(format!("The calibration is no text in UTF-8: {error}.")))
}

fn answer(format: Format, conversion: &Conversion, warnings: Vec<String>) -> ConversionAnswer {
    let residual =
        |at: &crate::cameras::Residual| ResidualAnswer { position_px: at.position_px, residual_px: at.residual_px };
    ConversionAnswer {
        format: format.to_string(),
        exact: conversion.exact,
        max_px: conversion.max_px,
        rms_px: conversion.rms_px,
        residuals: conversion.residuals.iter().map(residual).collect(),
        warnings,
    }
}

fn of_fault(error: &CameraFileError) -> Problem {
    let detail = error.to_string();
    match error {
        CameraFileError::Several { .. } | CameraFileError::NoSuchCamera { .. } => {
            Problem::invalid_field("?camera", detail)
        }
        CameraFileError::Missing { parameter, .. } | CameraFileError::Contradiction { parameter, .. } => {
            Problem::invalid_field(format!("?{parameter}"), detail)
        }
        CameraFileError::UnknownFormat => Problem::invalid_field("?format", detail),
        _ => Problem::invalid(detail),
    }
}
