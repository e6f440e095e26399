//! Simulated edges, whose lines are known, and `lsdetect` for comparison.

use super::*;
use crate::estimation::simulated::Draws;

/// A step edge: its line, how it is blurred, and what disturbs it.
#[derive(Debug, Clone, Copy)]
struct Step {
    through: Vector2<f64>,
    /// Its direction, the brighter side on the left as seen with y downwards.
    angle_rad: f64,
    contrast: f64,
    blur_px: f64,
    noise: f64,
}

impl Step {
    /// The distance of a point from the line, positive on the brighter side.
    fn towards_the_light(&self, point: Vector2<f64>) -> f64 {
        let along = Vector2::new(self.angle_rad.cos(), self.angle_rad.sin());
        Vector2::new(along.y, -along.x).dot(&(point - self.through))
    }

    fn grey(&self, x: f64, y: f64) -> f64 {
        let t = self.towards_the_light(Vector2::new(x, y)) / (self.blur_px * std::f64::consts::SQRT_2);
        let share = if t.abs() > 4.0 { t.signum() } else { libm::erf(t) };
        128.0 + 0.5 * self.contrast * share
    }

    /// The edge on `size` x `size` pixels, each the mean of its area.
    fn photograph(&self, size: usize, draws: &mut Draws) -> GreyWindow {
        const PARTS: i32 = 4;
        let parts = || (0..PARTS).map(|k| (f64::from(k) + 0.5) / f64::from(PARTS));
        let mut pixel = |index: usize| {
            let (column, row) = ((index % size) as f64, (index / size) as f64);
            let sum: f64 =
                parts().flat_map(|u| parts().map(move |v| (u, v))).map(|(u, v)| self.grey(column + u, row + v)).sum();
            (sum / f64::from(PARTS * PARTS) + self.noise * draws.normal()) as f32
        };
        window(size, size, (0..size * size).map(&mut pixel).collect())
    }
}

fn window(width: usize, height: usize, grey: Vec<f32>) -> GreyWindow {
    GreyWindow { origin_px: [0, 0], reduction: 1, width, height, grey }
}

/// The distances of a segment's ends from the line of a step edge.
fn errors(step: &Step, found: &LineSegment) -> Vector2<f64> {
    Vector2::new(step.towards_the_light(found.segment.start), step.towards_the_light(found.segment.end))
}

fn step_edge(draws: &mut Draws, size: usize, angle_rad: f64, contrast: f64, noise: f64) -> Step {
    let middle = size as f64 / 2.0;
    let through = Vector2::new(middle + draws.even(-1.0, 1.0), middle + draws.even(-1.0, 1.0));
    Step { through, angle_rad, contrast, blur_px: draws.even(0.8, 1.2), noise }
}

#[test]
fn the_claimed_precision_is_the_true_one() {
    // short, middling and long edges, weak to strong
    for (size, seed) in [(16, 1), (32, 2), (64, 3)] {
        let mut draws = Draws::new(seed);
        let (mut squares, mut errors_squared, mut claimed, mut pieces) = (0.0, 0.0, 0.0, 0.0);
        for run in 0..250 {
            let noise = draws.even(2.0, 4.0);
            let contrast = noise * draws.even(7.5, 25.0);
            // every fifth along the rows, where sampling is at its worst
            let angle = if run % 5 == 0 { 0.0 } else { draws.even(0.0, std::f64::consts::TAU) };
            let step = step_edge(&mut draws, size, angle, contrast, noise);
            for found in line_segments(&step.photograph(size, &mut draws), &Detection::default()) {
                let error = errors(&step, &found);
                if error.amax() < 3.0 {
                    squares += error.dot(&(found.covariance_across.try_inverse().unwrap() * error));
                    errors_squared += error.norm_squared();
                    claimed += found.covariance_across.trace();
                    pieces += 1.0;
                }
            }
        }
        assert!(pieces >= 245.0, "only {pieces} segments in 250 windows of {size} px");
        let (normalised, ratio) = (squares / pieces, (errors_squared / claimed).sqrt());
        assert!((1.6..2.6).contains(&normalised), "mean of the normalised squares {normalised}, {size} px");
        assert!((0.7..1.2).contains(&ratio), "true over claimed standard deviation {ratio}, {size} px");
    }
}

#[test]
fn without_noise_sampling_stays_within_its_allowance() {
    let mut draws = Draws::new(4);
    for degrees in 0..90 {
        let step = step_edge(&mut draws, 48, f64::from(degrees).to_radians(), 60.0, 0.0);
        let found = line_segments(&step.photograph(48, &mut draws), &Detection::default());
        assert_eq!(found.len(), 1, "{degrees} degrees");
        let error = errors(&step, &found[0]);
        assert!(error.amax() < 0.06, "{degrees} degrees: {error}");
        let normalised = error.dot(&(found[0].covariance_across.try_inverse().unwrap() * error));
        assert!(normalised < 12.0, "{degrees} degrees: normalised square {normalised}");
    }
}

#[test]
fn weak_edges_of_all_directions_are_found_with_the_bright_side_on_the_left() {
    let mut draws = Draws::new(5);
    for degrees in (0..360).step_by(5) {
        let step = step_edge(&mut draws, 48, f64::from(degrees).to_radians(), 15.0, 2.0);
        let found = line_segments(&step.photograph(48, &mut draws), &Detection::default());
        let longest = found.iter().max_by(|a, b| a.segment.length().total_cmp(&b.segment.length())).unwrap();
        assert!(longest.segment.length() > 20.0, "{degrees} degrees: {} px", longest.segment.length());
        assert!(errors(&step, longest).amax() < 1.0, "{degrees} degrees");
        let bright = longest.segment.midpoint() - 5.0 * longest.segment.normal();
        assert!(step.towards_the_light(bright) > 4.0, "{degrees} degrees: the bright side is on the right");
        assert!((2.0..7.0).contains(&longest.gradient), "{degrees} degrees: gradient {}", longest.gradient);
    }
}

#[test]
fn a_reduced_window_is_told_in_pixels_of_the_file() {
    let mut draws = Draws::new(6);
    let step = step_edge(&mut draws, 48, 0.4, 60.0, 2.0);
    let plain = step.photograph(48, &mut draws);
    let reduced = GreyWindow { origin_px: [1000, 400], reduction: 4, ..plain.clone() };
    let (here, there) = (line_segments(&plain, &Detection::default()), line_segments(&reduced, &Detection::default()));
    assert_eq!((here.len(), there.len()), (1, 1));
    let moved = |p: Vector2<f64>| Vector2::new(1000.0, 400.0) + 4.0 * p;
    assert!((there[0].segment.start - moved(here[0].segment.start)).norm() < 1e-9);
    assert!((there[0].segment.end - moved(here[0].segment.end)).norm() < 1e-9);
    assert!((there[0].covariance_across - 16.0 * here[0].covariance_across).norm() < 1e-12);
    assert!((there[0].gradient - here[0].gradient / 4.0).abs() < 1e-9);
    assert_eq!(there[0].reduction, 4);
}

#[test]
fn noise_alone_holds_no_more_than_a_handful_of_lines() {
    let mut draws = Draws::new(7);
    let grey = (0..300 * 300).map(|_| (120.0 + 3.0 * draws.normal()) as f32).collect();
    let found = line_segments(&window(300, 300, grey), &Detection::default());
    assert!(found.len() <= 5, "{} segments", found.len());
}

#[test]
fn windows_without_room_or_contrast_hold_nothing() {
    let stripes = |width, height| window(width, height, (0..width * height).map(|k| (k % 2 * 200) as f32).collect());
    for (width, height) in [(0, 0), (1, 1), (4, 4), (4, 300), (300, 4), (5, 5), (1, 300)] {
        assert_eq!(line_segments(&stripes(width, height), &Detection::default()), []);
    }
    assert_eq!(line_segments(&window(64, 64, vec![77.0; 64 * 64]), &Detection::default()), []);
    assert_eq!(line_segments(&window(64, 64, vec![f32::NAN; 64 * 64]), &Detection::default()), []);
}

/// A roof with a ridge between a dark and a bright half.
struct Roof {
    middle: Vector2<f64>,
    along: Vector2<f64>,
    half: Vector2<f64>,
    greys: [f64; 2],
}

const GROUND: f64 = 90.0;

impl Roof {
    fn edges(&self) -> [Segment2; 5] {
        let (u, v) = (self.half.x * self.along, self.half.y * Vector2::new(-self.along.y, self.along.x));
        let edge = |a: Vector2<f64>, b: Vector2<f64>| Segment2 { start: self.middle + a, end: self.middle + b };
        [edge(u + v, u - v), edge(u - v, -u - v), edge(-u - v, -u + v), edge(-u + v, u + v), edge(u, -u)]
    }

    /// Grey above that of the ground, with soft rims.
    fn grey(&self, point: Vector2<f64>) -> f64 {
        let from = point - self.middle;
        let (u, v) = (self.along.dot(&from), self.along.x * from.y - self.along.y * from.x);
        let inside = |distance: f64| (0.5 + distance / 2.0).clamp(0.0, 1.0);
        let bright = inside(v);
        let grey = self.greys[0] * (1.0 - bright) + self.greys[1] * bright;
        (grey - GROUND) * inside(self.half.x - u.abs()) * inside(self.half.y - v.abs())
    }
}

/// Forty roofs in rows of eight.
fn roofs(draws: &mut Draws) -> Vec<Roof> {
    let roof = |k: u32| {
        let angle = draws.even(0.0, std::f64::consts::TAU);
        Roof {
            middle: Vector2::new(60.0 + 100.0 * f64::from(k % 8), 60.0 + 100.0 * f64::from(k / 8)),
            along: Vector2::new(angle.cos(), angle.sin()),
            half: Vector2::new(draws.even(20.0, 32.0), draws.even(15.0, 25.0)),
            greys: [draws.even(125.0, 150.0), draws.even(180.0, 220.0)],
        }
    };
    (0..40).map(roof).collect()
}

/// How much of a segment's length is covered by those of `others` that lie within 2 px and 2 degrees of it.
fn covered(segment: &Segment2, others: &[Segment2]) -> f64 {
    let (along, normal) = (segment.direction(), segment.normal());
    let least_cosine = 2.0_f64.to_radians().cos();
    let near = |other: &&Segment2| {
        other.direction().dot(&along).abs() > least_cosine
            && normal.dot(&(other.midpoint() - segment.midpoint())).abs() < 2.0
    };
    let overlap = |other: &Segment2| {
        let (a, b) = (along.dot(&(other.start - segment.start)), along.dot(&(other.end - segment.start)));
        (a.max(b).min(segment.length()) - a.min(b).max(0.0)).max(0.0)
    };
    others.iter().filter(near).map(overlap).sum::<f64>() / segment.length()
}

#[test]
fn roofs_are_found_as_well_as_by_lsd() {
    let mut draws = Draws::new(8);
    let roofs = roofs(&mut draws);
    let (width, height) = (820, 520);
    let pixel = |index: usize| {
        let point = Vector2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        let near = roofs.iter().filter(|r| (r.middle - point).norm() < 45.0);
        GROUND + near.map(|r| r.grey(point)).sum::<f64>() + 2.0 * draws.normal()
    };
    let grey: Vec<f64> = (0..width * height).map(pixel).collect();
    let lsd: Vec<Segment2> = lsdetect::detect(&grey, width, height, lsdetect::SCALE)
        .unwrap()
        .iter()
        .map(|s| Segment2 { start: Vector2::new(s.x1, s.y1), end: Vector2::new(s.x2, s.y2) })
        .filter(|s| s.length() > 20.0)
        .collect();
    let ours = window(width, height, grey.iter().map(|&g| g as f32).collect());
    let ours: Vec<Segment2> = line_segments(&ours, &Detection::default()).iter().map(|found| found.segment).collect();

    let missed: Vec<_> = lsd.iter().filter(|s| covered(s, &ours) < 0.5).collect();
    assert!(lsd.len() >= 180 && missed.is_empty(), "missed of {} by LSD: {missed:?}", lsd.len());
    let edges: Vec<Segment2> = roofs.iter().flat_map(Roof::edges).collect();
    let found = |segments: &[Segment2]| edges.iter().filter(|e| covered(e, segments) > 0.7).count();
    assert!(found(&ours) as f64 >= 0.9 * edges.len() as f64, "{} of {}", found(&ours), edges.len());
    // and what is found is there
    let invented = ours.iter().filter(|s| s.length() > 15.0 && covered(s, &edges) < 0.5).count();
    assert!(invented <= 4, "{invented} segments that are no edges");
}
