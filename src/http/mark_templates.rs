//! Pictures of fiducial marks that users cut from scans, for cameras whose marks Gable does not bring along.

mod picture;
mod upload;

use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Path, Query};
use super::idempotency::NewId;
use super::openapi::Binary;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::store::cameras::Removed;
use crate::store::mark_templates::{MarkTemplate, TemplateAdded};

/// An uncompressed TIFF of the largest size in 16-bit colour has half of that.
const BODY_MAX_BYTES: usize = 4 << 20;

/// The routes of the templates.
pub fn routes() -> OpenApiRouter<AppState> {
    let upload = OpenApiRouter::new().routes(routes!(create)).layer(DefaultBodyLimit::max(BODY_MAX_BYTES));
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(read, remove)).routes(routes!(show_picture)).merge(upload)
}

/// What is said of the picture of a mark.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct MarkTemplateRequest {
    /// Unique, 1 to 200 characters, and none of the names of the templates that Gable brings along. Cameras refer to it.
    #[schema(example = "zeiss-rmk-a-corner", min_length = 1, max_length = 200)]
    name: String,
    /// Side of a pixel on the film, 0.5 to 500.
    #[schema(example = 14.0, minimum = 0.5, maximum = 500)]
    pixel_size_um: f64,
    /// The mark's centre in the picture, x to the right and y down from the corner of the top-left pixel.
    #[schema(example = json!([64.5, 64.5]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    centre_px: [f64; 2],
    /// Rectangles that do not belong to the mark, such as numbers beside it; at most 64.
    #[serde(default)]
    #[schema(max_items = 64)]
    dont_care: Vec<Rectangle>,
    /// Whether the picture was cut from a negative. It is turned into a positive, bright marks on dark.
    #[serde(default)]
    negative: bool,
}

/// A rectangle of whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Rectangle {
    /// First column.
    x: u32,
    /// First row.
    y: u32,
    /// Columns, at least 1.
    #[schema(minimum = 1)]
    width: u32,
    /// Rows, at least 1.
    #[schema(minimum = 1)]
    height: u32,
}

/// What the form of an upload consists of.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only describes the form")]
struct MarkTemplateForm {
    /// The picture, cut from a scan as it is stored: JPEG, PNG or TIFF, 8 to 512 px a side. Bright marks on dark, as in a
    /// positive, unless the template says that it is a negative.
    #[schema(value_type = String, format = Binary)]
    file: Vec<u8>,
    /// What is said of it.
    template: MarkTemplateRequest,
}

/// A template.
#[derive(Debug, Serialize, ToSchema)]
struct MarkTemplateAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Unique.
    name: String,
    /// Columns of the picture.
    width_px: u32,
    /// Rows of the picture.
    height_px: u32,
    /// Side of a pixel on the film.
    pixel_size_um: f64,
    /// The mark's centre in the picture.
    #[schema(min_items = 2, max_items = 2)]
    centre_px: [f64; 2],
    /// Rectangles that do not belong to the mark.
    dont_care: Vec<Rectangle>,
    /// Whether it was cut from a negative.
    negative: bool,
    /// When it was first given.
    created_at: DateTime<Utc>,
}

impl From<MarkTemplate> for MarkTemplateAnswer {
    fn from(MarkTemplate { id, content, created_at }: MarkTemplate) -> Self {
        let rectangle = |[x, y, width, height]: [u32; 4]| Rectangle { x, y, width, height };
        let [width_px, height_px] = content.size_px;
        Self {
            id,
            name: content.name,
            width_px,
            height_px,
            pixel_size_um: content.pixel_size_um,
            centre_px: content.centre_px,
            dont_care: content.dont_care.into_iter().map(rectangle).collect(),
            negative: content.negative,
            created_at,
        }
    }
}

/// Upload a template of a fiducial mark
///
/// A form with two parts: `file`, the picture, and `template`, JSON. The picture is cut from a scan as it is stored,
/// right-reading and with the plate's axes along its sides, and shows bright marks on dark, as in a positive; of a negative
/// the template says so, and it is inverted. The same name with the same content again is answered with 200 and the
/// template that is there.
#[utoipa::path(
    post, path = "/mark-templates", operation_id = "upload_mark_template", tag = "cameras",
    request_body(content = MarkTemplateForm, content_type = "multipart/form-data"),
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat")),
    responses(
        (status = 201, description = "Stored", body = MarkTemplateAnswer),
        (status = 200, description = "It was there already, the same", body = MarkTemplateAnswer),
        (status = 409, description = "The name belongs to another template", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Larger than 512 px a side, or too many bytes", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not a JPEG, PNG or TIFF, or not a form", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense, or the picture is damaged", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(State(state): State<AppState>, NewId(id): NewId, request: Request) -> Result<Response, Problem> {
    let (content, grey) = upload::receive(&state, request).await?;
    let (status, template) = match state.store.add_mark_template(id, &content, &grey).await? {
        TemplateAdded::New(template) => (StatusCode::CREATED, template),
        TemplateAdded::Same(template) => (StatusCode::OK, template),
        TemplateAdded::Different(template) => {
            let detail = format!(
                "There is another template {:?}, id {}; delete it first, or choose another name.",
                template.content.name, template.id
            );
            return Err(Problem::conflict(detail).with_error("/name", "belongs to another template"));
        }
    };
    let location = format!("/api/v1/mark-templates/{}", template.id);
    Ok((status, [(header::LOCATION, location)], axum::Json(MarkTemplateAnswer::from(template))).into_response())
}

/// List the uploaded templates
///
/// The newest first; not those that Gable brings along.
#[utoipa::path(
    get, path = "/mark-templates", operation_id = "list_mark_templates", tag = "cameras", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<MarkTemplateAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<MarkTemplateAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.mark_templates(wanted.before, wanted.fetch()).await?;
    Ok(axum::Json(wanted.page(fetched, |template| template.id, MarkTemplateAnswer::from)))
}

/// Show an uploaded template
#[utoipa::path(
    get, path = "/mark-templates/{id}", operation_id = "show_mark_template", tag = "cameras",
    params(("id" = String, Path, description = "The template's id or name")),
    responses(
        (status = 200, description = "The template", body = MarkTemplateAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(id): Path<String>,
) -> Result<axum::Json<MarkTemplateAnswer>, Problem> {
    let template = state.store.mark_template(&id).await?.ok_or_else(missing)?;
    Ok(axum::Json(template.into()))
}

/// Show the picture of a template
///
/// Grey, with 16 bits, as it is used: bright marks on dark, what does not belong to the mark included.
#[utoipa::path(
    get, path = "/mark-templates/{id}/picture", operation_id = "show_mark_template_picture", tag = "cameras",
    params(("id" = String, Path, description = "The template's id or name")),
    responses(
        (status = 200, description = "The picture", body = inline(Binary), content_type = "image/png"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn show_picture(State(state): State<AppState>, Path(id): Path<String>) -> Result<Response, Problem> {
    let template = state.store.mark_template(&id).await?.ok_or_else(missing)?;
    let grey = state.store.mark_template_grey(template.id).await?.ok_or_else(missing)?;
    let png = picture::png(template.content.size_px, &grey).map_err(|error| Problem::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, "image/png")], png).into_response())
}

/// Delete an uploaded template
///
/// Not while a camera needs it.
#[utoipa::path(
    delete, path = "/mark-templates/{id}", operation_id = "delete_mark_template", tag = "cameras",
    params(("id" = String, Path, description = "The template's id or name")),
    responses(
        (status = 204, description = "Deleted"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "A camera needs it", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match state.store.remove_mark_template(&id).await? {
        Removed::Gone => Ok(StatusCode::NO_CONTENT),
        Removed::Missing => Err(missing()),
        Removed::InUse => Err(Problem::conflict("A camera needs this template; delete the camera first.")),
    }
}

fn missing() -> Problem {
    Problem::not_found("There is no uploaded template with this id or name.")
}
