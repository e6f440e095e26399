//! F4: locating a control point by clustering, against NumPy.

use anyhow::Result;
use gable::geometry::Segment2;
use gable::orientation::extract::ObservedSegment;
use gable::orientation::locate::{Clustering, shift_map};
use nalgebra::{Matrix2, Vector2};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::measure::compare;
use super::peer::{Peers, write_array};
use super::table::Row;

const EDGES: usize = 30;
const SEGMENTS: usize = 150;
/// Cells along a side of the accumulator, less one.
const CELLS: f64 = 200.0;
const TOLERANCE_RAD: f64 = 8.0 * std::f64::consts::PI / 180.0;
/// Of the edges and of the other lines, so many run along one of two directions at right angles, as in a village.
const ALIGNED: f64 = 0.7;
const SHIFT: [f64; 2] = [31.0, -57.0];

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let edges: Vec<Segment2> = (0..EDGES).map(|_| line(&mut rng, 60.0, 20.0..90.0)).collect();
    let shift = Vector2::from(SHIFT);
    let seen = edges.iter().step_by(2).map(|e| Segment2 { start: e.start + shift, end: e.end + shift });
    let seen: Vec<Segment2> = seen.collect();
    let others = (seen.len()..SEGMENTS).map(|_| line(&mut rng, 150.0, 10.0..70.0));
    let segments: Vec<Segment2> = seen.iter().copied().chain(others).collect();

    let folder = tempfile::tempdir()?;
    let numbers = |lines: &[Segment2]| -> Vec<f64> {
        lines.iter().flat_map(|s| [s.start.x, s.start.y, s.end.x, s.end.y]).collect()
    };
    write_array(folder.path(), "edges", numbers(&edges))?;
    write_array(folder.path(), "segments", numbers(&segments))?;
    write_array(folder.path(), "parameters", [CELLS / 2.0, TOLERANCE_RAD])?;
    let observed: Vec<ObservedSegment> = segments
        .iter()
        .map(|segment| ObservedSegment {
            segment_px: *segment,
            direction: segment.direction(),
            length_px: segment.length(),
            covariance_across: Matrix2::identity(),
            coarse: false,
            file_px: *segment,
        })
        .collect();
    let clustering =
        Clustering { half_width_px: CELLS / 2.0, cell_px: 1.0, direction_tolerance_rad: TOLERANCE_RAD, fine: true };
    let mut peer = peers.start("clustering.py", folder.path())?;
    let compared =
        compare(&mut peer, "", || Ok(shift_map(&edges, Vector2::zeros(), &observed, &clustering).peaks(10)))?;
    let found = compared.made.first().map(|peak| peak.at_px);
    let off = found.map_or(f64::INFINITY, |at| (at - shift).norm());
    Ok(vec![Row {
        id: "F4",
        what: format!("clustering {EDGES} edges, {SEGMENTS} segments, A={CELLS} / NumPy"),
        peer_s: compared.peer_s,
        ours_s: compared.ours_s,
        gate: 0.04,
        moonshot: 0.01,
        as_good: off < 1.0,
        note: format!("shift {SHIFT:?}: NumPy finds {}, ours is off by {off:.2} cells", compared.told["shift"]),
    }])
}

/// A line whose middle is up to `far` from the reference point in x and y.
fn line(rng: &mut ChaCha8Rng, far: f64, length: std::ops::Range<f64>) -> Segment2 {
    let middle = Vector2::new(rng.random_range(-far..far), rng.random_range(-far..far));
    let angle: f64 = if rng.random_bool(ALIGNED) {
        0.3 + f64::from(rng.random_range(0..2)) * std::f64::consts::FRAC_PI_2 + rng.random_range(-0.05..0.05)
    } else {
        rng.random_range(0.0..std::f64::consts::PI)
    };
    let half = rng.random_range(length) / 2.0 * Vector2::new(angle.cos(), angle.sin());
    Segment2 { start: middle - half, end: middle + half }
}
