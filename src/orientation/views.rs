//! Where to look for a control point when little is known: *views* and *windows* that together cover what the
//! approximation allows.
//!
//! How a building looks depends on where in space it is seen from, on the heading of the image and on its scale, and
//! hardly on the tilt: a camera that turns about its projection centre moves a building in the image and changes its
//! shape only by perspective. So heading and height are cut into steps, the views; tilt and position are not. Under a
//! view the region of the image in which a control point may lie is cut into windows, and in each window the control
//! point is drawn as the orientation has it that is the most likely one *if it lies there*.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

use super::ControlPoint;
use super::predict::{Approximation, Prediction};
use crate::estimation::{PointObservation, Prior, resect};
use crate::geometry::{Camera, ExteriorOrientation, rotation};

/// Tilt and position are believed up to so many of their standard deviations in the image: a tilt of which nothing is
/// known is taken as 0 with the standard deviation of a steady hand, and has a long tail.
pub(super) const REACH_SIGMAS: f64 = 4.0;
/// Heading and height up to so many; for each there are further views to pay for.
const STEPPED_SIGMAS: f64 = 3.0;
/// A turn up to this to either side leaves the shape of a building as it is, to a cell of shifts; so does the change of
/// perspective over as wide a part of the field of view.
pub(super) const HALF_VIEW_RAD: f64 = 5.2 * PI / 180.0;
/// A change of scale up to this, to either side, does the same.
const HALF_VIEW_SCALE: f64 = 0.1;
/// A height above the ground that is wrong by more than this factor is not searched: a height is known better, or it is
/// not known at all.
const WORST_SCALE: f64 = 2.5;
/// Half the width of a window, at least.
const LEAST_WINDOW_PX: f64 = 60.0;
/// Neighbouring windows overlap by so much, as a peak at a rim is none.
const OVERLAP_PX: f64 = 16.0;

/// What the search takes for possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assumed {
    /// Reach of omega and phi to either side of the approximation.
    pub tilt_reach_rad: f64,
    /// Reach of kappa to either side; `None`: the whole circle.
    pub kappa_reach_rad: Option<f64>,
    /// Reach of the projection centre to either side, east and north.
    pub position_reach_m: [f64; 2],
    /// The flying heights above the control that were searched, least and largest.
    pub flying_height_m: [f64; 2],
    /// Whether the stated accuracy of the height allows others, which were left out.
    pub height_cut: bool,
}

/// A part of what the approximation allows, of one heading and scale.
#[derive(Debug, Clone)]
pub(super) struct View {
    prior: Prior,
    prediction: Prediction,
}

/// A square of the image in which a control point may lie, and the orientation that it is then seen under.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) control_point: usize,
    pub(super) view: ExteriorOrientation,
    pub(super) centre_px: Vector2<f64>,
    pub(super) half_width_px: f64,
}

/// The views that cover the approximation, and what they take for possible. `control_height_m` is the typical height
/// of the control.
pub(super) fn views(approximation: &Approximation, control_height_m: f64) -> (Vec<View>, Assumed) {
    let [omega, phi, kappa] = rotation::angles(&approximation.orientation.camera_from_object);
    let kappa_reach_rad = approximation.sigma_kappa_rad.map(|s| STEPPED_SIGMAS * s).filter(|reach| *reach < PI);
    let turns = Steps::over([-1.0, 1.0].map(|side| side * kappa_reach_rad.unwrap_or(PI)), HALF_VIEW_RAD);
    let Heights { stated_m, searched_m, cut } = Heights::of(approximation, control_height_m);
    // scales are cut into equal ratios
    let scales = Steps::over(searched_m.map(f64::ln), HALF_VIEW_SCALE);
    let [sigma_east, sigma_north, sigma_up] = approximation.sigma_position_m;
    let mut views = Vec::with_capacity(turns.count * scales.count);
    for (turn, scale) in turns.middles().flat_map(|turn| scales.middles().map(move |scale| (turn, scale))) {
        let mut narrowed = approximation.clone();
        if scales.count > 1 {
            narrowed.orientation.projection_centre_m.z += scale.exp() - stated_m;
            narrowed.sigma_position_m = [sigma_east, sigma_north, scale.exp() * scales.sigma()];
        } else {
            narrowed.sigma_position_m = [sigma_east, sigma_north, sigma_up];
        }
        narrowed.orientation.camera_from_object = rotation::camera_from_object(omega, phi, kappa + turn);
        narrowed.sigma_kappa_rad = Some(turns.sigma());
        views.extend(View::of(&narrowed));
    }
    let assumed = Assumed {
        tilt_reach_rad: REACH_SIGMAS * approximation.sigma_tilt_rad,
        kappa_reach_rad,
        position_reach_m: [sigma_east, sigma_north].map(|s| REACH_SIGMAS * s),
        flying_height_m: searched_m,
        height_cut: cut,
    };
    (views, assumed)
}

impl View {
    fn of(narrowed: &Approximation) -> Option<Self> {
        let prior = narrowed.prior(&narrowed.orientation)?;
        let prediction = Prediction { orientation: prior.orientation, covariance: prior.information.try_inverse()? };
        Some(Self { prior, prediction })
    }

    /// The share of the region in which a control point may lie that is on the frame.
    pub(super) fn share_on_frame(&self, camera: &Camera, frame: &Frame, control_point: &ControlPoint) -> f64 {
        let Some([least, largest]) = self.region(camera, control_point) else { return 0.0 };
        let on_frame = (largest.inf(&frame.largest_px) - least.sup(&frame.least_px)).map(|side| side.max(0.0));
        on_frame.product() / (largest - least).product()
    }

    /// The rectangle in which a control point may lie.
    fn region(&self, camera: &Camera, control_point: &ControlPoint) -> Option<[Vector2<f64>; 2]> {
        let (predicted, covariance) =
            self.prediction.image_of(camera, control_point.reference_m, control_point.sigma_m)?;
        let reach = covariance.diagonal().map(|variance| (REACH_SIGMAS * variance.sqrt()).max(LEAST_WINDOW_PX));
        Some([predicted - reach, predicted + reach])
    }

    /// The windows in which a control point may lie, within the frame.
    pub(super) fn windows(&self, camera: &Camera, frame: &Frame, control_point: (usize, &ControlPoint)) -> Vec<Window> {
        let (index, reference) = control_point;
        let expected = self.prediction.image_of(camera, reference.reference_m, reference.sigma_m);
        let Some((predicted, covariance)) = expected else { return Vec::new() };
        let Some([least, largest]) = self.region(camera, reference) else { return Vec::new() };
        let (least, largest) = (least.sup(&frame.least_px), largest.inf(&frame.largest_px));
        if least.x >= largest.x || least.y >= largest.y {
            return Vec::new();
        }
        let widest_px = (HALF_VIEW_RAD * camera.principal_distance_px).max(LEAST_WINDOW_PX);
        let columns = Steps::over([least.x, largest.x], widest_px);
        let rows = Steps::over([least.y, largest.y], widest_px);
        let half_width_px = columns.half().max(rows.half()).max(LEAST_WINDOW_PX) + OVERLAP_PX;
        let centres = rows.middles().flat_map(|y| columns.middles().map(move |x| Vector2::new(x, y)));
        let in_reach = |centre: &Vector2<f64>| {
            let open = covariance + Matrix2::identity() * half_width_px.powi(2);
            let away = centre - predicted;
            open.try_inverse().is_some_and(|w| away.dot(&(w * away)) < REACH_SIGMAS.powi(2))
        };
        let seen_there = |centre: Vector2<f64>| {
            let point =
                PointObservation { object_m: reference.reference_m, image_px: centre, sigma_px: OVERLAP_PX / 2.0 };
            let c = camera.principal_distance_px;
            let fit = resect(&[point], Some(&self.prior), &self.prediction.orientation, c)?;
            let centre_px = fit.orientation.reduced_px(c, reference.reference_m)?;
            Some(Window { control_point: index, view: fit.orientation, centre_px, half_width_px })
        };
        centres.filter(in_reach).filter_map(seen_there).collect()
    }
}

/// The frame in reduced pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    least_px: Vector2<f64>,
    largest_px: Vector2<f64>,
}

impl Frame {
    /// The rectangle about the corners and the middles of the sides.
    pub(super) fn of(camera: &Camera) -> Self {
        let around = [0.0, 0.5, 1.0].into_iter().flat_map(|x| [0.0, 0.5, 1.0].map(|y| camera.frame_px(x, y)));
        let around: Vec<_> = around.filter_map(|pixel| camera.reduced_from_pixel(pixel)).collect();
        Self {
            least_px: around.iter().fold(Vector2::zeros(), |a, b| a.inf(b)),
            largest_px: around.iter().fold(Vector2::zeros(), |a, b| a.sup(b)),
        }
    }
}

/// The flying heights above the control: stated, and searched.
struct Heights {
    stated_m: f64,
    searched_m: [f64; 2],
    cut: bool,
}

impl Heights {
    fn of(approximation: &Approximation, control_height_m: f64) -> Self {
        // from below the control nothing of it is seen
        let stated_m = (approximation.orientation.projection_centre_m.z - control_height_m).max(1.0);
        let reach_m = STEPPED_SIGMAS * approximation.sigma_position_m[2];
        let (least_m, largest_m) = (stated_m / WORST_SCALE, stated_m * WORST_SCALE);
        let cut = stated_m - reach_m < least_m || stated_m + reach_m > largest_m;
        let searched_m = [(stated_m - reach_m).max(least_m), (stated_m + reach_m).min(largest_m)];
        Self { stated_m, searched_m, cut }
    }
}

/// What is known of an orientation beforehand, if its heading and scale are near those of `start`.
pub(super) struct Narrowed {
    pub(super) approximation: Approximation,
    /// Logarithm of the odds that they are.
    pub(super) log_odds: f64,
}

/// Narrows what the approximation leaves open of heading and scale to a view about `start`.
pub(super) fn narrowed(approximation: &Approximation, start: &ExteriorOrientation, control_height_m: f64) -> Narrowed {
    let mut narrowed = approximation.clone();
    let mut log_odds = 0.0;
    let [omega, phi, kappa] = rotation::angles(&approximation.orientation.camera_from_object);
    if approximation.sigma_kappa_rad.is_none_or(|sigma| sigma > HALF_VIEW_RAD) {
        let [_, _, near] = rotation::angles(&start.camera_from_object);
        narrowed.orientation.camera_from_object = rotation::camera_from_object(omega, phi, near);
        narrowed.sigma_kappa_rad = Some(HALF_VIEW_RAD);
        log_odds += match approximation.sigma_kappa_rad {
            None => (HALF_VIEW_RAD / PI).ln(),
            Some(sigma) => {
                let away = ((near - kappa + PI).rem_euclid(2.0 * PI) - PI) / sigma;
                (HALF_VIEW_RAD / sigma).ln() - away * away / 2.0
            }
        };
    }
    let height_m = start.projection_centre_m.z;
    let sigma_m = approximation.sigma_position_m[2];
    let near_m = HALF_VIEW_SCALE * (height_m - control_height_m).max(1.0);
    if sigma_m > near_m {
        let away = (height_m - approximation.orientation.projection_centre_m.z) / sigma_m;
        narrowed.orientation.projection_centre_m.z = height_m;
        narrowed.sigma_position_m[2] = near_m;
        log_odds += (near_m / sigma_m).ln() - away * away / 2.0;
    }
    Narrowed { approximation: narrowed, log_odds }
}

/// An interval, cut into equal steps.
#[derive(Clone, Copy)]
struct Steps {
    least: f64,
    largest: f64,
    count: usize,
}

impl Steps {
    /// Steps of at most `half` to either side of their middles.
    fn over([least, largest]: [f64; 2], half: f64) -> Self {
        Self { least, largest, count: (((largest - least) / (2.0 * half)).ceil() as usize).max(1) }
    }

    fn half(self) -> f64 {
        (self.largest - self.least) / (2.0 * self.count as f64)
    }

    fn middles(self) -> impl Iterator<Item = f64> {
        (0..self.count).map(move |k| self.least + self.half() * (2.0 * k as f64 + 1.0))
    }

    /// Standard deviation of what is evenly distributed over a step.
    fn sigma(self) -> f64 {
        self.half() / 3.0_f64.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::geometry::{Brown, Segment2, Segment3};
    use crate::orientation::predict::{edges_px, on_frame};

    fn camera() -> Camera {
        Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap()
    }

    fn approximation(sigma_position_m: [f64; 3], sigma_tilt_deg: f64, sigma_kappa_deg: Option<f64>) -> Approximation {
        Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(0.0, 0.0, 300.0),
                camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.5),
            },
            sigma_position_m,
            sigma_tilt_rad: sigma_tilt_deg.to_radians(),
            sigma_kappa_rad: sigma_kappa_deg.map(f64::to_radians),
        }
    }

    /// A roof that rises by 3 m.
    fn house(at: Vector3<f64>) -> ControlPoint {
        let corner = |x: f64, y: f64, z: f64| at + Vector3::new(x, y, z);
        let rim = [corner(-8.0, -5.0, 0.0), corner(8.0, -5.0, 0.0), corner(8.0, 5.0, 3.0), corner(-8.0, 5.0, 3.0)];
        let edges_m = (0..4).map(|i| Segment3 { start: rim[i], end: rim[(i + 1) % 4] }).collect();
        ControlPoint {
            name: "house".into(),
            sigma_m: 0.05,
            reference_m: at,
            edges_m,
            edge_sigmas_m: Vec::new(),
            scene: None,
        }
    }

    /// Half the diagonal of its plan.
    const HOUSE_M: f64 = 9.5;

    /// An orientation evenly drawn within two standard deviations, of the heading within its circle if it is unknown.
    fn drawn(a: &Approximation, draws: &mut Draws) -> ExteriorOrientation {
        let [omega, phi, kappa] = rotation::angles(&a.orientation.camera_from_object);
        let tilt = 2.0 * a.sigma_tilt_rad;
        let turn = a.sigma_kappa_rad.map_or(std::f64::consts::PI, |s| 2.0 * s);
        let camera_from_object = rotation::camera_from_object(
            omega + draws.even(-tilt, tilt),
            phi + draws.even(-tilt, tilt),
            kappa + draws.even(-turn, turn),
        );
        let away = Vector3::from_iterator(a.sigma_position_m.iter().map(|s| draws.even(-2.0 * s, 2.0 * s)));
        ExteriorOrientation { projection_centre_m: a.orientation.projection_centre_m + away, camera_from_object }
    }

    /// The largest distance of a corner from where a window draws it, once the reference points coincide.
    fn misdrawn_px(camera: &Camera, house: &ControlPoint, truth: &ExteriorOrientation, window: &Window) -> f64 {
        let about_reference = |at: &ExteriorOrientation| -> Vec<Vector2<f64>> {
            let reference = at.reduced_px(camera.principal_distance_px, house.reference_m).unwrap();
            let edges: Vec<Segment2> = edges_px(camera, at, house).into_iter().flatten().collect();
            edges.iter().flat_map(|e| [e.start - reference, e.end - reference]).collect()
        };
        let (seen, drawn) = (about_reference(truth), about_reference(&window.view));
        seen.iter().zip(&drawn).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    /// The share of drawn orientations under which a house on the frame lies in a window that draws it right to
    /// `share` of its size.
    fn covered(a: &Approximation, share: f64) -> f64 {
        let (camera, mut draws) = (camera(), Draws::new(5));
        let frame = Frame::of(&camera);
        let (views, _) = views(a, 0.0);
        let (mut in_view, mut covered) = (0, 0);
        for _ in 0..400 {
            let truth = drawn(a, &mut draws);
            let house = house(Vector3::new(draws.even(-150.0, 150.0), draws.even(-150.0, 150.0), 0.0));
            let Some(image) = truth.reduced_px(camera.principal_distance_px, house.reference_m) else { continue };
            if !on_frame(&camera, image, 0.0) {
                continue;
            }
            in_view += 1;
            let size_px = HOUSE_M * camera.principal_distance_px / truth.projection_centre_m.z;
            let holds = |w: &Window| {
                let inside = (image - w.centre_px).amax() < w.half_width_px;
                inside && misdrawn_px(&camera, &house, &truth, w) < share * size_px
            };
            let windows = views.iter().flat_map(|view| view.windows(&camera, &frame, (0, &house)));
            covered += usize::from(windows.into_iter().any(|w| holds(&w)));
        }
        assert!(in_view > 100, "{in_view}");
        f64::from(covered as u32) / f64::from(in_view)
    }

    #[test]
    fn windows_cover_all_that_the_approximation_allows() {
        let cases = [
            ("attitude", approximation([2.0, 2.0, 3.0], 2.0, Some(3.0))),
            ("nadir", approximation([2.0, 2.0, 3.0], 8.0, Some(3.0))),
            ("position", approximation([2.0, 2.0, 3.0], 5.0, None)),
            ("a receiver's position", approximation([15.0, 15.0, 30.0], 5.0, Some(15.0))),
            ("height", approximation([2.0, 2.0, 60.0], 2.0, Some(3.0))),
        ];
        for (name, approximation) in cases {
            // half a step of heading, one of scale and the perspective across half a window together
            let all = covered(&approximation, 0.25);
            assert!(all > 0.99, "{name}: {all}");
        }
    }

    #[test]
    fn a_good_approximation_needs_one_view_and_one_window() {
        let (camera, a) = (camera(), approximation([2.0, 2.0, 3.0], 1.0, Some(1.5)));
        let (views, _) = views(&a, 0.0);
        assert_eq!(views.len(), 1);
        let windows = |at| views[0].windows(&camera, &Frame::of(&camera), (0, &house(at))).len();
        assert_eq!(windows(Vector3::zeros()), 1);
        assert_eq!(windows(Vector3::new(900.0, 0.0, 0.0)), 0);
    }

    #[test]
    fn a_height_that_allows_too_much_is_cut_and_says_so() {
        let assumed = |sigma_up_m| views(&approximation([2.0, 2.0, sigma_up_m], 2.0, Some(3.0)), 0.0).1;
        assert!(!assumed(50.0).height_cut && assumed(200.0).height_cut);
        let [least_m, largest_m] = assumed(200.0).flying_height_m;
        assert!((least_m - 120.0).abs() < 1e-9 && (largest_m - 750.0).abs() < 1e-9);
    }

    #[test]
    fn a_vague_heading_is_narrowed_like_an_unknown_one() {
        let near = ExteriorOrientation {
            projection_centre_m: Vector3::new(0.0, 0.0, 300.0),
            camera_from_object: rotation::camera_from_object(0.02, 0.0, 0.5 - 4.0),
        };
        let kappa = |n: &Narrowed| rotation::angles(&n.approximation.orientation.camera_from_object)[2];
        let narrow = |sigma_deg: Option<f64>| narrowed(&approximation([1.0; 3], 2.0, sigma_deg), &near, 0.0);
        let vague = narrow(Some(60.0));
        assert!((kappa(&vague) - (0.5 - 4.0 + 2.0 * PI)).abs() < 1e-9);
        // the shorter way round: 2.28 rad of 1.05
        let (sigma, away) = (60.0_f64.to_radians(), 2.0 * PI - 4.0);
        let expected = (HALF_VIEW_RAD / sigma).ln() - (away / sigma).powi(2) / 2.0;
        assert!((vague.log_odds - expected).abs() < 1e-9);
        assert_eq!(vague.approximation.sigma_kappa_rad, Some(HALF_VIEW_RAD));
        let known = narrow(Some(3.0));
        assert!((kappa(&known) - 0.5).abs() < 1e-9 && known.log_odds == 0.0);
        assert!((narrow(None).log_odds - (HALF_VIEW_RAD / PI).ln()).abs() < 1e-9);
    }

    #[test]
    fn the_number_of_windows_is_bounded_for_a_camera_in_millimetres() {
        let camera = Camera::new([4000, 3000], 4.5, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        let frame = Frame::of(&camera);
        let (views, _) = views(&approximation([2.0, 2.0, 3.0], 5.0, Some(3.0)), 0.0);
        let windows = |view: &View| view.windows(&camera, &frame, (0, &house(Vector3::zeros()))).len();
        assert!(views.iter().map(windows).max().unwrap() < 2000);
    }

    #[test]
    fn the_number_of_views_is_bounded() {
        let (views, _) = views(&approximation([1e4; 3], 45.0, None), 0.0);
        assert!(views.len() < 500, "{}", views.len());
    }
}
