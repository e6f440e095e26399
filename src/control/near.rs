//! Which control points may be in view of an image? Generous: what is certainly out of view is left out, the selection
//! of those that orient it best is the prediction's.

use sqlx::SqlitePool;

use super::model::StoredControlPoint;
use super::region::{GeodeticBox, longitude_latitude_deg};
use super::{ControlError, sqlite};
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
}

impl Default for Reach {
    fn default() -> Self {
        Self { farthest_m: 20_000.0, most: 5_000 }
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

/// The control points that may be in view, in the local frame, by name.
///
/// The height of the ground is unknown beforehand: it is taken as the median of the nearest control points.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn around(
    pool: &SqlitePool,
    frame: &LocalFrame,
    half_view_rad: f64,
    approximation: &Approximation,
    reach: Reach,
) -> Result<Vec<ControlPoint>, ControlError> {
    let centre_m = approximation.orientation.projection_centre_m;
    let place = longitude_latitude_deg(frame.to_geocentric(centre_m));
    let Some(ground_m) = median_height_m(pool, frame, place, reach).await? else {
        return Ok(Vec::new());
    };
    // the pipeline may search a second time, wider
    let erring_more = approximation.erring_more();
    let widest = erring_more.as_ref().unwrap_or(approximation);
    let radius_m = view_radius_m(half_view_rad, widest, ground_m).min(reach.farthest_m);
    let candidates = sqlite::in_box(pool, GeodeticBox::around_place(place, radius_m), 0, usize::MAX).await?;
    let horizontal_m = |point: &ControlPoint| (point.reference_m - centre_m).xy().norm();
    let mut near: Vec<ControlPoint> = candidates
        .iter()
        .map(|(_, stored)| stored.in_frame(frame))
        .filter(|point| horizontal_m(point) <= radius_m + extent_m(point))
        .collect();
    if near.len() > reach.most {
        near.sort_by(|a, b| horizontal_m(a).total_cmp(&horizontal_m(b)));
        near.truncate(reach.most);
    }
    near.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(near)
}

async fn median_height_m(
    pool: &SqlitePool,
    frame: &LocalFrame,
    place: [f64; 2],
    reach: Reach,
) -> Result<Option<f64>, ControlError> {
    let mut radius_m = FIRST_RADIUS_M.min(reach.farthest_m);
    loop {
        let nearest = sqlite::in_box(pool, GeodeticBox::around_place(place, radius_m), 0, HEIGHTS).await?;
        let last = radius_m >= reach.farthest_m;
        if nearest.len() >= ENOUGH_HEIGHTS || last {
            return Ok(median(nearest.iter().map(|(_, point)| height_m(point, frame)).collect()));
        }
        radius_m = (4.0 * radius_m).min(reach.farthest_m);
    }
}

fn height_m(point: &StoredControlPoint, frame: &LocalFrame) -> f64 {
    frame.from_geocentric(point.reference_geocentric_m).z
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
    use nalgebra::{Vector2, Vector3};

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
