//! The named mixtures: what images a study is made of. Every number has its reason here.
//!
//! They were frozen on 2026-11-22, before the figures that are reported of them were taken (see [`VERSION`]). What they
//! were held against until then: `good` came out, unchanged, with the shares of right and wrong, accepted and rejected
//! that the paper has of its 17 000 images, for the paper's own method; `poor` was too bad for that method (32 % right)
//! and was eased once: the method then oriented 43 % of 200 images rightly, the paper of its area II before the diagnosis
//! 99 of 223, 44 %. Those were the seeds from 5001 on, not the first ones, which studies take. What our own pipeline makes of an image had no say. Both are
//! held against real photographs by `likeness`: of sound models in `good` 51 % of the edges have a segment near (52 to
//! 60 % in the three datasets of the benchmark), the blur across edges is 1.5 cells (1.4 to 1.8), the shifts of whole
//! models have a standard deviation of 1.5 px in a coordinate (1.0 to 1.6).

use serde::{Deserialize, Serialize};

use super::hostile;
use crate::simulation::{
    CameraSettings, ControlSettings, Draws, FlightSettings, PhotographSettings, Purpose, Scene, SceneSettings,
    SimulationError, TownSettings,
};

/// Goes up with every change of a distribution: rows of different versions do not belong in one table.
pub const VERSION: u32 = 2;

/// A mixture of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mixture {
    /// Like the paper's area I: images of good quality with enough control, though not free of errors.
    Good,
    /// Like its area II: bad images, with little control of which much cannot be identified.
    Poor,
    /// Like neither: everything that may be asked of a classifier, from the best to the hopeless. For training.
    Wide,
    /// Control that invites a wrong answer ([`Hostility`](super::Hostility)): nothing wrong may be accepted.
    Hostile,
}

/// Columns and rows. The segments of 1600 x 1200 pixels at full resolution are about as many as those of the
/// benchmark's 4608 x 3456 at the half resolution at which soft photographs are searched; more pixels cost rendering
/// time and show nothing new.
const IMAGE_SIZE_PX: [u32; 2] = [1600, 1200];
/// One ray in each pixel. The places are shifted from pixel to pixel and the blur averages over ten to forty of them;
/// four rays render twice as long and move no edge by more than the noise does.
const RAYS_PER_PIXEL: u32 = 1;

/// What differs between the mixtures: evenly distributed ranges and single shares.
struct Distributions {
    gsd_m: [f64; 2],
    principal_distance_px: [f64; 2],
    greatest_tilt_deg: [f64; 2],
    /// Standard deviation of a coordinate of what neighbouring models have in common of their shifts.
    strain_px: [f64; 2],
    /// Share of the houses that were measured.
    control: [f64; 2],
    /// How far from the town's middle the image may look: what moves the control to one side.
    aim_spread_m: [f64; 2],
    /// Share of the models whose house was moved or rebuilt since.
    outdated: [f64; 2],
    /// Share of the models whose house is gone.
    gone: [f64; 2],
    /// Share of the edges that were not measured.
    missing_edges: [f64; 2],
    /// Standard deviation of a coordinate of the shift of a whole model.
    shift_px: [f64; 2],
    /// Standard deviation of the shift of a single edge.
    edge_px: [f64; 2],
    /// Blur of lens, film and motion.
    blur_px: [f64; 2],
    noise_grey: [f64; 2],
    /// What haze leaves of the contrasts.
    clearness: [f64; 2],
    sun_elevation_deg: [f64; 2],
    /// Density of the trees, 1: that of a suburb.
    trees: [f64; 2],
    /// Share of the images taken while the trees are bare.
    winter: f64,
    /// Share of the houses that are built alike.
    share_alike: [f64; 2],
    sigma_tilt_deg: [f64; 2],
    /// Share of the flights whose navigation errs three times as much as it states.
    wild: f64,
}

const GOOD: Distributions = Distributions {
    // at this ground sample distance most roof edges are 25 to 60 px long, short enough to be looked for at full
    // resolution, and some fifty houses are in the frame
    gsd_m: [0.18, 0.22],
    // the benchmark's field of view: its principal distance is 0.815 of the width (3757 of 4608 px)
    principal_distance_px: [1304.0, 1304.0],
    // survey flights on film stay below 3 to 5 degrees; the benchmark's drone flew at 3 to 10
    greatest_tilt_deg: [6.0, 6.0],
    strain_px: [0.0, 0.0],
    // 24 models in a frame in the mean: a survey department sets up more than it needs
    control: [0.25, 0.55],
    // the town still fills the frame: control in all corners, or nearly so
    aim_spread_m: [10.0, 50.0],
    // one to three per cent a year, and control that is one to ten years old
    outdated: [0.03, 0.15],
    // houses are torn down less often than changed
    gone: [0.0, 0.06],
    // the edges that an operator sees in two photographs: all, or two thirds of them under trees
    missing_edges: [0.0, 0.3],
    // 1.0 to 1.6 px were measured in the benchmark, in which the errors of corners and single edges have a share
    shift_px: [1.1, 1.1],
    // gutters that were taken for the rim of the roof: 10 to 20 cm
    edge_px: [0.8, 0.8],
    // about the medians of the benchmark's datasets, 1.4 to 1.8: lens, forward motion, interpolated colours
    blur_px: [1.2, 1.9],
    noise_grey: [2.0, 5.0],
    // survey flights wait for clear days
    clearness: [0.7, 1.0],
    // and for the hours about noon: in Central Europe from the end of February to October
    sun_elevation_deg: [22.0, 55.0],
    // about the density of a suburb
    trees: [0.6, 1.5],
    // survey flights prefer early spring; a third of them gets it
    winter: 0.3,
    // detached houses with some rows of the same type among them
    share_alike: [0.1, 0.4],
    // the benchmark's `attitude` states 2 degrees; the positions are its 2 to 3 m in both mixtures
    sigma_tilt_deg: [1.5, 2.5],
    // a mistaken record, now and then, by three times what it states. (The pipeline has the same factor, from real
    // flights: these images say nothing of records that are worse)
    wild: 0.02,
};

const POOR: Distributions = Distributions {
    // the same camera and flight
    gsd_m: GOOD.gsd_m,
    principal_distance_px: GOOD.principal_distance_px,
    greatest_tilt_deg: GOOD.greatest_tilt_deg,
    strain_px: GOOD.strain_px,
    // three quarters of that
    control: [0.18, 0.42],
    // the rim of the town is in most frames, and its control on one side
    aim_spread_m: [20.0, 80.0],
    // control of five to fifteen years
    outdated: [0.08, 0.2],
    gone: [0.02, 0.08],
    // trees and shadows over more of the photographs it was measured in
    missing_edges: [0.1, 0.35],
    // measured at a smaller scale
    shift_px: [1.2, 1.2],
    edge_px: [0.9, 0.9],
    // a little softer by the motion of a longer exposure
    blur_px: [1.3, 2.1],
    // fast film
    noise_grey: [3.0, 7.0],
    // flown in haze that takes a third of the contrasts, on the worst days half of them
    clearness: [0.5, 0.85],
    // mornings and the autumn: shadows of one to three times the height of a house, whose rims are lines too
    sun_elevation_deg: [18.0, 45.0],
    // old gardens in summer: crowns over the eaves
    trees: [0.8, 2.0],
    // and bare trees somewhat more often, whose shadows draw lines over the roofs
    winter: 0.4,
    // estates whose houses repeat
    share_alike: [0.2, 0.6],
    // a camera without a stabilised mount
    sigma_tilt_deg: [1.5, 3.0],
    // twice as many mistaken records
    wild: 0.04,
};

/// Every range reaches from something better than `good` to something worse than `poor`, or what cameras and flights
/// there are. How often what comes does not matter: a classifier must have met it.
const WIDE: Distributions = Distributions {
    // houses of 40 to 100 px
    gsd_m: [0.12, 0.28],
    // from a wide angle to that of a consumer's zoom
    principal_distance_px: [1000.0, 2100.0],
    // the benchmark's kite: up to 23 degrees
    greatest_tilt_deg: [2.0, 24.0],
    // the benchmark's neighbours share 0.9 px
    strain_px: [0.0, 1.4],
    // from 3 or 4 control points in a frame, as in the benchmark, to `good`
    control: [0.05, 0.5],
    // to where half of the frame is beside the town
    aim_spread_m: [10.0, 150.0],
    outdated: [0.0, 0.25],
    gone: [0.0, 0.12],
    missing_edges: [0.0, 0.4],
    // by hand at a large scale, to an automatic survey
    shift_px: [0.5, 1.6],
    edge_px: [0.5, 1.2],
    blur_px: [0.9, 2.3],
    noise_grey: [1.5, 8.0],
    clearness: [0.45, 1.0],
    sun_elevation_deg: [15.0, 60.0],
    trees: [0.3, 2.2],
    winter: 0.35,
    share_alike: [0.0, 0.7],
    sigma_tilt_deg: [1.0, 3.0],
    wild: 0.05,
};

impl Mixture {
    /// Its name on the command line and in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Poor => "poor",
            Self::Wide => "wide",
            Self::Hostile => "hostile",
        }
    }

    /// What an orientation of the image with a seed may err on the ground, in ground sample distances: the contract's
    /// default and the benchmark's, but for training whatever may be asked for.
    #[must_use]
    pub fn tolerance_gsd(self, seed: u64) -> f64 {
        match self {
            Self::Good | Self::Poor | Self::Hostile => 10.0,
            Self::Wide => libm::exp(Draws::new(seed, Purpose::Tolerance).between(libm::log(2.5), libm::log(12.0))),
        }
    }

    fn distributions(self) -> &'static Distributions {
        match self {
            Self::Good | Self::Hostile => &GOOD,
            Self::Poor => &POOR,
            Self::Wide => &WIDE,
        }
    }

    /// The scene of a seed.
    ///
    /// # Errors
    /// [`SimulationError`] if a setting makes no sense.
    pub fn scene(self, seed: u64) -> Result<Scene, SimulationError> {
        match self {
            Self::Hostile => hostile::scene(seed),
            Self::Good | Self::Poor | Self::Wide => Scene::draw(seed, &self.settings(seed)),
        }
    }

    /// The settings of the image with a seed.
    #[must_use]
    pub fn settings(self, seed: u64) -> SceneSettings {
        if self == Self::Hostile {
            return hostile::settings(seed);
        }
        let d = self.distributions();
        let draws = &mut Draws::new(seed, Purpose::Mixture);
        let mut within = |[low, high]: [f64; 2]| draws.between(low, high);
        let gsd_m = within(d.gsd_m);
        let share = within(d.control);
        let share_outdated = within(d.outdated);
        let share_gone = within(d.gone);
        let share_missing = within(d.missing_edges);
        let aim_spread_m = within(d.aim_spread_m);
        let sigma_tilt_deg = within(d.sigma_tilt_deg);
        let blur_sigma_px = within(d.blur_px);
        let noise_grey = within(d.noise_grey);
        let clearness = within(d.clearness);
        let trees = within(d.trees);
        let share_alike = within(d.share_alike);
        let foliage = if within([0.0, 1.0]) < d.winter { LEAVES_IN_WINTER } else { 1.0 };
        let principal_distance_px = within(d.principal_distance_px);
        let greatest_tilt_deg = within(d.greatest_tilt_deg);
        let [shift_px, edge_px, strain_px] = [d.shift_px, d.edge_px, d.strain_px].map(within);
        let [columns, rows] = IMAGE_SIZE_PX.map(f64::from);
        let height_m = gsd_m * principal_distance_px;
        let camera = CameraSettings {
            image_size_px: IMAGE_SIZE_PX,
            principal_distance_px,
            // some pixels beside the middle, so that a confusion of the two shows
            principal_point_px: [columns / 2.0 + 3.4, rows / 2.0 - 2.7],
            ..CameraSettings::default()
        };
        let control = ControlSettings {
            share,
            sigma_m: SIGMA_CORNER_PX * gsd_m,
            share_outdated,
            share_gone,
            sigma_shift_m: shift_px * gsd_m,
            sigma_edge_m: edge_px * gsd_m,
            sigma_strain_m: strain_px * gsd_m,
            strain_length_m: STRAIN_LENGTH * height_m,
            share_missing,
        };
        let flight = FlightSettings {
            height_m,
            greatest_tilt_deg,
            aim_spread_m,
            sigma_tilt_deg,
            share_wild: d.wild,
            ..FlightSettings::default()
        };
        let photograph = PhotographSettings {
            rays_per_pixel: RAYS_PER_PIXEL,
            blur_sigma_px,
            noise_grey,
            clearness,
            ..PhotographSettings::default()
        };
        let town = TownSettings {
            half_length_m: HALF_LENGTH_M,
            street_rows: STREET_ROWS,
            sun_elevation_deg: d.sun_elevation_deg,
            trees,
            foliage,
            share_alike,
            ..TownSettings::default()
        };
        SceneSettings { town, camera, flight, control, photograph }
    }
}

/// What the survey states: half a pixel, as the benchmark's 4 cm are at its larger scales.
const SIGMA_CORNER_PX: f64 = 0.5;
/// In flying heights: in the benchmark the strain falls to 1/e over 0.22 principal distances.
const STRAIN_LENGTH: f64 = 0.22;
/// Branches, conifers, ivy.
const LEAVES_IN_WINTER: f64 = 0.3;
/// The town is larger than the frame of 290 to 350 m: images that look at its middle have control in all corners, as a
/// survey department sets it up, the others on one side.
const HALF_LENGTH_M: f64 = 210.0;
/// 78 m apart.
const STREET_ROWS: u32 = 5;

#[cfg(test)]
mod tests {
    use super::*;

    /// Least, mean and largest of a value over many seeds.
    fn drawn(mixture: Mixture, value: impl Fn(&SceneSettings) -> f64) -> [f64; 3] {
        let values: Vec<f64> = (0..4000).map(|seed| value(&mixture.settings(seed))).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        [values.iter().copied().fold(f64::MAX, f64::min), mean, values.iter().copied().fold(f64::MIN, f64::max)]
    }

    /// A mean of 4000 even deviates is off by 0.0046 of their range, and the ends are nearly reached.
    fn assert_even(drawn: [f64; 3], [low, high]: [f64; 2]) {
        let (range, [least, mean, largest]) = (high - low, drawn);
        assert!(least >= low && least < low + 0.01 * range, "{drawn:?} of {low} to {high}");
        assert!(largest <= high && largest > high - 0.01 * range, "{drawn:?} of {low} to {high}");
        assert!((mean - (low + high) / 2.0).abs() < 0.02 * range, "{drawn:?} of {low} to {high}");
    }

    #[test]
    fn settings_are_drawn_evenly_from_the_stated_ranges() {
        for mixture in [Mixture::Good, Mixture::Poor, Mixture::Wide] {
            let d = mixture.distributions();
            assert_even(drawn(mixture, |s| s.control.share), d.control);
            assert_even(drawn(mixture, |s| s.control.share_outdated), d.outdated);
            assert_even(drawn(mixture, |s| s.control.share_gone), d.gone);
            assert_even(drawn(mixture, |s| s.control.share_missing), d.missing_edges);
            assert_even(drawn(mixture, |s| s.flight.aim_spread_m), d.aim_spread_m);
            assert_even(drawn(mixture, |s| s.flight.sigma_tilt_deg), d.sigma_tilt_deg);
            assert_even(drawn(mixture, |s| s.photograph.blur_sigma_px), d.blur_px);
            assert_even(drawn(mixture, |s| s.photograph.noise_grey), d.noise_grey);
            assert_even(drawn(mixture, |s| s.photograph.clearness), d.clearness);
            assert_even(drawn(mixture, |s| s.town.trees), d.trees);
            assert_even(drawn(mixture, |s| s.town.share_alike), d.share_alike);
            assert_even(drawn(mixture, |s| s.flight.height_m / s.camera.principal_distance_px), d.gsd_m);
            let [_, winters, _] = drawn(mixture, |s| f64::from(s.town.foliage < 1.0));
            assert!((winters - d.winter).abs() < 4.0 * (0.25_f64 / 4000.0).sqrt(), "{winters}");
        }
    }

    #[test]
    fn draws_do_not_depend_on_one_another() {
        let pairs = (0..4000).map(|seed| Mixture::Good.settings(seed));
        let centred = |value: f64, [low, high]: [f64; 2]| (value - (low + high) / 2.0) / (high - low);
        let product = |s: SceneSettings| {
            centred(s.photograph.blur_sigma_px, GOOD.blur_px) * centred(s.control.share, GOOD.control)
        };
        // the product of two even deviates of range 1 has standard deviation 1/12
        let mean = pairs.map(product).sum::<f64>() / 4000.0;
        assert!(mean.abs() < 4.0 / 12.0 / 4000_f64.sqrt(), "{mean}");
    }

    #[test]
    fn errors_of_control_are_the_stated_pixels() {
        let settings = Mixture::Good.settings(3);
        let gsd_m = settings.flight.height_m / settings.camera.principal_distance_px;
        assert!((settings.control.sigma_shift_m / gsd_m - GOOD.shift_px[0]).abs() < 1e-12);
        assert!((settings.control.sigma_edge_m / gsd_m - GOOD.edge_px[0]).abs() < 1e-12);
    }

    #[test]
    fn a_good_image_has_enough_control_and_a_poor_one_less() {
        let in_view = |mixture: Mixture| {
            let counts = (1..=30).map(|seed| Scene::draw(seed, &mixture.settings(seed)).unwrap().in_view().count());
            let mut counts: Vec<usize> = counts.collect();
            counts.sort_unstable();
            counts
        };
        let (good, poor) = (in_view(Mixture::Good), in_view(Mixture::Poor));
        assert!(good[3] >= 8, "{good:?}");
        assert!(poor[15] < good[15], "{poor:?}");
        assert!(poor[27] >= 8, "{poor:?}");
    }
}
