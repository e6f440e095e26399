//! How large a database of control points becomes, how fast it is filled, and how fast a footprint is found in it.
//!
//!     cargo bench --bench control_figures -- 1000000 FILE.db
//!     tests/with-postgres sh -c 'cargo bench --bench control_figures -- 1000000 "$TEST_POSTGRES"'
//!
//! Buildings are generated as a building model would give them: 20 roof edges each, a tile of 1 km after the other, 294 of
//! them on a square kilometre in the mean and five times as many in towns, with the ids of a land register. With `--again`
//! an existing database is asked only; drop the caches of the system before (`echo 3 > /proc/sys/vm/drop_caches`) to see
//! what cold ones cost.

#![allow(clippy::print_stdout, reason = "figures are for people")]

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use gable::buildings::{self, Building, EdgeKind, RoofEdge};
use gable::control::geojson::Defaults;
use gable::control::near::Reach;
use gable::control::points::{self, Filter, Import};
use gable::control::reading::Raw;
use gable::control::region::longitude_latitude_deg;
use gable::control::{FileFormat, GeodeticBox, Kinds, Mode, Reading, Wanted, around, chosen_of_many};
use gable::database::{Database, query};
use gable::geometry::{Crs, ExteriorOrientation, LocalFrame, rotation};
use gable::pipeline::Approximation;
use nalgebra::Vector3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The lower left corner of the state, EPSG:25832.
const CORNER_M: [f64; 2] = [300_000.0, 5_600_000.0];
const TILE_M: f64 = 1_000.0;
/// On a square kilometre, as in North Rhine-Westphalia.
const MEAN_PER_TILE: f64 = 294.0;
const SHARE_OF_TOWNS: f64 = 0.15;
const IN_TOWNS: f64 = 4.7;
const FOOTPRINTS: usize = 1_000;
const CHOSEN: usize = 60;

#[tokio::main]
async fn main() -> Result<(), Failure> {
    // cargo bench adds a flag of its own
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let (Some(count), Some(place)) = (arguments.first(), arguments.get(1)) else {
        return Err("usage: control_figures BUILDINGS FILE.db|postgres://… [--again]".into());
    };
    let state = State::of(count.parse()?);
    let database = match place.starts_with("postgres") {
        true => Database::postgres(place).await?,
        false => Database::sqlite(Path::new(place)).await?,
    };
    database.migrate().await?;
    if arguments.get(2).is_none_or(|flag| flag != "--again") {
        fill(&database, &state).await?;
        println!("{:.2} GB on disk", bytes(&database, place).await? as f64 / 1e9);
    }
    for pass in ["first", "second"] {
        footprints(&database, &state, pass).await?;
    }
    choices(&database, &state).await?;
    views(&database, &state).await?;
    database.close().await;
    Ok(())
}

async fn fill(database: &Database, state: &State) -> Result<(), Failure> {
    let crs = Arc::new(Crs::parse("EPSG:25832")?);
    let reading = Reading {
        format: FileFormat::Model(buildings::Format::CityJsonSeq),
        crs: None,
        geoid_undulation_m: Some(46.0),
        defaults: Defaults::default(),
        heights_assumed: Arc::default(),
    };
    let (state, count) = (state.clone(), state.buildings);
    let began = Instant::now();
    let (mut before, mut done_before) = (Instant::now(), 0);
    let plan = Import { mode: Mode::Upsert, ..Import::default() };
    let import = points::import(
        database,
        &plan,
        reading,
        move |_, each| {
            for index in 0..state.buildings {
                if each(index, Raw::Building(state.building(index), crs.clone())) == ControlFlow::Break(()) {
                    break;
                }
            }
            Ok(())
        },
        |step| {
            if step.items_done - done_before >= count / 10 {
                let rate = (step.items_done - done_before) as f64 / before.elapsed().as_secs_f64();
                println!("  {} buildings, now {rate:.0} a second", step.items_done);
                (before, done_before) = (Instant::now(), step.items_done);
            }
        },
    );
    let report = import.await?;
    let seconds = began.elapsed().as_secs_f64();
    println!("{} imported in {seconds:.1} s: {:.0} a second", report.imported, report.imported as f64 / seconds);
    if let Database::Postgres(_) = database {
        query("ANALYZE control_points").execute(database).await?;
    }
    Ok(())
}

async fn bytes(database: &Database, place: &str) -> Result<u64, Failure> {
    Ok(match database {
        Database::Sqlite(_) => std::fs::metadata(place)?.len(),
        Database::Postgres(_) => {
            let bytes: i64 = query("SELECT pg_total_relation_size('control_points')").fetch_value(database).await?;
            bytes.unsigned_abs()
        }
    })
}

/// Squares of 500 m to 2 km about buildings.
async fn footprints(database: &Database, state: &State, pass: &str) -> Result<(), Failure> {
    let (crs, mut draws) = (Crs::parse("EPSG:25832")?, ChaCha8Rng::seed_from_u64(1));
    let (mut times, mut found) = (Vec::new(), Vec::new());
    for _ in 0..FOOTPRINTS {
        let middle = crs.geocentric_from_position(state.place(draws.random_range(0..state.buildings)), None)?;
        let region = GeodeticBox::around_place(longitude_latitude_deg(middle), draws.random_range(250.0..1_000.0));
        let began = Instant::now();
        found.push(points::in_box(database, region, &Filter::default(), 0, usize::MAX).await?.len() as f64);
        times.push(1e3 * began.elapsed().as_secs_f64());
    }
    let ([p50, p95, most], [median, many, _]) = (quantiles(times), quantiles(found));
    println!(
        "{pass} time: footprint p50 {p50:.1} ms, p95 {p95:.1} ms, worst {most:.1} ms; {median:.0} buildings, p95 {many:.0}"
    );
    Ok(())
}

/// The choice by itself, among the thousands that an image of a town from 1500 m shows.
async fn choices(database: &Database, state: &State) -> Result<(), Failure> {
    let (crs, mut draws) = (Crs::parse("EPSG:25832")?, ChaCha8Rng::seed_from_u64(3));
    let (mut times, mut among) = (Vec::new(), Vec::new());
    for _ in 0..300 {
        let place = crs.geocentric_from_position(state.place(draws.random_range(0..state.buildings)), None)?;
        let [lon_deg, lat_deg] = longitude_latitude_deg(place);
        let region = GeodeticBox::around_place([lon_deg, lat_deg], 1_000.0);
        let frame = LocalFrame::at(lon_deg, lat_deg, 0.0);
        let kept = points::in_box(database, region, &Filter::default(), 0, usize::MAX).await?;
        let town: Vec<_> = kept.iter().map(|kept| kept.point.in_frame(&frame)).collect();
        if town.len() < 2_000 {
            continue;
        }
        among.push(town.len() as f64);
        let began = Instant::now();
        let chosen = chosen_of_many(town, Vector3::new(500.0, 0.0, 1_600.0), CHOSEN);
        times.push(1e3 * began.elapsed().as_secs_f64());
        assert_eq!(chosen.len(), CHOSEN);
    }
    if times.is_empty() {
        println!("no town has thousands of buildings to choose among");
        return Ok(());
    }
    let ([p50, p95, most], [median, ..]) = (quantiles(times), quantiles(among));
    println!("choice of {CHOSEN} among {median:.0}: p50 {p50:.1} ms, p95 {p95:.1} ms, worst {most:.1} ms");
    Ok(())
}

/// All that is done to find the control of an image that shows a town from 1500 m, its choice among thousands included.
async fn views(database: &Database, state: &State) -> Result<(), Failure> {
    let (crs, mut draws) = (Crs::parse("EPSG:25832")?, ChaCha8Rng::seed_from_u64(2));
    let (mut times, mut chosen) = (Vec::new(), Vec::new());
    let wanted = Wanted { kinds: Kinds { lines: true, scenes: false }, sets: None, date: None };
    for _ in 0..100 {
        let place = crs.geocentric_from_position(state.place(draws.random_range(0..state.buildings)), None)?;
        let [lon_deg, lat_deg] = longitude_latitude_deg(place);
        let approximation = Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(0.0, 0.0, 1_600.0),
                camera_from_object: rotation::camera_from_object(0.1, 0.0, 0.0),
            },
            sigma_position_m: [10.0; 3],
            sigma_tilt_rad: 0.03,
            sigma_kappa_rad: None,
        };
        let frame = LocalFrame::at(lon_deg, lat_deg, 0.0);
        let began = Instant::now();
        let near = around(database, &frame, 0.6, &approximation, Reach::default(), &wanted).await?;
        times.push(1e3 * began.elapsed().as_secs_f64());
        chosen.push(near.lines.len() as f64);
    }
    let ([p50, p95, most], [taken, ..]) = (quantiles(times), quantiles(chosen));
    println!("control of an image: p50 {p50:.1} ms, p95 {p95:.1} ms, worst {most:.1} ms; {taken:.0} chosen");
    Ok(())
}

fn quantiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    [last / 2, last * 95 / 100, last].map(|place| values[place])
}

/// A state of so many buildings.
#[derive(Clone)]
struct State {
    buildings: usize,
    /// How many tiles are in a row.
    across: usize,
    /// The number of the first building of each tile.
    firsts: Arc<Vec<usize>>,
}

impl State {
    fn of(buildings: usize) -> Self {
        let tiles = (buildings as f64 / MEAN_PER_TILE).ceil().max(1.0) as usize;
        let mut draws = ChaCha8Rng::seed_from_u64(7);
        let rural = (1.0 - SHARE_OF_TOWNS * IN_TOWNS) / (1.0 - SHARE_OF_TOWNS);
        let weight = |town: bool| if town { IN_TOWNS } else { rural };
        let weights: Vec<f64> = (0..tiles).map(|_| weight(draws.random_bool(SHARE_OF_TOWNS))).collect();
        let all: f64 = weights.iter().sum();
        let mut passed = 0.0;
        let first = |weight: &f64| {
            let first = (passed / all * buildings as f64) as usize;
            passed += weight;
            first
        };
        let firsts = Arc::new(weights.iter().map(first).collect());
        Self { buildings, across: (tiles as f64).sqrt().ceil() as usize, firsts }
    }

    fn tile(&self, index: usize) -> ([f64; 2], ChaCha8Rng) {
        let tile = self.firsts.partition_point(|first| *first <= index) - 1;
        let (column, row) = (tile % self.across, tile / self.across);
        let corner_m = [CORNER_M[0] + TILE_M * column as f64, CORNER_M[1] + TILE_M * row as f64];
        (corner_m, ChaCha8Rng::seed_from_u64(index as u64))
    }

    fn place(&self, index: usize) -> [f64; 3] {
        let (corner_m, mut draws) = self.tile(index);
        let [x, y] = corner_m.map(|corner_m| corner_m + draws.random_range(0.0..TILE_M));
        [x, y, 60.0 + draws.random_range(0.0..10.0)]
    }

    /// A house with a gabled roof, two dormers and an annex with a flat one: 20 edges.
    fn building(&self, index: usize) -> Building {
        let (_, mut draws) = self.tile(index);
        let [x, y, ground_m] = self.place(index);
        let (sin, cos) = draws.random_range(0.0..std::f64::consts::PI).sin_cos();
        let (long, wide) = (draws.random_range(4.0..12.0), draws.random_range(3.0..7.0));
        // the file has millimetres
        let millimetres = |value: f64| (value * 1e3).round() / 1e3;
        let at = |u: f64, v: f64, height: f64| {
            [x + cos * u - sin * v, y + sin * u + cos * v, ground_m + height].map(millimetres)
        };
        let mut edges = Vec::with_capacity(20);
        let gabled = |edges: &mut Vec<RoofEdge>, [u, v]: [f64; 2], [long, wide]: [f64; 2], [eave, ridge]: [f64; 2]| {
            let mut line = |kind, start, end| edges.push(RoofEdge { kind, start, end });
            let ends = [-1.0, 1.0].map(|end| at(u + end * long, v, ridge));
            line(EdgeKind::Ridge, ends[0], ends[1]);
            for side in [-1.0, 1.0] {
                let corners = [-1.0, 1.0].map(|end| at(u + end * long, v + side * wide, eave));
                line(EdgeKind::Eave, corners[0], corners[1]);
                line(EdgeKind::Gable, corners[0], ends[0]);
                line(EdgeKind::Gable, corners[1], ends[1]);
            }
        };
        gabled(&mut edges, [0.0, 0.0], [long, wide], [6.0, 10.0]);
        gabled(&mut edges, [0.0, wide / 2.0], [1.0, 1.0], [7.5, 8.5]);
        for [start, end] in [[[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [4.0, 3.0]], [[4.0, 3.0], [0.0, 3.0]]] {
            let corner = |[u, v]: [f64; 2]| at(long + u, v, 3.0);
            edges.push(RoofEdge { kind: EdgeKind::Rim, start: corner(start), end: corner(end) });
            edges.push(RoofEdge { kind: EdgeKind::Rim, start: corner(end), end: at(long + end[0], end[1], 2.5) });
        }
        let mut id: u64 = draws.random();
        let letters = std::iter::from_fn(|| {
            let digit = char::from_digit((id % 36) as u32, 36)?;
            id /= 36;
            Some(digit.to_ascii_uppercase())
        });
        let name = format!("DENW{}", letters.take(12).collect::<String>());
        Building { index, name, crs: None, roof_rmse_m: None, edges }
    }
}
