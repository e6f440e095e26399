//! A block as it is posted: what the query says, what the list says, and how both become orientations.

use std::collections::HashMap;

use axum::http::HeaderMap;
use chrono::NaiveDate;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use super::lane;
use crate::flight::{self, AngleUnit, Flight, Format, LineFaults, Listed, Source};
use crate::http::area::known_crs;
use crate::http::extract::media_type;
use crate::http::orientations::checked_of;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::request::{ApproximationRequest, ControlChoice, ImageFacts, OrientationRequest};
use crate::report::{Position, Vertical, Warning};
use crate::store::blocks::{self, Block, BlockImage};
use crate::store::cameras::NamedCamera;
use crate::store::images::from_hexadecimal;
use crate::store::now;
use crate::store::orientations::{NewOrientation, Priority};

const LONGEST_NAME: usize = 200;
const DEFAULT_CRS: &str = "EPSG:4979";

/// What all images of a block have in common.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct BlockQuery {
    /// For people. Default: the time of the request.
    #[param(max_length = 200)]
    name: Option<String>,
    /// The camera's id or name.
    #[param(example = "canon-sx260")]
    pub(super) camera: String,
    /// The CRS of the list: `EPSG:<code>` or a PROJ string. Default: EPSG:4979, longitude, latitude and height.
    #[param(example = "EPSG:25832")]
    crs: Option<String>,
    /// What makes the heights ellipsoidal: height above the geoid + this = ellipsoidal height.
    geoid_undulation_m: Option<f64>,
    /// The unit of angles whose column does not say: `deg` (default) or `gon`.
    #[param(inline)]
    angles: Option<Angles>,
    /// Standard deviations of the positions of which the list says none: one number, or `east,north,up`.
    #[param(example = "3,3,5")]
    sigma_position_m: Option<String>,
    /// Standard deviation of omega and phi where the list says none.
    sigma_tilt_deg: Option<f64>,
    /// Standard deviation of kappa where the list gives a kappa without one.
    sigma_kappa_deg: Option<f64>,
    /// The largest planimetric error on the ground that is acceptable, in ground sample distances. Default: 10.
    tolerance_gsd: Option<f64>,
    /// The same in metres, instead.
    tolerance_m: Option<f64>,
    /// Which control is used; default: whatever there is.
    #[param(inline)]
    control: Option<ControlChoice>,
    /// The sets of control points that may be used, by their names with commas between; default: all.
    #[param(example = "default", min_length = 1)]
    control_sets: Option<String>,
    /// When the images were taken: buildings that did not stand then are not used. Default: as their files say, else today.
    date: Option<NaiveDate>,
    /// The CRS of the results; default: that of the list.
    output_crs: Option<String>,
    /// Which of the waiting go first: `low`, `normal` (the default) or `high`.
    #[param(inline)]
    priority: Option<Priority>,
    /// An https address that is told when an image of the block has ended.
    webhook: Option<String>,
}

/// The unit of angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Angles {
    /// 360 to a circle.
    Deg,
    /// 400 to a circle.
    Gon,
}

/// The form of a list, by its type.
pub(super) fn format_of(headers: &HeaderMap) -> Result<Format, Problem> {
    match media_type(headers).as_deref() {
        Some("text/csv" | "text/tab-separated-values") => Ok(Format::Table),
        Some("application/geo+json" | "application/json") => Ok(Format::GeoJson),
        Some("text/plain") => Ok(Format::Text),
        given => {
            let given = given.unwrap_or("none");
            let detail = format!("Content-Type is {given}; it must be text/csv, application/geo+json or text/plain");
            Err(Problem::unsupported_type(detail))
        }
    }
}

impl BlockQuery {
    /// The request of an orientation, without its image and approximation.
    pub(super) fn settings(&self) -> Result<OrientationRequest, Problem> {
        let name = self.name.as_deref().unwrap_or("block");
        if name.trim().is_empty() || name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
            let detail = format!("name must have 1 to {LONGEST_NAME} characters, none of them a control character");
            return Err(Problem::invalid_field("?name", detail));
        }
        Ok(OrientationRequest {
            image: String::new(),
            camera: self.camera.clone(),
            approximation: ApproximationRequest {
                sigma_position_m: self.sigma_position_m.as_deref().map(three_numbers).transpose()?,
                sigma_tilt_deg: self.sigma_tilt_deg,
                ..ApproximationRequest::default()
            },
            tolerance_gsd: self.tolerance_gsd,
            tolerance_m: self.tolerance_m,
            costs: None,
            caution: None,
            threshold: None,
            control: self.control,
            control_sets: self.control_sets.as_ref().map(|sets| sets.split(',').map(str::to_owned).collect()),
            date: self.date,
            interior_orientation: None,
            output_crs: self.output_crs.clone(),
            priority: self.priority,
            webhook: self.webhook.clone(),
        })
    }

    /// How the numbers of the list are meant.
    pub(super) fn source(&self) -> Result<Source, Problem> {
        let crs = known_crs(self.crs.as_deref().unwrap_or(DEFAULT_CRS), self.geoid_undulation_m)?;
        let angles = match self.angles {
            Some(Angles::Gon) => AngleUnit::Gon,
            Some(Angles::Deg) | None => AngleUnit::Degrees,
        };
        Ok(Source { crs, geoid_undulation_m: self.geoid_undulation_m, angles })
    }

    /// What the client should know.
    pub(super) fn warnings(&self, source: &Source) -> Vec<Warning> {
        let assumed = source.crs.assumes_ellipsoidal_heights() && self.geoid_undulation_m.is_none();
        Vec::from_iter(assumed.then(|| Warning::vertical_assumed_ellipsoidal(&source.crs.to_string())))
    }
}

/// One number for all axes, or three.
fn three_numbers(text: &str) -> Result<[f64; 3], Problem> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([all]) => Ok([*all; 3]),
        Some([east, north, up]) => Ok([*east, *north, *up]),
        _ => {
            let detail = "sigma_position_m must be one number, or three as in 3,3,5: metres east, north, up";
            Err(Problem::invalid_field("?sigma_position_m", detail))
        }
    }
}

/// A block whose list is not read yet.
pub(super) struct Planned {
    pub(super) query: BlockQuery,
    pub(super) settings: OrientationRequest,
    pub(super) source: Source,
    pub(super) format: Format,
    pub(super) image_size_px: Option<[u32; 2]>,
}

/// A block whose list makes sense.
pub(super) struct ListedBlock {
    name: String,
    settings: OrientationRequest,
    format: Format,
    images: Vec<(Listed, ApproximationRequest)>,
    pub(super) ignored: Vec<String>,
}

impl Planned {
    /// Reads the list, and checks each image as its orientation will be checked.
    pub(super) fn read(self, body: &[u8]) -> Result<ListedBlock, Problem> {
        let Flight { images, ignored } = flight::parse(body, self.format, &self.source).map_err(|f| refusal(&f))?;
        let images: Vec<_> = images.into_iter().map(|listed| (self.approximation(&listed), listed)).collect();
        let mut faults = LineFaults::default();
        let facts = ImageFacts { size_px: self.image_size_px.unwrap_or([1, 1]), ..ImageFacts::default() };
        for (approximation, listed) in &images {
            let request = OrientationRequest { approximation: approximation.clone(), ..self.settings.clone() };
            let Err(found) = request.prepare(self.image_size_px, &facts) else { continue };
            for fault in found {
                match fault.pointer.strip_prefix("/approximation/") {
                    // what the query says is wrong for all lines alike
                    None => {
                        let name = fault.pointer.trim_start_matches('/');
                        return Err(Problem::invalid_field(format!("?{name}"), fault.detail));
                    }
                    Some(field) if !of_line(field, listed) => {
                        let name = field.split('/').next().unwrap_or_default();
                        return Err(Problem::invalid_field(format!("?{name}"), fault.detail));
                    }
                    Some(field) => {
                        faults.add(flight::place(self.format, listed.number), format!("{field}: {}", fault.detail));
                    }
                }
            }
        }
        if faults.count > 0 {
            return Err(refusal(&faults));
        }
        let images = images.into_iter().map(|(approximation, listed)| (listed, approximation)).collect();
        let name = self.query.name.clone().unwrap_or_else(|| now().format("block of %Y-%m-%d %H:%M:%S").to_string());
        // what the lines say for themselves is in their approximations
        let settings = OrientationRequest { approximation: ApproximationRequest::default(), ..self.settings };
        Ok(ListedBlock { name, settings, format: self.format, images, ignored })
    }

    fn approximation(&self, listed: &Listed) -> ApproximationRequest {
        let common = &self.settings.approximation;
        let vertical = self.source.geoid_undulation_m.map(|geoid_undulation_m| Vertical { geoid_undulation_m });
        ApproximationRequest {
            position: Some(Position { crs: self.source.crs.to_string(), coordinates: listed.position, vertical }),
            vertical: None,
            sigma_position_m: listed.sigma_position_m.or(common.sigma_position_m),
            omega_deg: listed.omega_deg,
            phi_deg: listed.phi_deg,
            kappa_deg: listed.kappa_deg,
            sigma_tilt_deg: listed.sigma_tilt_deg.or(common.sigma_tilt_deg),
            sigma_kappa_deg: listed.sigma_kappa_deg.or(listed.kappa_deg.and(self.query.sigma_kappa_deg)),
        }
    }
}

/// Whether a field of the approximation is what the line says, not the query.
fn of_line(field: &str, listed: &Listed) -> bool {
    match field.split('/').next().unwrap_or_default() {
        "sigma_position_m" => listed.sigma_position_m.is_some(),
        "sigma_tilt_deg" => listed.sigma_tilt_deg.is_some(),
        "sigma_kappa_deg" => listed.sigma_kappa_deg.is_some(),
        _ => true,
    }
}

/// What is wrong with a list.
fn refusal(faults: &LineFaults) -> Problem {
    let first = faults.first.first();
    let more = if faults.count > 1 { format!(" (and {} more)", faults.count - 1) } else { String::new() };
    let detail = first.map_or_else(String::new, |fault| match fault.place.as_str() {
        "" => fault.detail.clone(),
        place => format!("{place}: {}", fault.detail),
    });
    let problem = Problem::invalid(format!("{detail}{more}. Nothing of the list was accepted."));
    faults.first.iter().fold(problem, |problem, fault| problem.with_error(&fault.place, &fault.detail))
}

impl ListedBlock {
    /// Its row.
    pub(super) fn block(&self, id: Uuid, crs: String) -> Result<Block, Problem> {
        let settings = serde_json::to_string(&self.settings).map_err(|error| Problem::internal(&error))?;
        let images = i64::try_from(self.images.len()).unwrap_or(i64::MAX);
        Ok(Block { id, name: self.name.clone(), settings, crs, images, created_at: now() })
    }

    /// The images that are uploaded already, by the place in the list.
    async fn uploaded(&self, state: &AppState) -> Result<HashMap<usize, Uuid>, Problem> {
        let digests: Vec<String> = self.images.iter().filter_map(|(listed, _)| listed.sha256.clone()).collect();
        let by_digest = match digests.is_empty() {
            true => HashMap::new(),
            false => state.store.images_by_sha256(&digests).await?,
        };
        let mut faults = LineFaults::default();
        let mut uploaded = HashMap::new();
        for (index, (listed, _)) in self.images.iter().enumerate() {
            let of_digest = listed.sha256.as_ref().and_then(|digits| by_digest.get(digits)).copied();
            let id = match listed.image.as_ref().map(|id| Uuid::try_parse(id)) {
                None => of_digest,
                Some(Ok(id)) if listed.sha256.is_none() || of_digest == Some(id) => Some(id),
                Some(_) => {
                    let detail = "image_id is no image's id, or not that of the image with this sha256";
                    faults.add(flight::place(self.format, listed.number), detail);
                    None
                }
            };
            uploaded.extend(id.map(|id| (index, id)));
        }
        if faults.count > 0 { Err(refusal(&faults)) } else { Ok(uploaded) }
    }
}

/// Keeps a block, and accepts the orientations of the images that are there already: all of it or nothing.
pub(super) async fn accept(
    state: &AppState,
    block: Block,
    listed: ListedBlock,
    camera: &NamedCamera,
) -> Result<Block, Problem> {
    let uploaded = listed.uploaded(state).await?;
    let queue_max = state.configuration.queue_max_jobs as usize;
    if uploaded.len() > queue_max {
        let detail = format!("{} images of the list are uploaded, but at most {queue_max} may wait", uploaded.len());
        return Err(Problem::invalid(format!("{detail} (set by `queue_max_jobs`); post it in parts.")));
    }
    let (mut rows, mut new, mut faults) = (Vec::new(), Vec::new(), LineFaults::default());
    for (index, (image, approximation)) in listed.images.into_iter().enumerate() {
        let text = serde_json::to_string(&approximation).map_err(|error| Problem::internal(&error))?;
        let mut row = BlockImage {
            number: i64::try_from(index + 1).unwrap_or(i64::MAX),
            name: image.name,
            approximation: text,
            sha256: image.sha256.as_deref().and_then(from_hexadecimal),
            image_id: uploaded.get(&index).copied(),
            orientation_id: None,
        };
        if let Some(id) = row.image_id {
            let request = OrientationRequest { image: id.to_string(), approximation, ..listed.settings.clone() };
            match orientation(state, block.id, id, &request, camera).await? {
                Ok(orientation) => {
                    row.orientation_id = Some(orientation.id);
                    new.push(orientation);
                }
                Err(detail) => faults.add(flight::place(listed.format, image.number), detail),
            }
        }
        rows.push(row);
    }
    if faults.count > 0 {
        return Err(refusal(&faults));
    }
    let mut transaction = state.store.begin_write().await?;
    if !blocks::insert(&mut transaction, &block).await? {
        drop(transaction);
        return super::found(state, block.id).await;
    }
    state.jobs.submit_all(&mut transaction, &new).await?;
    for row in &rows {
        blocks::insert_image(&mut transaction, block.id, row).await?;
    }
    transaction.commit().await?;
    state.jobs.announce(&new).await;
    Ok(block)
}

/// The orientation of an image of a block, or what of its line is wrong.
async fn orientation(
    state: &AppState,
    block: Uuid,
    image: Uuid,
    request: &OrientationRequest,
    camera: &NamedCamera,
) -> Result<Result<NewOrientation, String>, Problem> {
    let Some(image) = state.store.image(image).await? else {
        return Ok(Err("there is no image with this image_id".to_owned()));
    };
    match checked_of(state, Uuid::now_v7(), request, (&image, camera), lane(block)).await {
        Ok(new) => Ok(Ok(new)),
        Err(problem) if problem.status().is_client_error() => Ok(Err(problem.to_string())),
        Err(problem) => Err(problem),
    }
}
