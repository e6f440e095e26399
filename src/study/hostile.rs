//! Images that invite a wrong answer: control that lies on a line or in one corner, that is just enough, that is mostly
//! false, and rows of houses so alike that the control fits perfectly at the wrong place.

use nalgebra::Vector2;

use super::Mixture;
use crate::simulation::{
    Building, CameraSettings, ControlSettings, Draws, FlightSettings, Purpose, Roof, Scene, SceneSettings,
    SimulatedControlPoint, SimulationError, Town, fly, survey,
};

/// How the control deceives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hostility {
    /// All of it along one line, as the houses along a street.
    Collinear,
    /// All of it in one corner of the image.
    Corner,
    /// Four control points: the least that leaves a check.
    Four,
    /// Nine of ten control points are out of date, or their house is gone.
    False,
    /// A lattice of like houses, larger than the frame, and a position known to no more than its period.
    Repeated,
}

impl Hostility {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Collinear, Self::Corner, Self::Four, Self::False, Self::Repeated];

    /// That of a seed: they take turns.
    #[must_use]
    pub fn of(seed: u64) -> Self {
        Self::ALL[(seed % Self::ALL.len() as u64) as usize]
    }
}

/// A smaller frame, so that thousands of images take minutes; some twenty houses are in it.
const IMAGE_SIZE_PX: [u32; 2] = [1000, 750];
/// Fewer than these control points would not be oriented, more would not be degenerate.
const FEW: [u32; 2] = [4, 9];
/// From one house to the next, along the rows and across them.
const PERIOD_ALONG_M: [f64; 2] = [15.0, 22.0];
const PERIOD_ACROSS_M: [f64; 2] = [20.0, 30.0];
/// Houses of a side of the lattice: beyond the frame on all sides.
const LATTICE: i32 = 16;
/// Of the position over the lattice: a neighbour is as likely as the right house.
const SIGMA_POSITION_M: [f64; 3] = [12.0, 12.0, 4.0];

/// The settings of the image with a seed.
#[must_use]
pub(super) fn settings(seed: u64) -> SceneSettings {
    let of_good = Mixture::Good.settings(seed);
    let [columns, rows] = IMAGE_SIZE_PX.map(f64::from);
    let share = columns / f64::from(of_good.camera.image_size_px[0]);
    let camera = CameraSettings {
        image_size_px: IMAGE_SIZE_PX,
        principal_distance_px: share * of_good.camera.principal_distance_px,
        principal_point_px: [columns / 2.0 + 3.4, rows / 2.0 - 2.7],
        ..of_good.camera
    };
    let flight = FlightSettings { height_m: share * of_good.flight.height_m, ..of_good.flight };
    let control = ControlSettings { share: 1.0, ..of_good.control };
    let settings = SceneSettings { camera, flight, control, ..of_good };
    match Hostility::of(seed) {
        Hostility::Collinear | Hostility::Corner | Hostility::Four => settings,
        Hostility::False => {
            let control = ControlSettings { share_outdated: 0.8, share_gone: 0.5, ..control };
            SceneSettings { control, ..settings }
        }
        Hostility::Repeated => {
            let flight = FlightSettings { sigma_position_m: SIGMA_POSITION_M, ..flight };
            SceneSettings { flight, ..settings }
        }
    }
}

/// The scene of a seed.
///
/// # Errors
/// [`SimulationError`] if a setting makes no sense.
pub(super) fn scene(seed: u64) -> Result<Scene, SimulationError> {
    let mut scene = Scene::draw(seed, &settings(seed))?;
    let draws = &mut Draws::new(seed, Purpose::Hostility);
    let few = (FEW[0] + draws.below(FEW[1] - FEW[0])) as usize;
    let towards = draws.between(0.0, 1.0);
    match Hostility::of(seed) {
        Hostility::False => {}
        Hostility::Collinear => {
            // the line of a street: through one house, along its ridge
            let on_line = picked(&scene, towards).map(|point| {
                (point.control_point.reference_m.xy(), scene.town.buildings[point.building].ridge_direction)
            });
            if let Some((through, along)) = on_line {
                keep_nearest(&mut scene, few, |_, point| {
                    along.perp(&(point.control_point.reference_m.xy() - through)).abs()
                });
            }
        }
        Hostility::Corner => {
            let [columns, rows] = IMAGE_SIZE_PX.map(f64::from);
            let corner =
                Vector2::new(if towards < 0.5 { 0.0 } else { columns }, if few.is_multiple_of(2) { 0.0 } else { rows });
            keep_nearest(&mut scene, few, |pixel, _| (pixel - corner).norm());
        }
        Hostility::Four => {
            let mut order: Vec<usize> = (0..scene.control.len()).collect();
            draws.shuffle(&mut order);
            let ranks: Vec<(String, f64)> = order
                .iter()
                .enumerate()
                .map(|(rank, &k)| (scene.control[k].control_point.name.clone(), rank as f64))
                .collect();
            keep_nearest(&mut scene, 4, |_, point| {
                ranks.iter().find(|(name, _)| *name == point.control_point.name).map_or(f64::MAX, |(_, rank)| *rank)
            });
        }
        Hostility::Repeated => repeat(&mut scene, draws),
    }
    Ok(scene)
}

/// One of the control points in view.
fn picked(scene: &Scene, at: f64) -> Option<SimulatedControlPoint> {
    let in_view: Vec<&SimulatedControlPoint> = scene.in_view().collect();
    in_view.get((at * in_view.len() as f64) as usize).map(|point| (*point).clone())
}

/// Leaves the control points in view with the least values of a function of their pixel, and of themselves.
fn keep_nearest(scene: &mut Scene, count: usize, distance: impl Fn(Vector2<f64>, &SimulatedControlPoint) -> f64) {
    let of_point = |point: &SimulatedControlPoint| {
        let pixel = scene.true_orientation.pixel(&scene.camera, point.control_point.reference_m)?;
        Some((distance(pixel, point), point.clone()))
    };
    let mut ranked: Vec<(f64, SimulatedControlPoint)> = scene.in_view().filter_map(of_point).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    scene.control = ranked.into_iter().take(count).map(|(_, point)| point).collect();
}

/// Puts a lattice of like houses in the place of the town, and measures a block of them in its middle.
fn repeat(scene: &mut Scene, draws: &mut Draws) {
    let ground_m = scene.town.terrain.mean_height_m;
    let Some(pattern) = scene.town.buildings.iter().find(|b| b.purpose == crate::simulation::Use::Main) else { return };
    let along = pattern.ridge_direction;
    let (length_m, width_m) = (pattern.length_m.min(11.0), pattern.width_m.min(9.0));
    let pattern = Building { ground_m, length_m, width_m, roof: Roof::Gable { slope: 0.7 }, ..pattern.clone() };
    let [[least_along, most_along], [least_across, most_across]] = [PERIOD_ALONG_M, PERIOD_ACROSS_M];
    let step = along * draws.between(least_along, most_along);
    let across = Vector2::new(-along.y, along.x) * draws.between(least_across, most_across);
    let middle = scene.town.centre_m;
    let places = (-LATTICE / 2..LATTICE / 2).flat_map(|i| (-LATTICE / 2..LATTICE / 2).map(move |j| (i, j)));
    let house = |(i, j): (i32, i32)| Building {
        centre_m: middle + step * f64::from(i) + across * f64::from(j),
        ..pattern.clone()
    };
    let mut town = Town::of_buildings(places.map(house).collect(), ground_m, scene.town.to_sun);
    town.centre_m = middle;
    let settings = &scene.settings;
    let (true_orientation, approximation) = fly(&town, &scene.camera, scene.seed, &settings.flight);
    let mut control = survey(&town, scene.seed, &settings.control);
    let reach_m = 0.35 * scene.ground_sample_distance_m() * f64::from(IMAGE_SIZE_PX[1]);
    control.retain(|point| (point.control_point.reference_m.xy() - middle).amax() < reach_m);
    *scene = Scene { town, true_orientation, approximation, control, ..scene.clone() };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(hostility: Hostility) -> impl Iterator<Item = Scene> {
        (1..=40).filter(move |seed| Hostility::of(*seed) == hostility).map(|seed| scene(seed).unwrap())
    }

    fn pixels(scene: &Scene) -> Vec<Vector2<f64>> {
        let pixel = |point: &SimulatedControlPoint| {
            scene.true_orientation.pixel(&scene.camera, point.control_point.reference_m).unwrap()
        };
        scene.in_view().map(pixel).collect()
    }

    /// The smaller standard deviation of the points of the plane.
    fn width(points: &[Vector2<f64>]) -> f64 {
        let count = points.len() as f64;
        let mean = points.iter().sum::<Vector2<f64>>() / count;
        let scatter = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<nalgebra::Matrix2<f64>>();
        (scatter / count).symmetric_eigenvalues().min().max(0.0).sqrt()
    }

    #[test]
    fn the_control_is_as_bad_as_it_is_called() {
        for scene in of(Hostility::Four) {
            assert_eq!(scene.control.len(), 4);
        }
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let narrow = median(of(Hostility::Collinear).map(|scene| width(&pixels(&scene))).collect());
        let wide = median(of(Hostility::Four).map(|scene| width(&pixels(&scene))).collect());
        assert!(narrow < 0.5 * wide, "{narrow} and {wide} px");
        for scene in of(Hostility::Corner) {
            let pixels = pixels(&scene);
            let mean = pixels.iter().sum::<Vector2<f64>>() / pixels.len() as f64;
            assert!((mean - Vector2::new(500.0, 375.0)).norm() > 200.0, "{mean}");
        }
        for scene in of(Hostility::False) {
            let sound = scene.control.iter().filter(|point| point.fault.is_none()).count();
            assert!((sound as f64) < 0.25 * scene.control.len() as f64);
        }
    }

    #[test]
    fn a_lattice_repeats_beyond_the_frame() {
        for scene in of(Hostility::Repeated) {
            let houses = &scene.town.buildings;
            let period = houses[1].centre_m - houses[0].centre_m;
            assert!(houses.len() == 256 && (scene.control.len() >= 9));
            for point in scene.control.iter().filter(|point| point.fault.is_none()) {
                // every house of the control has one like it a period away
                let neighbour = houses[point.building].centre_m + period;
                assert!(houses.iter().any(|house| (house.centre_m - neighbour).norm() < 1e-9));
            }
        }
    }
}
