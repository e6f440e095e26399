//! F5 to F8: orientations from points and lines, against poselib and against trying everything.

use anyhow::{Context as _, Result};
use gable::estimation::consensus::Survey;
use gable::estimation::{Guarantee, PointObservation, Prior, largest_consistent, quadruples, resect};
use gable::geometry::{Brown, Camera, ExteriorOrientation, Segment2, Segment3, rotation};
use gable::orientation::ControlPoint;
use gable::orientation::adjust::{Building, Model};
use gable::orientation::extract::ObservedSegment;
use gable::orientation::matching::Match;
use nalgebra::{Matrix2, Matrix6, Vector2, Vector3, Vector6};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use super::measure::{Comparison, compare, median, timed};
use super::peer::{Peers, write_array};
use super::table::Row;

const PRINCIPAL_DISTANCE_PX: f64 = 5000.0;
const SIGMA_PX: f64 = 0.5;
/// Of the points 30 % are wrong by 15 to 75 px.
const WRONG: f64 = 0.3;
const TOLERANCE_PX: f64 = 10.0;
/// An orientation is right whose projection centre is: 1 % of the flying height.
const RIGHT_M: f64 = 4.0;
const SCENES: usize = 20;

fn flight() -> ExteriorOrientation {
    ExteriorOrientation {
        projection_centre_m: Vector3::new(30.0, -20.0, 400.0),
        camera_from_object: rotation::camera_from_object(0.06, -0.04, 1.1),
    }
}

/// Some 250 px beside the truth.
fn start() -> ExteriorOrientation {
    flight().moved(&Vector6::new(15.0, -20.0, 10.0, 0.03, -0.02, 0.05))
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random_range(0.0..1.0_f64)).ln()).sqrt();
    radius * rng.random_range(0.0..std::f64::consts::TAU).cos()
}

/// Points all over the frame on roofs up to 30 m high.
fn scene(rng: &mut ChaCha8Rng, count: usize) -> Option<Vec<PointObservation>> {
    let wrong = (WRONG * count as f64) as usize;
    let point = |index: usize| {
        let exact = Vector2::new(rng.random_range(-2900.0..2900.0), rng.random_range(-1900.0..1900.0));
        let object_m = flight().ground_point_m(PRINCIPAL_DISTANCE_PX, exact, rng.random_range(0.0..30.0))?;
        let mut image_px = exact + SIGMA_PX * Vector2::new(normal(rng), normal(rng));
        if index < wrong {
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            image_px += rng.random_range(15.0..75.0) * Vector2::new(angle.cos(), angle.sin());
        }
        Some(PointObservation { object_m, image_px, sigma_px: SIGMA_PX })
    };
    (0..count).map(point).collect()
}

fn scenes(seed: u64, scenes: usize, count: usize) -> Result<Vec<Vec<PointObservation>>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..scenes).map(|_| scene(&mut rng, count).context("a point of the scene")).collect()
}

/// The folder that the peer reads.
fn folder(scenes: &[Vec<PointObservation>]) -> Result<tempfile::TempDir> {
    let folder = tempfile::tempdir()?;
    let numbers =
        scenes.iter().flatten().flat_map(|p| [p.object_m.x, p.object_m.y, p.object_m.z, p.image_px.x, p.image_px.y]);
    write_array(folder.path(), "points", numbers)?;
    let count = scenes.first().map_or(0, Vec::len);
    write_array(folder.path(), "parameters", [PRINCIPAL_DISTANCE_PX, TOLERANCE_PX, count as f64])?;
    let (r, centre) = (*start().camera_from_object.matrix(), start().projection_centre_m);
    // computer vision's camera frame has y down and z forward
    let rows =
        (0..3).flat_map(|row| (0..3).map(move |column| if row == 0 { r[(0, column)] } else { -r[(row, column)] }));
    write_array(folder.path(), "start", rows.chain(centre.iter().copied()))?;
    Ok(folder)
}

fn survey(points: &[PointObservation]) -> Survey<'_> {
    Survey { points, prior: None, start: start(), principal_distance_px: PRINCIPAL_DISTANCE_PX }
}

fn is_right(centre_m: Vector3<f64>) -> bool {
    (centre_m - flight().projection_centre_m).norm() < RIGHT_M
}

fn centres(told: &Value) -> Vec<Vector3<f64>> {
    let number = |c: &Value, k: usize| c[k].as_f64().unwrap_or(f64::NAN);
    let all = told["centres"].as_array().map(Vec::as_slice).unwrap_or_default();
    all.iter().map(|c| Vector3::new(number(c, 0), number(c, 1), number(c, 2))).collect()
}

/// F5: all quadruples of 30 points, against poselib's refinement in a loop.
pub fn bench_all_quadruples(peers: &Peers) -> Result<Vec<Row>> {
    let (compared, as_good, note) = all_quadruples(peers, "quadruples", &scenes(5, 1, 30)?)?;
    let what = "all quadruples of 30 points / poselib.refine loop".to_owned();
    let Comparison { peer_s, ours_s, .. } = compared;
    Ok(vec![Row { id: "F5", what, peer_s, ours_s, gate: 0.2, moonshot: 0.025, as_good, note }])
}

/// F6: all quadruples of 20 points, against poselib's RANSAC.
pub fn bench_ransac(peers: &Peers) -> Result<Vec<Row>> {
    let (compared, as_good, note) = all_quadruples(peers, "ransac", &scenes(6, SCENES, 20)?)?;
    let what = "all quadruples of 20 points / poselib RANSAC".to_owned();
    let (peer_s, ours_s) = (compared.peer_s / SCENES as f64, compared.ours_s / SCENES as f64);
    Ok(vec![Row { id: "F6", what, peer_s, ours_s, gate: 12.0, moonshot: 1.5, as_good, note }])
}

/// The projection centres that were found, a scene each.
type Centres = Vec<Option<Vector3<f64>>>;

fn all_quadruples(
    peers: &Peers,
    method: &str,
    scenes: &[Vec<PointObservation>],
) -> Result<(Comparison<Centres>, bool, String)> {
    let folder = folder(scenes)?;
    let mut peer = peers.start_with("resection.py", folder.path(), &[method])?;
    let compared = compare(&mut peer, "", || {
        let found = scenes.iter().map(|points| {
            let found = quadruples(&survey(points), &|_| true, TOLERANCE_PX, usize::MAX, &|| false);
            found.map(|found| found.resection.orientation.projection_centre_m)
        });
        Ok(found.collect::<Centres>())
    })?;
    let theirs = centres(&compared.told).into_iter().filter(|centre| is_right(*centre)).count();
    let ours = compared.made.iter().flatten().filter(|centre| is_right(**centre)).count();
    let note = format!("right of {} scenes: poselib {theirs}, ours {ours}", scenes.len());
    Ok((compared, ours >= theirs, note))
}

/// F8: the largest consistent set of 20, against a resection of every subset (a sample of them, scaled to all).
pub fn bench_subsets(_: &Peers) -> Result<Vec<Row>> {
    const POINTS: usize = 20;
    const SAMPLE: usize = 2000;
    // so many must be right; all subsets are timed in the first of them only
    const RIGHT_SCENES: usize = 1000;
    // subsets of at least four
    let all = (1_u64 << POINTS) as f64 - 1.0 - 20.0 - 190.0 - 1140.0;
    let scenes = scenes(8, RIGHT_SCENES, POINTS)?;
    let mut rng = ChaCha8Rng::seed_from_u64(88);
    let (mut plain_s, mut ours_s) = (Vec::new(), Vec::new());
    let (mut right, mut complete) = (0, 0);
    for points in &scenes[..SCENES] {
        let subsets: Vec<Vec<PointObservation>> = (0..SAMPLE)
            .map(|_| points.iter().filter(|_| rng.random_bool(0.5)).copied().collect::<Vec<_>>())
            .filter(|subset: &Vec<_>| subset.len() >= 4)
            .collect();
        let (_, used) = timed(|| {
            let fits = subsets.iter().filter_map(|subset| resect(subset, None, &start(), PRINCIPAL_DISTANCE_PX));
            fits.map(|fit| fit.squares).fold(f64::INFINITY, f64::min)
        });
        plain_s.push(used / subsets.len() as f64 * all);
    }
    for points in &scenes {
        let (found, used) = timed(|| largest_consistent(&survey(points), 1.5, usize::MAX));
        ours_s.push(used);
        let found = found.context("no consistent set")?;
        let expected: Vec<usize> = ((WRONG * POINTS as f64) as usize..POINTS).collect();
        right += usize::from(found.inliers == expected);
        complete += usize::from(found.guarantee == Guarantee::Complete);
    }
    Ok(vec![Row {
        id: "F8",
        what: format!("largest consistent set of {POINTS} / all subsets"),
        peer_s: median(plain_s),
        ours_s: median(ours_s),
        gate: 0.05,
        moonshot: 0.005,
        as_good: right == RIGHT_SCENES && complete == RIGHT_SCENES,
        note: format!(
            "right of {RIGHT_SCENES} scenes: {right}, complete {complete}; the resections of all {all} subsets by a sample of {SAMPLE}"
        ),
    }])
}

/// F7: the robust adjustment with 600 line segments, against poselib's refinement with as many lines and 30 points.
pub fn bench_lines(peers: &Peers) -> Result<Vec<Row>> {
    const BUILDINGS: usize = 30;
    const EDGES: usize = 20;
    let camera = Camera::new([6000, 4000], PRINCIPAL_DISTANCE_PX, Vector2::new(3000.0, 2000.0), Brown::default())?;
    let scenes = scenes(7, 1, BUILDINGS)?;
    let points = &scenes[0];
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    let (mut control, mut observed, mut buildings, mut numbers) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (control_point, point) in points.iter().enumerate() {
        let (mut edges_m, mut matches) = (Vec::new(), Vec::new());
        for edge in 0..EDGES {
            let (middle, angle) = (point.object_m, rng.random_range(0.0..std::f64::consts::PI));
            let middle = middle + Vector3::from_fn(|_, _| rng.random_range(-8.0..8.0));
            let half = rng.random_range(2.0..6.0) * Vector3::new(angle.cos(), angle.sin(), 0.0);
            let ends_m = [middle - half, middle + half];
            // one of ten segments belongs to another line
            let off = if edge % 10 == 0 { rng.random_range(4.0..15.0) } else { 0.0 };
            let mut image = |end: Vector3<f64>| {
                let exact = flight().reduced_px(PRINCIPAL_DISTANCE_PX, end).context("in front of the camera")?;
                let noise = off + SIGMA_PX * normal(&mut rng);
                anyhow::Ok(exact + noise * Vector2::new(-angle.sin(), angle.cos()))
            };
            let segment_px = Segment2 { start: image(ends_m[0])?, end: image(ends_m[1])? };
            matches.push(Match { edge, segment: observed.len(), at: [0.0, 1.0] });
            edges_m.push(Segment3 { start: ends_m[0], end: ends_m[1] });
            observed.push(ObservedSegment {
                segment_px,
                direction: segment_px.direction(),
                length_px: segment_px.length(),
                covariance_across: Matrix2::identity() * SIGMA_PX.powi(2),
                coarse: false,
                file_px: segment_px,
            });
            numbers.extend(ends_m.iter().flat_map(|end| end.iter().copied().collect::<Vec<_>>()));
            numbers.extend([segment_px.start, segment_px.end].iter().flat_map(|end| [end.x, end.y]));
        }
        let name = control_point.to_string();
        control.push(ControlPoint {
            name,
            sigma_m: 0.02,
            reference_m: point.object_m,
            edges_m,
            edge_sigmas_m: Vec::new(),
            scene: None,
        });
        buildings.push(Building { control_point, matches, measured: None, shift_px: Vector2::zeros() });
    }
    let folder = folder(&scenes)?;
    write_array(folder.path(), "lines", numbers)?;
    let sigmas = Vector6::new(20.0, 20.0, 20.0, 0.1, 0.1, 0.1);
    let prior = Prior { orientation: start(), information: Matrix6::from_diagonal(&sigmas.map(|s: f64| s.powi(-2))) };
    let model = Model { camera: &camera, control: &control, observed: &observed, prior: &prior };
    let mut peer = peers.start_with("resection.py", folder.path(), &["lines"])?;
    let compared = compare(&mut peer, "", || {
        let adjusted = model.adjust(buildings.clone(), &start()).context("not determined")?;
        Ok(adjusted.orientation.projection_centre_m)
    })?;
    let away = |centre: &Vector3<f64>| (centre - flight().projection_centre_m).norm();
    let theirs = centres(&compared.told).first().map_or(f64::NAN, away);
    Ok(vec![Row {
        id: "F7",
        what: format!("robust lines, {} segments / poselib refine_pnpl", BUILDINGS * EDGES),
        peer_s: compared.peer_s,
        ours_s: compared.ours_s,
        gate: 0.5,
        moonshot: 0.15,
        as_good: true,
        note: format!(
            "projection centre off by: poselib {theirs:.3} m (with {BUILDINGS} points, 30 % of them wrong), ours {:.3} m \
             (lines only, a shift of each building, covariance)",
            away(&compared.made)
        ),
    }])
}
