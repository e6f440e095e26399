//! F10: SIFT of crops of one megapixel of the real images, and matches between them and the same crops rotated, reduced
//! and of another tone, against OpenCV's.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use gable::features::sift::{KeyPoint, Settings, key_points, ratio_matches};
use gable::features::{GreyWindow, Picture as _, PixelRect};
use gable::imagery::{ImageFile, Limits};
use nalgebra::{Matrix2, Vector2};
use serde_json::Value;

use super::measure::compare;
use super::peer::{Peers, write_array};
use super::table::Row;

const SIDE: usize = 1024;
/// The photographs are soft, as in F1.
const REDUCTION: u32 = 2;
/// Of each dataset every so many images.
const STEP: usize = 5;
/// A match is right if it is no farther, in cells of the second picture, from where it must be.
const NEAR: f64 = 3.0;
/// At which OpenCV's are counted.
const RATIO: f64 = 0.8;

/// What is done with a crop.
struct Change {
    name: &'static str,
    degrees: f64,
    scale: f64,
    tone: fn(f32) -> f32,
}

const fn turned(name: &'static str, degrees: f64) -> Change {
    Change { name, degrees, scale: 1.0, tone: |grey| grey }
}

const fn scaled(name: &'static str, scale: f64) -> Change {
    Change { name, degrees: 0.0, scale, tone: |grey| grey }
}

const fn toned(name: &'static str, tone: fn(f32) -> f32) -> Change {
    Change { name, degrees: 0.0, scale: 1.0, tone }
}

const CHANGES: [Change; 11] = [
    turned("10°", 10.0),
    turned("45°", 45.0),
    turned("90°", 90.0),
    turned("135°", 135.0),
    turned("180°", 180.0),
    scaled("x0.75", 0.75),
    scaled("x0.5", 0.5),
    scaled("x0.25", 0.25),
    toned("0.7g", |grey| 0.7 * grey),
    toned("g+30", |grey| grey + 30.0),
    toned("gamma 1.8", |grey| 255.0 * (grey / 255.0).powf(1.8)),
];

impl Change {
    fn linear(&self) -> Matrix2<f64> {
        let (sin, cos) = self.degrees.to_radians().sin_cos();
        self.scale * Matrix2::new(cos, -sin, sin, cos)
    }

    fn side(&self) -> usize {
        (SIDE as f64 * self.scale).round() as usize
    }

    /// The changed crop about the middle of a window. Each cell is the mean over the part of the window that it shows.
    fn apply(&self, window: &GreyWindow) -> Vec<u8> {
        let side = self.side();
        let samples = (1.0 / self.scale).ceil() as usize;
        let back = self.linear().try_inverse().unwrap_or_else(Matrix2::identity);
        let middle = 0.5 * Vector2::new(window.width as f64, window.height as f64);
        let grey_of = |column: usize, row: usize| {
            let mut sum = 0.0;
            for k in 0..samples * samples {
                let part = |k: usize| (k as f64 + 0.5) / samples as f64;
                let at = Vector2::new(column as f64 + part(k % samples), row as f64 + part(k / samples));
                sum += interpolated(window, middle + back * (at - Vector2::repeat(0.5 * side as f64)));
            }
            (self.tone)(sum / (samples * samples) as f32).round() as u8
        };
        (0..side * side).map(|k| grey_of(k % side, k / side)).collect()
    }

    /// Where a point of the crop lies in the changed one.
    fn moved(&self, at: Vector2<f64>) -> Vector2<f64> {
        self.linear() * (at - Vector2::repeat(0.5 * SIDE as f64)) + Vector2::repeat(0.5 * self.side() as f64)
    }
}

fn interpolated(window: &GreyWindow, at: Vector2<f64>) -> f32 {
    let (x, y) = ((at.x - 0.5).max(0.0), (at.y - 0.5).max(0.0));
    let (column, row) = ((x as usize).min(window.width - 2), (y as usize).min(window.height - 2));
    let (u, v) = ((x - column as f64) as f32, (y - row as f64) as f32);
    let grey = |dx: usize, dy: usize| window.grey[(row + dy) * window.width + column + dx];
    let along = |dy: usize| grey(0, dy) + u * (grey(1, dy) - grey(0, dy));
    along(0) + v * (along(1) - along(0))
}

/// Grey values of a square.
struct Square {
    side: usize,
    bytes: Vec<u8>,
}

/// A pair of positions and how much nearer it is than the next.
struct Pair {
    from: Vector2<f64>,
    to: Vector2<f64>,
    ratio: f64,
}

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let squares = squares(&peers.images)?;
    let each = CHANGES.len() + 1;
    // the crop is followed by what is made of it
    let crops: Vec<usize> = (0..squares.len()).step_by(each).collect();
    let pairs: Vec<[usize; 2]> =
        crops.iter().flat_map(|&crop| (1..each).map(move |change| [crop, crop + change])).collect();
    let folder = tempfile::tempdir()?;
    let bytes: Vec<u8> = squares.iter().flat_map(|square| square.bytes.iter().copied()).collect();
    std::fs::write(folder.path().join("pictures"), bytes)?;
    write_array(folder.path(), "sizes", squares.iter().flat_map(|square| [square.side as f64; 2]))?;
    write_array(folder.path(), "timed", crops.iter().map(|&crop| crop as f64))?;
    write_array(folder.path(), "pairs", pairs.iter().flatten().map(|&square| square as f64))?;
    let mut peer = peers.start("sift.py", folder.path())?;

    let settings = Settings::default();
    let grey: Vec<Vec<f32>> =
        squares.iter().map(|square| square.bytes.iter().map(|&grey| f32::from(grey)).collect()).collect();
    let points_of = |k: usize| key_points(&grey[k], squares[k].side, squares[k].side, &settings);
    let found = compare(&mut peer, "points", || Ok(crops.iter().map(|&k| points_of(k)).collect::<Vec<_>>()))?;
    let theirs: u64 = found.told["points"].as_array().context("points")?.iter().filter_map(Value::as_u64).sum();
    let ours: usize = found.made.iter().map(Vec::len).sum();
    let points: Vec<Vec<KeyPoint>> = (0..squares.len()).map(points_of).collect();
    let matched = compare(&mut peer, "match", || {
        Ok(pairs.iter().map(|&[a, b]| ratio_matches(&points[a], &points[b], 1.0)).collect::<Vec<_>>())
    })?;
    let matches_of_theirs = told(&matched.told["matches"]).context("matches")?;
    let matches_of_ours = pairs.iter().zip(&matched.made).map(|(&[a, b], matches)| {
        let pair = |m: &gable::features::sift::Match| Pair {
            from: points[a][m.from].at_px,
            to: points[b][m.to].at_px,
            ratio: f64::from(m.ratio),
        };
        matches.iter().map(pair).collect()
    });
    let (note, as_good) = judged(&matches_of_theirs, &matches_of_ours.collect::<Vec<_>>());
    let count = crops.len() as f64;
    let row = |what: &str, peer_s, ours_s, gate, moonshot, note| Row {
        id: "F10",
        what: what.to_owned(),
        peer_s,
        ours_s,
        gate,
        moonshot,
        as_good,
        note,
    };
    let counts = format!("{} crops; key points: OpenCV {theirs}, ours {ours}", crops.len());
    let (of_pairs, pairs) = (matched.peer_s, pairs.len() as f64);
    Ok(vec![
        row("SIFT of 1024 x 1024 / OpenCV", found.peer_s / count, found.ours_s / count, 1.0, 0.5, counts),
        row("matching a pair / OpenCV BFMatcher", of_pairs / pairs, matched.ours_s / pairs, 0.5, 0.15, note),
    ])
}

/// Right matches by change and in all. As good are ours if in all, with no larger a share of wrong ones than OpenCV's
/// at the ratio that is usual, there are as many right ones.
fn judged(theirs: &[Vec<Pair>], ours: &[Vec<Pair>]) -> (String, bool) {
    let mut note = format!(
        "right/all at ratio {RATIO}: OpenCV, ours; ours right with OpenCV's share of wrong ones; right before the first \
         tenth is wrong: OpenCV, ours"
    );
    let mut as_good = false;
    for k in 0..=CHANGES.len() {
        // the last line is of all
        let name = CHANGES.get(k).map_or("all", |change| change.name);
        let of = |matches: &[Vec<Pair>]| {
            let here = matches.iter().enumerate().map(|(pair, matches)| (pair % CHANGES.len(), matches));
            let here = here.filter(|(change, _)| k == CHANGES.len() || *change == k);
            by_ratio(here.map(|(change, matches)| (&CHANGES[change], matches)))
        };
        let (theirs, ours) = (of(theirs), of(ours));
        let ([right, all], [our_right, our_all]) = (at_ratio(&theirs), at_ratio(&ours));
        let share = 1.0 - right as f64 / all.max(1) as f64;
        let alike = right_up_to(&ours, share);
        let tenth = [right_up_to(&theirs, 0.1), right_up_to(&ours, 0.1)];
        // writing to a string does not fail
        let _ = write!(
            note,
            "\n      {name:<10} {right:>6}/{all:<6} {our_right:>6}/{our_all:<6} {alike:>6}   {:>6} {:>6}",
            tenth[0], tenth[1]
        );
        as_good = alike >= right;
    }
    (note, as_good)
}

/// Ratios and whether right, by rising ratio.
fn by_ratio<'a>(pairs: impl Iterator<Item = (&'a Change, &'a Vec<Pair>)>) -> Vec<(f64, bool)> {
    let judged = |change: &Change, pair: &Pair| (pair.ratio, (change.moved(pair.from) - pair.to).norm() <= NEAR);
    let mut all: Vec<(f64, bool)> =
        pairs.flat_map(|(change, pairs)| pairs.iter().map(move |pair| judged(change, pair))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// Right ones and all up to the usual ratio.
fn at_ratio(matches: &[(f64, bool)]) -> [usize; 2] {
    let up_to = matches.partition_point(|(ratio, _)| *ratio <= RATIO);
    [matches[..up_to].iter().filter(|(_, right)| *right).count(), up_to]
}

/// Most right ones with no larger a share of wrong ones.
fn right_up_to(matches: &[(f64, bool)], share_wrong: f64) -> usize {
    let (mut right, mut best) = (0, 0);
    for (k, (_, is_right)) in matches.iter().enumerate() {
        right += usize::from(*is_right);
        if (k + 1 - right) as f64 <= share_wrong * (k + 1) as f64 {
            best = right;
        }
    }
    best
}

/// Each crop, followed by the changed ones.
fn squares(images: &Path) -> Result<Vec<Square>> {
    let mut squares = Vec::new();
    for dataset in ["boruszyn", "caliterra"] {
        let listed = std::fs::read_dir(images.join(dataset).join("images"))?;
        let mut files = listed.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
        files.sort();
        for file in files.iter().step_by(STEP) {
            let picture = ImageFile::open(file, &Limits::default())?;
            let [width, height] = picture.size_px();
            // as much as a crop needs in any direction
            let side = ((SIDE as f64 * std::f64::consts::SQRT_2) as u32 + 4) * REDUCTION;
            let (x, y) = (width.saturating_sub(side) / 2, height.saturating_sub(side) / 2);
            let window = picture.window(PixelRect { x, y, width: side, height: side }, REDUCTION)?;
            let crop = turned("", 0.0);
            for change in std::iter::once(&crop).chain(&CHANGES) {
                squares.push(Square { side: change.side(), bytes: change.apply(&window) });
            }
        }
    }
    Ok(squares)
}

fn told(matches: &Value) -> Option<Vec<Vec<Pair>>> {
    let pair = |of_match: &Value| {
        let n: Vec<f64> = of_match.as_array()?.iter().filter_map(Value::as_f64).collect();
        let &[a, b, c, d, ratio] = n.as_slice() else { return None };
        Some(Pair { from: Vector2::new(a, b), to: Vector2::new(c, d), ratio })
    };
    matches.as_array()?.iter().map(|matches| matches.as_array()?.iter().map(pair).collect()).collect()
}
