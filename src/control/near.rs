//! Which control points and scenes may be in view of an image? Generous: what is certainly out of view is left out, the selection
//! of those that orient it best is the prediction's.

use std::collections::HashMap;

use chrono::NaiveDate;
use nalgebra::{Vector2, Vector3};

use super::choice::chosen_of_many;
use super::model::Use;
use super::points::{Filter, Kept};
use super::region::{GeodeticBox, longitude_latitude_deg};
use super::scenes::{self, StoredScene};
use super::{ControlError, points, sets};
use crate::database::Database;
use crate::geometry::LocalFrame;
use crate::orientation::ControlPoint;
use crate::pipeline::Approximation;

/// How far control points are looked for, and how many are handed on at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Nothing beyond this horizontal distance from the camera is looked at.
    pub farthest_m: f64,
    /// If more may be in view, those nearest to the middle of the view are taken.
    pub most: usize,
    /// Of more than this the best are chosen: well spread, distinctive, large and not hidden by others.
    pub most_chosen: usize,
    /// The most buildings that are only checked with, those nearest to the middle of the view.
    pub most_check: usize,
    /// The most scenes: each costs decoding its picture and describing what it shows.
    pub most_scenes: usize,
    /// The most pixels of all their pictures together.
    pub most_scene_pixels: u64,
    /// The most bytes of the files of all their pictures together.
    pub most_scene_bytes: u64,
}

/// Kinds of control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kinds {
    /// Roof lines of buildings.
    pub lines: bool,
    /// Small pictures of the ground.
    pub scenes: bool,
}

/// Which control is wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wanted {
    /// Of which kinds.
    pub kinds: Kinds,
    /// Of which sets the buildings are to be; `None`: of all.
    pub sets: Option<Vec<String>>,
    /// When the image was taken: buildings that did not stand then are left out. `None`: whenever they stand.
    pub date: Option<NaiveDate>,
}

/// What may be in view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Near {
    /// Buildings in the local frame, by name.
    pub lines: Vec<ControlPoint>,
    /// Buildings that an orientation is checked with, and never found by; by name.
    pub check: Vec<ControlPoint>,
    /// Scenes whose pictures are not read yet, by name.
    pub scenes: Vec<StoredScene>,
}

impl Default for Reach {
    fn default() -> Self {
        Self {
            farthest_m: 20_000.0,
            most: 20_000,
            most_chosen: 500,
            most_check: 1_000,
            most_scenes: 60,
            most_scene_pixels: 64_000_000,
            most_scene_bytes: 64 << 20,
        }
    }
}

/// So many heights give a median that one tower does not spoil.
const HEIGHTS: usize = 200;
const ENOUGH_HEIGHTS: usize = 5;
/// First radius of the growing search; each further one is four times as large.
const FIRST_RADIUS_M: f64 = 250.0;
/// A ray flatter than this towards the ground shows nothing that could be located.
const FLATTEST_VIEW_RAD: f64 = 75.0 * std::f64::consts::PI / 180.0;
/// The ground is not a plane at the median height: the flying height may be so much larger at the rim.
const RELIEF: f64 = 1.2;

/// The control that may be in view.
///
/// The height of the ground is unknown beforehand: it is taken as the median of the nearest control points and scenes.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn around(
    database: &Database,
    frame: &LocalFrame,
    half_view_rad: f64,
    approximation: &Approximation,
    reach: Reach,
    wanted: &Wanted,
) -> Result<Near, ControlError> {
    let filter = Filter { sets: wanted.sets.clone(), date: wanted.date, name: None };
    let centre_m = approximation.orientation.projection_centre_m;
    let place = longitude_latitude_deg(frame.to_geocentric(centre_m));
    let Some(ground_m) = median_height_m(database, frame, place, reach, &filter).await? else {
        return Ok(Near::default());
    };
    // the pipeline may search a second time, wider
    let erring_more = approximation.erring_more();
    let widest = erring_more.as_ref().unwrap_or(approximation);
    let radius_m = view_radius_m(half_view_rad, widest, ground_m).min(reach.farthest_m);
    let region = GeodeticBox::around_place(place, radius_m);
    let view = View::new(half_view_rad, approximation, ground_m);
    let mut near = Near::default();
    if wanted.kinds.lines {
        let kept = latest(points::in_box(database, region, &filter, 0, usize::MAX).await?, &surveys(database).await?);
        let near_enough =
            |point: &ControlPoint| (point.reference_m - centre_m).xy().norm() <= radius_m + extent_m(point);
        let in_frame = |purpose: Use| {
            let points = kept.iter().filter(move |kept| kept.point.purpose == purpose);
            points.map(|kept| kept.point.in_frame(frame)).filter(near_enough).collect::<Vec<_>>()
        };
        let nearest = |mut points: Vec<ControlPoint>, most: usize| {
            let off_middle_m = |point: &ControlPoint| (point.reference_m.xy() - view.middle_m).norm();
            if points.len() > most {
                points.sort_by(|a, b| off_middle_m(a).total_cmp(&off_middle_m(b)));
                points.truncate(most);
            }
            points.sort_by(|a, b| a.name.cmp(&b.name));
            points
        };
        let lines = nearest(in_frame(Use::Control), reach.most);
        near.lines = chosen_of_many(lines, centre_m, reach.most_chosen);
        near.check = nearest(in_frame(Use::Check), reach.most_check);
    }
    if wanted.kinds.scenes {
        let in_frame = |(_, scene): (i64, StoredScene)| {
            let place_m = frame.from_geocentric(scene.content.reference_geocentric_m).xy();
            Candidate { scene, place_m }
        };
        let candidates = scenes::in_box(database, region, 0, usize::MAX).await?.into_iter().map(in_frame);
        // only its reference is of use
        let candidates = candidates.filter(|candidate| (candidate.place_m - centre_m.xy()).norm() <= radius_m);
        near.scenes = chosen(candidates.collect(), &view, reach);
        near.scenes.sort_by(|a, b| a.content.name.cmp(&b.content.name));
    }
    Ok(near)
}

/// When each set was surveyed, by its number.
async fn surveys(database: &Database) -> Result<HashMap<i64, Option<i64>>, ControlError> {
    Ok(sets::all(database).await?.into_iter().map(|set| (set.id, set.survey_year)).collect())
}

/// Of buildings of the same name in several sets the one that was surveyed last: an image is not to be oriented by the
/// same building twice, nor by what it was before it was rebuilt. But one that is held out in any of them, to check
/// with, orients nothing.
fn latest(mut kept: Vec<Kept>, surveys: &HashMap<i64, Option<i64>>) -> Vec<Kept> {
    if kept.windows(2).all(|pair| pair[0].set_id == pair[1].set_id) {
        return kept;
    }
    let survey = |kept: &Kept| {
        let checks = kept.point.purpose == Use::Check;
        (checks, surveys.get(&kept.set_id).copied().flatten(), kept.id)
    };
    kept.sort_by(|a, b| a.point.name.cmp(&b.point.name).then_with(|| survey(b).cmp(&survey(a))));
    kept.dedup_by(|later, first| later.point.name == first.point.name);
    kept
}

/// A scene with where its reference lies in the local frame.
struct Candidate {
    scene: StoredScene,
    place_m: Vector2<f64>,
}

/// A circle on the ground that is in view if the approximation is right.
struct View {
    middle_m: Vector2<f64>,
    radius_m: f64,
}

impl View {
    fn new(half_view_rad: f64, approximation: &Approximation, ground_m: f64) -> Self {
        let orientation = &approximation.orientation;
        let below = Vector3::new(orientation.projection_centre_m.x, orientation.projection_centre_m.y, ground_m);
        // with a principal distance of 1 the middle of the image is a ray like any other
        let middle = orientation.ground_point_m(1.0, Vector2::zeros(), ground_m).unwrap_or(below);
        let slant_m = (orientation.projection_centre_m - middle).norm();
        Self { middle_m: middle.xy(), radius_m: slant_m * half_view_rad.min(FLATTEST_VIEW_RAD).tan() }
    }
}

/// As many scenes as may be decoded: those nearest to the middle of the view or, where even those that are surely in view
/// are too many, some that are spread over the view, for the corners of an image want control as well.
fn chosen(mut candidates: Vec<Candidate>, view: &View, reach: Reach) -> Vec<StoredScene> {
    let off_middle_m = |candidate: &Candidate| (candidate.place_m - view.middle_m).norm();
    candidates.sort_by(|a, b| off_middle_m(a).total_cmp(&off_middle_m(b)));
    let in_view = candidates.partition_point(|candidate| off_middle_m(candidate) <= view.radius_m);
    if in_view > reach.most_scenes {
        candidates.truncate(in_view);
        candidates = spread(candidates, reach.most_scenes);
    }
    candidates.truncate(reach.most_scenes);
    let (mut pixels, mut bytes) = (0_u64, 0_u64);
    let fits = |candidate: &Candidate| {
        let content = &candidate.scene.content;
        let [width, height] = content.size_px.map(u64::from);
        let (more_pixels, more_bytes) = (pixels + width * height, bytes + content.size_bytes);
        let fits = more_pixels <= reach.most_scene_pixels && more_bytes <= reach.most_scene_bytes;
        if fits {
            (pixels, bytes) = (more_pixels, more_bytes);
        }
        fits
    };
    candidates.into_iter().filter(fits).map(|candidate| candidate.scene).collect()
}

/// The first one, and then always the one that lies farthest from all that were taken.
fn spread(mut candidates: Vec<Candidate>, most: usize) -> Vec<Candidate> {
    let mut taken: Vec<Candidate> = Vec::new();
    let mut apart_m = vec![f64::INFINITY; candidates.len()];
    while taken.len() < most && !candidates.is_empty() {
        // of equals the first
        let farthest = (0..apart_m.len()).rev().max_by(|a, b| apart_m[*a].total_cmp(&apart_m[*b])).unwrap_or(0);
        let next = candidates.remove(farthest);
        apart_m.remove(farthest);
        for (candidate, apart_m) in candidates.iter().zip(&mut apart_m) {
            *apart_m = apart_m.min((candidate.place_m - next.place_m).norm());
        }
        taken.push(next);
    }
    taken
}

async fn median_height_m(
    database: &Database,
    frame: &LocalFrame,
    place: [f64; 2],
    reach: Reach,
    filter: &Filter,
) -> Result<Option<f64>, ControlError> {
    let mut radius_m = FIRST_RADIUS_M.min(reach.farthest_m);
    loop {
        let region = GeodeticBox::around_place(place, radius_m);
        let buildings = points::in_box(database, region, filter, 0, HEIGHTS).await?;
        let scenes = scenes::in_box(database, region, 0, HEIGHTS).await?;
        let buildings = buildings.iter().map(|kept| kept.point.reference_geocentric_m);
        let references = buildings.chain(scenes.iter().map(|(_, scene)| scene.content.reference_geocentric_m));
        let heights_m: Vec<f64> = references.map(|reference| frame.from_geocentric(reference).z).collect();
        let last = radius_m >= reach.farthest_m;
        if heights_m.len() >= ENOUGH_HEIGHTS || last {
            return Ok(median(heights_m));
        }
        radius_m = (4.0 * radius_m).min(reach.farthest_m);
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The horizontal distance from the camera beyond which nothing can be in view: half the diagonal field of view and
/// the tilt, with three standard deviations of all that is uncertain.
fn view_radius_m(half_view_rad: f64, approximation: &Approximation, ground_m: f64) -> f64 {
    let orientation = &approximation.orientation;
    let [sigma_east_m, sigma_north_m, sigma_up_m] = approximation.sigma_position_m;
    let flying_height_m = (orientation.projection_centre_m.z - ground_m).max(0.0) * RELIEF + 3.0 * sigma_up_m;
    // R[2][2] is the cosine between the camera's axis and the plumb line
    let tilt_rad = orientation.camera_from_object.matrix()[(2, 2)].clamp(-1.0, 1.0).acos();
    // omega and phi each have sigma_tilt
    let sigma_rad = approximation.sigma_tilt_rad * std::f64::consts::SQRT_2;
    let flattest_rad = (half_view_rad + tilt_rad + 3.0 * sigma_rad).min(FLATTEST_VIEW_RAD);
    flying_height_m * flattest_rad.tan() + 3.0 * sigma_east_m.hypot(sigma_north_m)
}

fn extent_m(point: &ControlPoint) -> f64 {
    let ends = point.edges_m.iter().flat_map(|edge| [edge.start, edge.end]);
    ends.map(|end| (end - point.reference_m).xy().norm()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, Camera, ExteriorOrientation, rotation};
    fn approximation(height_m: f64, omega_rad: f64) -> Approximation {
        Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(0.0, 0.0, height_m),
                camera_from_object: rotation::camera_from_object(omega_rad, 0.0, 1.0),
            },
            sigma_position_m: [0.0; 3],
            sigma_tilt_rad: 0.0,
            sigma_kappa_rad: None,
        }
    }

    /// Everything that the camera sees on ground level lies within the radius.
    #[test]
    fn the_radius_holds_the_corners_of_the_view() {
        let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        for omega_rad in [0.0, 0.2, 0.5] {
            let approximation = approximation(500.0, omega_rad);
            let radius_m = view_radius_m(camera.half_view_rad(), &approximation, 0.0);
            for corner in [(0.0, 0.0), (4000.0, 0.0), (0.0, 3000.0), (4000.0, 3000.0)] {
                let reduced = camera.reduced_from_pixel(Vector2::new(corner.0, corner.1)).unwrap();
                let ground = approximation.orientation.ground_point_m(3000.0, reduced, 0.0).unwrap();
                assert!(ground.xy().norm() <= radius_m, "{} m of {radius_m} m", ground.xy().norm());
            }
            assert!(radius_m < 2_000.0, "{radius_m} m");
        }
    }

    #[test]
    fn a_camera_below_the_control_points_sees_no_more_than_its_uncertainty() {
        let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        let below = Approximation { sigma_position_m: [10.0, 0.0, 0.0], ..approximation(-50.0, 0.0) };
        assert!((view_radius_m(camera.half_view_rad(), &below, 0.0) - 30.0).abs() < 1e-9);
    }

    #[test]
    fn the_median_of_nothing_is_nothing() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
    }
}
