//! The form of a new template.

use axum::body::Bytes;
use axum::extract::multipart::MultipartError;
use axum::extract::{FromRequest as _, Multipart, Request};

use super::{MarkTemplateRequest, Rectangle, picture};
use crate::http::cameras::check_name;
use crate::http::extract::{body_problem, media_type, parse_json, refuse_encoded};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::interior::Library;
use crate::jobs::camera_model::care;
use crate::store::images::INCOMING;
use crate::store::mark_templates::TemplateContent;

const PIXEL_SIZES_UM: std::ops::RangeInclusive<f64> = 0.5..=500.0;
const MOST_RECTANGLES: usize = 64;
/// With fewer pixels nothing is found again.
const LEAST_PIXELS: usize = 25;

/// Reads the form and checks all of it.
pub(super) async fn receive(state: &AppState, request: Request) -> Result<(TemplateContent, Vec<u16>), Problem> {
    let kind = media_type(request.headers()).unwrap_or_default();
    if kind != "multipart/form-data" {
        let detail =
            format!("Content-Type is {kind:?}; it must be multipart/form-data with the parts file and template");
        return Err(Problem::unsupported_type(detail));
    }
    refuse_encoded(request.headers())?;
    let (file, template) = parts(request).await?;
    let template: MarkTemplateRequest = parse_json(&template)?;
    template.check()?;
    let (incoming, limits) = (state.store.folder().join(INCOMING), state.configuration.image_limits());
    let decoded = tokio::task::spawn_blocking(move || picture::decode(&file, &incoming, &limits)).await;
    let (size_px, mut grey) = decoded.map_err(|error| Problem::internal(&error))??;
    let content = template.content(size_px)?;
    check_contrast(&content, &grey)?;
    if content.negative {
        grey.iter_mut().for_each(|grey| *grey = u16::MAX - *grey);
    }
    Ok((content, grey))
}

async fn parts(request: Request) -> Result<(Bytes, Bytes), Problem> {
    let malformed = |error: MultipartError| body_problem(&error, error.status());
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|error| Problem::bad_request(format!("The form is malformed: {}", error.body_text())))?;
    let (mut file, mut template) = (None, None);
    while let Some(part) = form.next_field().await.map_err(malformed)? {
        let name = part.name().unwrap_or_default().to_owned();
        let place = match name.as_str() {
            "file" => &mut file,
            "template" => &mut template,
            _ => {
                let detail = format!("The form has a part {name:?}; it must have two parts, `file` and `template`.");
                return Err(Problem::invalid(detail));
            }
        };
        if place.is_some() {
            return Err(Problem::invalid(format!("The form has more than one part {name:?}.")));
        }
        *place = Some(part.bytes().await.map_err(malformed)?);
    }
    let missing = |name: &str| Problem::invalid(format!("The form has no part `{name}`."));
    Ok((file.ok_or_else(|| missing("file"))?, template.ok_or_else(|| missing("template"))?))
}

impl MarkTemplateRequest {
    /// What can be checked without the picture.
    fn check(&self) -> Result<(), Problem> {
        check_name("/name", &self.name)?;
        if Library::from_name(&self.name).is_some() {
            let detail = format!("{:?} is a template that Gable brings along; choose another name", self.name);
            return Err(Problem::invalid_field("/name", detail));
        }
        if !PIXEL_SIZES_UM.contains(&self.pixel_size_um) {
            let (least, most) = (PIXEL_SIZES_UM.start(), PIXEL_SIZES_UM.end());
            let detail = format!("{} is not from {least} to {most} micrometres", self.pixel_size_um);
            return Err(Problem::invalid_field("/pixel_size_um", detail));
        }
        if self.dont_care.len() > MOST_RECTANGLES {
            let detail = format!("{} rectangles are given; there may be {MOST_RECTANGLES}", self.dont_care.len());
            return Err(Problem::invalid_field("/dont_care", detail));
        }
        Ok(())
    }

    fn content(self, size_px: [u32; 2]) -> Result<TemplateContent, Problem> {
        let [width, height] = size_px;
        for (k, (value, side)) in self.centre_px.into_iter().zip(size_px).enumerate() {
            if !(value > 0.0 && value < f64::from(side)) {
                let detail = format!("{value} is not inside the picture, which has {width} x {height} px");
                return Err(Problem::invalid_field(format!("/centre_px/{k}"), detail));
            }
        }
        for (k, rectangle) in self.dont_care.iter().enumerate() {
            if !rectangle.fits(size_px) {
                let detail =
                    format!("the rectangle is empty, or not inside the picture, which has {width} x {height} px");
                return Err(Problem::invalid_field(format!("/dont_care/{k}"), detail));
            }
        }
        let rectangle = |given: &Rectangle| [given.x, given.y, given.width, given.height];
        Ok(TemplateContent {
            name: self.name,
            size_px,
            pixel_size_um: self.pixel_size_um,
            centre_px: self.centre_px,
            dont_care: self.dont_care.iter().map(rectangle).collect(),
            negative: self.negative,
        })
    }
}

impl Rectangle {
    fn fits(&self, [width, height]: [u32; 2]) -> bool {
        let inside =
            |from: u32, length: u32, side: u32| length > 0 && from.checked_add(length).is_some_and(|end| end <= side);
        inside(self.x, self.width, width) && inside(self.y, self.height, height)
    }
}

/// What is left of the picture must show something.
fn check_contrast(content: &TemplateContent, grey: &[u16]) -> Result<(), Problem> {
    let counting: Vec<u16> =
        grey.iter().zip(care(content)).filter(|(_, cares)| *cares).map(|(grey, _)| *grey).collect();
    if counting.len() < LEAST_PIXELS {
        let detail = format!("only {} pixels are left beside dont_care; a mark needs {LEAST_PIXELS}", counting.len());
        return Err(Problem::invalid_field("/dont_care", detail));
    }
    if counting.iter().min() == counting.iter().max() {
        return Err(Problem::invalid("The picture of the mark is of one grey only; it shows nothing."));
    }
    Ok(())
}
