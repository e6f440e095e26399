//! F1: line segments of 200 windows around control points of the real images, against OpenCV's LSD.

use anyhow::{Context as _, Result};
use gable::features::{Detection, GreyWindow, Picture as _, PixelRect, line_segments};
use gable::geometry::Segment2;
use gable::imagery::{ImageFile, Limits};
use gable::orientation::predict::edges_px;
use nalgebra::Vector2;
use serde_json::Value;

use super::dataset::{Dataset, Image};
use super::measure::compare;
use super::peer::{Peers, write_array};
use super::table::Row;

const SIDE: usize = 250;
const WINDOWS: usize = 200;
/// The photographs are soft: the pipeline extracts at half their resolution, and so the windows are cut there.
const REDUCTION: u32 = 2;
/// Lines shorter than this, in cells, are not counted.
const SHORTEST: f64 = 15.0;
/// A line shows an edge where it is no farther from it, in cells, and no more turned. (The reference orientation is
/// good to a pixel or two.)
const NEAR: f64 = 3.0;
const PARALLEL_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// And an edge is found if so much of it is shown.
const LEAST_SHARE: f64 = 0.5;

/// A window with the model edges in it, in cells of the window.
struct View {
    grey: GreyWindow,
    edges: Vec<Segment2>,
}

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let views = views(peers)?;
    let folder = tempfile::tempdir()?;
    let bytes: Vec<u8> = views.iter().flat_map(|view| view.grey.grey.iter().map(|grey| grey.round() as u8)).collect();
    std::fs::write(folder.path().join("windows"), &bytes)?;
    write_array(folder.path(), "side", [SIDE as f64])?;
    // both see the same whole numbers
    let windows: Vec<GreyWindow> = bytes
        .chunks_exact(SIDE * SIDE)
        .map(|grey| {
            let grey = grey.iter().map(|&grey| f32::from(grey)).collect();
            GreyWindow { origin_px: [0, 0], reduction: 1, width: SIDE, height: SIDE, grey }
        })
        .collect();
    let mut peer = peers.start("segments.py", folder.path())?;
    let compared = compare(&mut peer, "", || {
        Ok(windows.iter().map(|window| line_segments(window, &Detection::default())).collect::<Vec<_>>())
    })?;
    let ours: Vec<Vec<Segment2>> = compared.made.iter().map(|f| f.iter().map(|l| l.segment).collect()).collect();
    let theirs = listed(&compared.told["found"]).context("the segments of LSD")?;
    let count = windows.len() as f64;
    let long =
        |found: &[Vec<Segment2>]| found.iter().flatten().filter(|s| s.length() > SHORTEST).count() as f64 / count;
    let model_edges = edges(&views);
    let (seen_by_theirs, seen_by_ours) = (share_covered(&model_edges, &theirs), share_covered(&model_edges, &ours));
    let note = format!(
        "{} windows; lines over {SHORTEST} cells a window: LSD {:.1}, ours {:.1}; LSD's that ours cover {:.3}, ours that \
         LSD's cover {:.3}; model edges found: LSD {seen_by_theirs:.3}, ours {seen_by_ours:.3}",
        windows.len(),
        long(&theirs),
        long(&ours),
        share_covered(&theirs, &ours),
        share_covered(&ours, &theirs),
    );
    Ok(vec![Row {
        id: "F1",
        what: "a window of 250 x 250 cells / LSD refine=STD".to_owned(),
        peer_s: compared.peer_s / count,
        ours_s: compared.ours_s / count,
        gate: 0.25,
        moonshot: 0.065,
        as_good: seen_by_ours >= seen_by_theirs,
        note,
    }])
}

/// Windows around control points under the reference orientations, in turns through the images.
fn views(peers: &Peers) -> Result<Vec<View>> {
    let mut of_images = Vec::new();
    for name in ["boruszyn", "boruszyn_wire", "caliterra"] {
        let dataset = Dataset::read(&peers.images.join(name), "attitude", 4)?;
        for image in &dataset.images {
            of_images.push(views_of(&dataset, image)?);
        }
    }
    let mut chosen = Vec::new();
    while chosen.len() < WINDOWS && of_images.iter().any(|views| !views.is_empty()) {
        chosen.extend(of_images.iter_mut().filter_map(Vec::pop));
    }
    chosen.truncate(WINDOWS);
    Ok(chosen)
}

fn views_of(dataset: &Dataset, image: &Image) -> Result<Vec<View>> {
    let (camera, truth) = (&dataset.camera, image.true_orientation(dataset));
    let picture = ImageFile::open(&image.file, &Limits::default())?;
    let side_px = SIDE as u32 * REDUCTION;
    let mut views = Vec::new();
    for control_point in &image.control {
        let Some(middle) = truth.pixel(camera, control_point.reference_m) else { continue };
        let corner = middle - Vector2::repeat(f64::from(side_px) / 2.0);
        let largest = [camera.width_px, camera.height_px].map(|side| f64::from(side - side_px));
        if corner.x < 0.0 || corner.y < 0.0 || corner.x > largest[0] || corner.y > largest[1] {
            continue;
        }
        let (x, y) = (corner.x as u32, corner.y as u32);
        let grey = picture.window(PixelRect { x, y, width: side_px, height: side_px }, REDUCTION)?;
        let cell = |reduced: Vector2<f64>| {
            (camera.pixel_from_reduced(reduced) - Vector2::new(f64::from(x), f64::from(y))) / f64::from(REDUCTION)
        };
        let edges = edges_px(camera, &truth, control_point).into_iter().flatten();
        let edges = edges.map(|e| Segment2 { start: cell(e.start), end: cell(e.end) }).filter(inside).collect();
        views.push(View { grey, edges });
    }
    Ok(views)
}

fn inside(edge: &Segment2) -> bool {
    let range = 0.0..SIDE as f64;
    [edge.start, edge.end].iter().all(|p| range.contains(&p.x) && range.contains(&p.y))
}

fn edges(views: &[View]) -> Vec<Vec<Segment2>> {
    views.iter().map(|view| view.edges.clone()).collect()
}

/// Of the lines over the shortest length, window by window, the share that `by` covers.
fn share_covered(lines: &[Vec<Segment2>], by: &[Vec<Segment2>]) -> f64 {
    let (mut found, mut all) = (0.0, 0.0);
    for (lines, by) in lines.iter().zip(by) {
        for line in lines.iter().filter(|line| line.length() > SHORTEST) {
            all += 1.0;
            found += f64::from(u8::from(covered(line, by) >= LEAST_SHARE));
        }
    }
    found / all
}

/// How much of a line is covered by those of `others` that are near and parallel to it.
fn covered(line: &Segment2, others: &[Segment2]) -> f64 {
    let (along, normal, length) = (line.direction(), line.normal(), line.length());
    let mut parts: Vec<[f64; 2]> = Vec::new();
    for other in others.iter().filter(|other| other.direction().dot(&along).abs() >= PARALLEL_RAD.cos()) {
        let (a, b) = (other.start - line.start, other.end - line.start);
        let (u, v) = (along.dot(&a), along.dot(&b));
        let part = [u.min(v).max(0.0), u.max(v).min(length)];
        if part[1] > part[0] && normal.dot(&((a + b) / 2.0)).abs() <= NEAR {
            parts.push(part);
        }
    }
    parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (mut sum, mut end) = (0.0, 0.0_f64);
    for [from, to] in parts {
        sum += (to - from.max(end)).max(0.0);
        end = end.max(to);
    }
    sum / length
}

fn listed(found: &Value) -> Option<Vec<Vec<Segment2>>> {
    let segment = |line: &Value| {
        let n: Vec<f64> = line.as_array()?.iter().filter_map(Value::as_f64).collect();
        let &[a, b, c, d] = n.as_slice() else { return None };
        Some(Segment2 { start: Vector2::new(a, b), end: Vector2::new(c, d) })
    };
    found.as_array()?.iter().map(|window| window.as_array()?.iter().map(segment).collect()).collect()
}
