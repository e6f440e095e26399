//! Is a mixture like real photographs? The same statistics, taken of both under the true orientation.
//!
//! Lengths are in pixels of the file. Where the statistics depend on the resolution at which lines are looked for
//! (soft photographs are searched at half their resolution), they are in *cells* of that resolution.

use std::fmt::Write as _;

use nalgebra::{Matrix2, Vector2};

use crate::features::{Picture, PictureError, PixelRect};
use crate::geometry::{Camera, ExteriorOrientation, Segment2};
use crate::orientation::ControlPoint;
use crate::orientation::extract::{Extraction, ObservedSegment};
use crate::orientation::locate::{Clustering, shift_map};
use crate::orientation::matching::{Match, Nearness, matches};
use crate::orientation::predict::{edges_on_frame_px, on_frame};

/// One image with its truth.
pub struct Known<'a> {
    /// The picture.
    pub picture: &'a dyn Picture,
    /// Its camera.
    pub camera: &'a Camera,
    /// Where the camera was.
    pub truth: ExteriorOrientation,
    /// Where it was thought to be.
    pub approximate: ExteriorOrientation,
    /// The control, in the same frame.
    pub control: &'a [ControlPoint],
}

/// What was measured, image by image.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Likeness {
    /// Images.
    pub images: usize,
    /// Model edges on the frames.
    pub edges: usize,
    /// Those of them with segments near their true place.
    pub seen: usize,
    /// Mean number of those with segments near places about [`ASIDE_PX`] beside it.
    pub seen_by_chance: f64,
    /// Control points in view, image by image.
    pub in_view: Vec<f64>,
    /// Segments in a window of [`WINDOW_CELLS`] about each control point.
    pub segments: Vec<f64>,
    /// Standard deviation of the blur across matched segments, in cells.
    pub blur_cells: Vec<f64>,
    /// The shift between each building's model and its edges in the image.
    pub shifts_px: Vec<Vector2<f64>>,
    /// Distances of single edges from their model that remain after it.
    pub edge_offsets_px: Vec<f64>,
    /// Distance of each control point from where it was predicted.
    pub prediction_px: Vec<f64>,
}

/// A model edge is seen if segments cover at least this share of it...
const COVERED: f64 = 1.0 / 3.0;
/// ...no farther from it than buildings and edges are shifted (1 to 3 px).
const NEAR: Nearness = Nearness { distance_px: 4.0, direction_tolerance_rad: 0.07 };
/// Chance is measured at places so far away.
const ASIDE_PX: f64 = 100.0;
const ASIDE: [[f64; 2]; 4] = [[ASIDE_PX, 0.0], [-ASIDE_PX, 0.0], [0.0, ASIDE_PX], [0.0, -ASIDE_PX]];
/// The paper's windows.
const WINDOW_CELLS: f64 = 250.0;
/// A building's shift is looked for so far.
const LARGEST_SHIFT_PX: f64 = 16.0;
/// About it, edges may be off by so much.
const ABOUT_SHIFT: Nearness = Nearness { distance_px: 3.0, direction_tolerance_rad: 0.06 };
/// A shift is taken from no fewer edges.
const LEAST_EDGES: usize = 4;
/// Profiles reach so far to either side of a segment, and segments must be as long as this for a profile.
const PROFILE_CELLS: i32 = 7;
const SHORTEST_PROFILED_CELLS: f64 = 15.0;
/// Steps of a profile in a cell.
const PROFILE_STEPS: i32 = 4;
/// Weaker edges say more about texture than about blur: least mean gradient, grey values per cell.
const LEAST_STEP_GREY: f64 = 25.0;

/// Measures one image.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read.
pub fn measure(image: &Known) -> Result<Likeness, PictureError> {
    let Known { camera, truth, .. } = image;
    let mut found = Likeness { images: 1, ..Likeness::default() };
    let c = camera.principal_distance_px;
    let in_view: Vec<(&ControlPoint, Vector2<f64>)> = image
        .control
        .iter()
        .filter_map(|point| Some((point, truth.reduced_px(c, point.reference_m)?)))
        .filter(|(_, at)| on_frame(camera, *at, 0.0))
        .collect();
    found.in_view.push(in_view.len() as f64);
    let edges: Vec<Vec<Option<Segment2>>> =
        in_view.iter().map(|(point, _)| edges_on_frame_px(camera, truth, point)).collect();
    let lengths: Vec<f64> = edges.iter().flatten().flatten().map(Segment2::length).collect();
    let mut extraction = Extraction::new(image.picture, camera, median(&lengths));
    let [width, height] = image.picture.size_px().map(f64::from);
    extraction.cover(Vector2::zeros(), Vector2::new(width, height))?;
    let observed = extraction.segments();
    // the fine level's cells: the least reduction at which segments were found
    let cell_px = f64::from(extraction.fine_reduction());
    for ((point, at), edges) in in_view.iter().zip(&edges) {
        let seen = |aside: Vector2<f64>| seen(edges, aside, observed);
        found.edges += edges.iter().flatten().count();
        found.seen += seen(Vector2::zeros());
        found.seen_by_chance += ASIDE.iter().map(|a| seen(Vector2::from(*a)) as f64).sum::<f64>() / ASIDE.len() as f64;
        let in_window = |s: &&ObservedSegment| (s.segment_px.midpoint() - at).amax() < WINDOW_CELLS / 2.0 * cell_px;
        found.segments.push(observed.iter().filter(|s| !s.coarse).filter(in_window).count() as f64);
        if let Some(predicted) = image.approximate.reduced_px(c, point.reference_m) {
            found.prediction_px.push((predicted - at).norm());
        }
        if let Some((shift, offsets, matched)) = shift_of(edges, *at, observed) {
            found.shifts_px.push(shift);
            found.edge_offsets_px.extend(offsets);
            for m in matched {
                found.blur_cells.extend(blur(image.picture, &observed[m.segment], cell_px)?);
            }
        }
    }
    Ok(found)
}

/// The number of edges that segments cover where they lie when moved aside.
fn seen(edges: &[Option<Segment2>], aside: Vector2<f64>, observed: &[ObservedSegment]) -> usize {
    let moved: Vec<_> = edges.iter().map(|e| e.as_ref().map(|e| moved(e, aside))).collect();
    let mut covered = vec![0.0; edges.len()];
    for m in matches(&moved, observed.iter().enumerate(), &NEAR) {
        let [from, to] = m.at.map(|at| at.clamp(0.0, 1.0));
        covered[m.edge] += (to - from).abs();
    }
    covered.iter().filter(|share| **share >= COVERED).count()
}

fn moved(edge: &Segment2, by: Vector2<f64>) -> Segment2 {
    Segment2 { start: edge.start + by, end: edge.end + by }
}

/// The shift that lays a building's model on its edges in the image, what is left of each matched segment, and the
/// matches; `None` where too little is seen.
fn shift_of(
    edges: &[Option<Segment2>],
    reference: Vector2<f64>,
    observed: &[ObservedSegment],
) -> Option<(Vector2<f64>, Vec<f64>, Vec<Match>)> {
    let present: Vec<Segment2> = edges.iter().flatten().copied().collect();
    let clustering = Clustering {
        half_width_px: LARGEST_SHIFT_PX,
        cell_px: 2.0,
        direction_tolerance_rad: ABOUT_SHIFT.direction_tolerance_rad,
        fine: true,
    };
    let peaks = shift_map(&present, reference, observed, &clustering).peaks(1);
    let mut shift = peaks.first()?.at_px - reference;
    let about: Vec<_> = edges.iter().map(|e| e.as_ref().map(|e| moved(e, shift))).collect();
    let matched = matches(&about, observed.iter().enumerate(), &ABOUT_SHIFT);
    let mut different: Vec<usize> = matched.iter().map(|m| m.edge).collect();
    different.sort_unstable();
    different.dedup();
    if different.len() < LEAST_EDGES {
        return None;
    }
    // distances of the middles of the segments from the unshifted edges, weighted by length, against the shift's
    // component across the edge
    let equations: Vec<(Vector2<f64>, f64, f64)> = matched
        .iter()
        .filter_map(|m| {
            let (edge, segment) = (edges[m.edge]?, &observed[m.segment]);
            let across = edge.normal();
            Some((across, across.dot(&(segment.segment_px.midpoint() - edge.start)), segment.length_px))
        })
        .collect();
    const STEPS: usize = 6;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (across, distance, length) in &equations {
            let off_px = distance - across.dot(&shift);
            let weight = length / (1.0 + off_px * off_px);
            normal += weight * across * across.transpose();
            right += weight * across * *distance;
        }
        // edges of one direction leave the shift along them open
        let eigen = normal.symmetric_eigenvalues();
        if eigen.min() < 0.1 * eigen.max() {
            return None;
        }
        shift = normal.try_inverse()? * right;
    }
    let offsets = equations.iter().map(|(across, distance, _)| distance - across.dot(&shift)).collect();
    Some((shift, offsets, matched))
}

/// Standard deviation of the blur across a segment, in cells, from the mean profile of the grey values along it:
/// that of the lobe of its derivative about the middle. `None` for weak edges, and for those beside others.
fn blur(picture: &dyn Picture, segment: &ObservedSegment, cell_px: f64) -> Result<Option<f64>, PictureError> {
    let Segment2 { start, end } = segment.file_px;
    if segment.coarse || (end - start).norm() < SHORTEST_PROFILED_CELLS * cell_px {
        return Ok(None);
    }
    let margin_px = (f64::from(PROFILE_CELLS) + 2.0) * cell_px;
    let (low, high) = (start.inf(&end).add_scalar(-margin_px), start.sup(&end).add_scalar(margin_px));
    let [width, height] = picture.size_px().map(f64::from);
    if low.min() < 0.0 || high.x >= width || high.y >= height {
        return Ok(None);
    }
    let reduction = cell_px as u32;
    let corner = [low.x, low.y].map(|v| v as u32 / reduction * reduction);
    let rect = PixelRect {
        x: corner[0],
        y: corner[1],
        width: (high.x as u32 - corner[0]).next_multiple_of(reduction),
        height: (high.y as u32 - corner[1]).next_multiple_of(reduction),
    };
    let window = picture.window(rect, reduction)?;
    let origin = Vector2::new(f64::from(rect.x), f64::from(rect.y));
    let in_cells = |p: Vector2<f64>| (p - origin) / cell_px;
    let axis = Segment2 { start: in_cells(start), end: in_cells(end) };
    let grey = |at: Vector2<f64>| -> Option<f64> {
        let corner = at.add_scalar(-0.5);
        let (column, row) = (corner.x.floor(), corner.y.floor());
        let (right, down) = (corner.x - column, corner.y - row);
        let cell = |dx: usize, dy: usize| {
            let (x, y) = (column as usize + dx, row as usize + dy);
            (x < window.width).then(|| window.grey.get(y * window.width + x).copied().map(f64::from)).flatten()
        };
        let line = |dy| Some(cell(0, dy)? * (1.0 - right) + cell(1, dy)? * right);
        Some(line(0)? * (1.0 - down) + line(1)? * down)
    };
    let count = axis.length() as i32;
    let mean_at = |step: i32| -> Option<f64> {
        let aside = axis.normal() * (f64::from(step) / f64::from(PROFILE_STEPS));
        let along =
            |k: i32| axis.start + (axis.end - axis.start) * (0.1 + 0.8 * (f64::from(k) + 0.5) / f64::from(count));
        let sum = (0..count).map(|k| grey(along(k) + aside)).sum::<Option<f64>>()?;
        Some(sum / f64::from(count))
    };
    let reach = PROFILE_CELLS * PROFILE_STEPS;
    let profile: Option<Vec<f64>> = (-reach..=reach).map(mean_at).collect();
    Ok(profile.and_then(|profile| lobe_sigma(&profile)))
}

/// The standard deviation of the derivative's lobe about the middle of a profile, in cells.
fn lobe_sigma(profile: &[f64]) -> Option<f64> {
    let slope: Vec<f64> = profile.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = slope.len() / 2;
    let near = 2 * PROFILE_STEPS as usize;
    let peak = (middle - near..=middle + near).max_by(|a, b| slope[*a].abs().total_cmp(&slope[*b].abs()))?;
    let sign = slope[peak].signum();
    // the lobe ends where the slope has fallen below a tenth of its peak
    let floor = 0.1 * slope[peak].abs();
    let outside = |&k: &usize| slope[k] * sign < floor;
    let (first, last) = ((0..peak).rev().find(outside)? + 1, (peak..slope.len()).find(outside)?);
    let lobe = || (first..last).map(|k| (k as f64, slope[k] * sign));
    let step_grey: f64 = lobe().map(|(_, s)| s).sum();
    if step_grey < LEAST_STEP_GREY {
        return None;
    }
    let mean = lobe().map(|(k, s)| k * s).sum::<f64>() / step_grey;
    let variance = lobe().map(|(k, s)| (k - mean).powi(2) * s).sum::<f64>() / step_grey;
    Some((variance / TRUNCATED).sqrt() / f64::from(PROFILE_STEPS))
}

/// The variance of a normal curve that is cut where it has fallen to a tenth, at 2.146 sigma:
/// 1 - 2 * 2.146 * pdf(2.146) / (2 cdf(2.146) - 1).
const TRUNCATED: f64 = 0.823;

impl Likeness {
    /// Takes in what was measured in other images.
    pub fn add(&mut self, other: Self) {
        self.images += other.images;
        self.edges += other.edges;
        self.seen += other.seen;
        self.seen_by_chance += other.seen_by_chance;
        self.in_view.extend(other.in_view);
        self.segments.extend(other.segments);
        self.blur_cells.extend(other.blur_cells);
        self.shifts_px.extend(other.shifts_px);
        self.edge_offsets_px.extend(other.edge_offsets_px);
        self.prediction_px.extend(other.prediction_px);
    }

    fn cells(&self) -> Vec<(&'static str, String)> {
        let share = |count: f64| format!("{:.1} %", 100.0 * count / self.edges.max(1) as f64);
        let spread = |values: &[f64], digits: usize| {
            format!(
                "{:.digits$} ({:.digits$} to {:.digits$})",
                median(values),
                quantile(values, 0.1),
                quantile(values, 0.9)
            )
        };
        let components: Vec<f64> = self.shifts_px.iter().flat_map(|s| [s.x, s.y]).collect();
        let lengths: Vec<f64> = self.shifts_px.iter().map(|s| s.norm()).collect();
        let mean = self.shifts_px.iter().sum::<Vector2<f64>>() / self.shifts_px.len().max(1) as f64;
        vec![
            ("images", self.images.to_string()),
            ("control points in view of an image", spread(&self.in_view, 0)),
            ("model edges with a segment near their true place", share(self.seen as f64)),
            ("the same by chance, 100 px beside", share(self.seen_by_chance)),
            ("segments in a window of 250 cells", spread(&self.segments, 0)),
            ("blur across edges, sigma in cells", spread(&self.blur_cells, 2)),
            ("shifts of whole buildings, px", spread(&lengths, 2)),
            ("shifts: sigma of a coordinate, from quartiles, px", format!("{:.2}", quartile_sigma(&components))),
            ("shifts: mean x and y, px", format!("{:.2}, {:.2}", mean.x, mean.y)),
            (
                "single edges beside it: sigma, from quartiles, px",
                format!("{:.2}", quartile_sigma(&self.edge_offsets_px)),
            ),
            ("errors of prediction, px", spread(&self.prediction_px, 0)),
        ]
    }
}

/// Columns side by side, in Markdown; medians with the range of the middle 80 % in brackets.
#[must_use]
pub fn side_by_side(columns: &[(String, Likeness)]) -> String {
    let mut text = String::from("|");
    let mut rule = String::from("\n|---|");
    for (name, _) in columns {
        let _ = write!(text, " | {name}");
        rule.push_str("---|");
    }
    text.push_str(" |");
    text.push_str(&rule);
    let cells: Vec<_> = columns.iter().map(|(_, likeness)| likeness.cells()).collect();
    for line in 0..cells.first().map_or(0, Vec::len) {
        let _ = write!(text, "\n| {}", cells[0][line].0);
        for column in &cells {
            let _ = write!(text, " | {}", column[line].1);
        }
        text.push_str(" |");
    }
    text
}

fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((share * (sorted.len().max(1) - 1) as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

/// The standard deviation of a normal distribution with these quartiles.
fn quartile_sigma(values: &[f64]) -> f64 {
    (quantile(values, 0.75) - quantile(values, 0.25)) / 1.349
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Segment3;
    use crate::simulation::{ControlSettings, PhotographSettings, Scene, SceneSettings, TownSettings};
    use nalgebra::Vector3;

    /// A summer's noon over sound control, measured without error.
    fn clean(blur_sigma_px: f64) -> Scene {
        let mut settings = SceneSettings {
            control: ControlSettings { share: 1.0, sigma_m: 0.0, share_outdated: 0.0, ..ControlSettings::default() },
            photograph: PhotographSettings { blur_sigma_px, noise_grey: 1.0, ..PhotographSettings::default() },
            town: TownSettings { sun_elevation_deg: [54.0, 55.0], trees: 0.3, ..TownSettings::default() },
            ..SceneSettings::default()
        };
        settings.camera.image_size_px = [1200, 900];
        settings.camera.principal_distance_px = 1040.0;
        settings.camera.principal_point_px = [600.0, 450.0];
        settings.flight.height_m = 0.16 * 1040.0;
        Scene::draw(6, &settings).unwrap()
    }

    fn measured(scene: &Scene, control: &[ControlPoint]) -> Likeness {
        measure(&Known {
            picture: &scene.picture(),
            camera: &scene.camera,
            truth: scene.true_orientation,
            approximate: scene.approximation.orientation,
            control,
        })
        .unwrap()
    }

    #[test]
    fn known_shifts_come_back() {
        let (scene, by_m) = (clean(1.0), Vector3::new(0.35, -0.25, 0.0));
        let moved = |point: &ControlPoint| ControlPoint {
            reference_m: point.reference_m + by_m,
            edges_m: point.edges_m.iter().map(|e| Segment3 { start: e.start + by_m, end: e.end + by_m }).collect(),
            ..point.clone()
        };
        let control: Vec<ControlPoint> = scene.control_points().iter().map(moved).collect();
        let likeness = measured(&scene, &control);
        // the image is where the model was before
        let (c, centre) = (scene.camera.principal_distance_px, scene.town.terrain.point_m(scene.town.centre_m));
        let pixel = |point| scene.true_orientation.reduced_px(c, point).unwrap();
        let expected = pixel(centre) - pixel(centre + by_m);
        assert!(likeness.shifts_px.len() >= 10, "{}", likeness.shifts_px.len());
        let median = |axis: usize| median(&likeness.shifts_px.iter().map(|s| s[axis]).collect::<Vec<f64>>());
        assert!((median(0) - expected.x).abs() < 0.15 && (median(1) - expected.y).abs() < 0.15, "{expected}");
        assert!(quartile_sigma(&likeness.edge_offsets_px) < 0.3);
    }

    #[test]
    fn edges_are_seen_where_they_are_and_seldom_beside() {
        let scene = clean(1.0);
        let likeness = measured(&scene, &scene.control_points());
        let share = |count: f64| count / likeness.edges as f64;
        assert!(share(likeness.seen as f64) > 0.6, "{}", share(likeness.seen as f64));
        assert!(share(likeness.seen_by_chance) < 0.15, "{}", share(likeness.seen_by_chance));
        let in_view = scene.in_view().count();
        assert_eq!((likeness.in_view.as_slice(), likeness.prediction_px.len()), ([in_view as f64].as_slice(), in_view));
    }

    #[test]
    fn blur_is_that_of_the_lens_and_of_sampling() {
        for lens_px in [1.2_f64, 2.0] {
            let scene = clean(lens_px);
            let likeness = measured(&scene, &scene.control_points());
            assert!(likeness.blur_cells.len() >= 20, "{}", likeness.blur_cells.len());
            // edges of fifty pixels are looked for in cells of two
            let lens_cells = lens_px / 2.0;
            // the cell's own square, the interpolation between cells, and the step of the profile
            let sampling = 1.0 / 12.0 + 1.0 / 6.0 + 1.0 / 12.0 / f64::from(PROFILE_STEPS).powi(2);
            let expected = (lens_cells * lens_cells + sampling).sqrt();
            let found = median(&likeness.blur_cells);
            assert!((found / expected - 1.0).abs() < 0.15, "{found} for {expected}");
        }
    }

    #[test]
    fn the_lobe_of_a_blurred_step_has_its_sigma() {
        let sigma_cells = 1.6;
        let reach = PROFILE_CELLS * PROFILE_STEPS;
        // a step of 100 grey values with a normal derivative, summed up
        let slope = |k: i32| (-0.5 * (f64::from(k) / f64::from(PROFILE_STEPS) / sigma_cells).powi(2)).exp();
        let total: f64 = (-200..200).map(slope).sum();
        let profile: Vec<f64> =
            (-reach..=reach).map(|end| (-200..end).map(slope).sum::<f64>() * 100.0 / total).collect();
        let found = lobe_sigma(&profile).unwrap();
        assert!((found / sigma_cells - 1.0).abs() < 0.03, "{found}");
        assert_eq!(lobe_sigma(&vec![50.0; profile.len()]), None);
    }
}
