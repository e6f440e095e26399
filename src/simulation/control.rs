//! Control points as a survey would deliver them: the roof lines of some of the houses, with its errors.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::building::{Building, Roof};
use super::draws::{Draws, Purpose, direction};
use super::surface::left_of;
use super::town::Town;
use crate::geometry::Segment3;
use crate::orientation::ControlPoint;

/// What control there is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlSettings {
    /// The share of the houses that were measured. Half: the other half shows the same patterns and is in no list.
    pub share: f64,
    /// Standard deviation of each coordinate of each corner. 5 cm: manual measurement in large-scale photographs.
    pub sigma_m: f64,
    /// The share of the control points that is out of date: their house has moved or was rebuilt. 5 %.
    pub share_outdated: f64,
    /// The share of the control points whose house is gone: the model stands where there is none. None.
    pub share_gone: f64,
    /// Standard deviation, in each coordinate, of a shift that all edges of a model have in common, beside what
    /// `sigma_m` states. None; real control has shifts of a pixel or more.
    pub sigma_shift_m: f64,
    /// Standard deviation of a shift of each single edge across itself on the map, as of a gutter that was taken for
    /// the rim of the roof. None.
    pub sigma_edge_m: f64,
    /// Standard deviation, in each coordinate, of a strain of the block that the control was measured in: what neighbours
    /// have in common of the shifts of their models. None.
    pub sigma_strain_m: f64,
    /// Over this distance the strain loses most of what it has in common. 60 m.
    pub strain_length_m: f64,
    /// The share of the edges that were not measured; no model has fewer than [`LEAST_EDGES`]. None.
    pub share_missing: f64,
}

/// A model with fewer edges would not have become a control point.
pub const LEAST_EDGES: usize = 3;

impl Default for ControlSettings {
    fn default() -> Self {
        Self {
            share: 0.5,
            sigma_m: 0.05,
            share_outdated: 0.05,
            share_gone: 0.0,
            sigma_shift_m: 0.0,
            sigma_edge_m: 0.0,
            sigma_strain_m: 0.0,
            strain_length_m: 60.0,
            share_missing: 0.0,
        }
    }
}

/// What is wrong with an outdated control point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The whole model lies 1 to 4 m beside its house.
    Shifted,
    /// The model is of the house that stood there before: another roof, another size.
    Rebuilt,
    /// There is no such house: the model stands 12 to 30 m beside one like it.
    Gone,
}

/// A control point and the truth about it.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedControlPoint {
    /// What the pipeline is told.
    pub control_point: ControlPoint,
    /// The index of its house in the town's list of buildings.
    pub building: usize,
    /// `None` for sound control.
    pub fault: Option<Fault>,
    /// The shift that all its edges have in common.
    pub shift_m: Vector3<f64>,
    /// For each edge its own shift, to the left of its direction on the map.
    pub edge_shifts_m: Vec<f64>,
}

/// Measures a part of a town's houses.
#[must_use]
pub fn survey(town: &Town, seed: u64, settings: &ControlSettings) -> Vec<SimulatedControlPoint> {
    let draws = &mut Draws::new(seed, Purpose::Control);
    let errors = &mut Draws::new(seed, Purpose::ModelErrors);
    let strain = Strain::draw(seed, settings);
    let mut houses: Vec<usize> = (0..town.buildings.len())
        .filter(|&index| town.buildings[index].purpose == super::building::Use::Main)
        .collect();
    draws.shuffle(&mut houses);
    houses.truncate((houses.len() as f64 * settings.share).round() as usize);
    houses.sort_unstable();
    let measured = |index: usize| {
        let mut point = measure(index, &town.buildings[index], settings, draws, errors);
        point.shift(strain.at(point.control_point.reference_m));
        point
    };
    houses.into_iter().map(measured).collect()
}

/// A strain of a block: a few long waves.
struct Strain {
    waves: Vec<Wave>,
}

struct Wave {
    amplitude_m: Vector3<f64>,
    /// Radians a metre, east and north.
    frequency: Vector2<f64>,
    phase: f64,
}

impl Strain {
    const WAVES: u32 = 6;

    fn draw(seed: u64, settings: &ControlSettings) -> Self {
        let draws = &mut Draws::new(seed, Purpose::Strain);
        // a cosine has half the square of its amplitude for a variance
        let sigma_m = settings.sigma_strain_m * (2.0 / f64::from(Self::WAVES)).sqrt();
        let wave = |_| {
            let length_m = settings.strain_length_m * draws.between(2.5, 7.0);
            let towards = direction(draws.between(0.0, std::f64::consts::TAU));
            Wave {
                amplitude_m: Vector3::from_fn(|_, _| sigma_m * draws.normal()),
                frequency: towards * (std::f64::consts::TAU / length_m),
                phase: draws.between(0.0, std::f64::consts::TAU),
            }
        };
        Self { waves: (0..Self::WAVES).map(wave).collect() }
    }

    fn at(&self, place_m: Vector3<f64>) -> Vector3<f64> {
        self.waves.iter().map(|w| w.amplitude_m * libm::cos(w.frequency.dot(&place_m.xy()) + w.phase)).sum()
    }
}

impl SimulatedControlPoint {
    /// Shifts the whole model.
    fn shift(&mut self, by_m: Vector3<f64>) {
        let point = &mut self.control_point;
        point.reference_m += by_m;
        for edge in &mut point.edges_m {
            edge.start += by_m;
            edge.end += by_m;
        }
        self.shift_m += by_m;
    }
}

/// `errors` draws what goes wrong beside the measuring, so that the measuring is the same without it.
fn measure(
    index: usize,
    house: &Building,
    settings: &ControlSettings,
    draws: &mut Draws,
    errors: &mut Draws,
) -> SimulatedControlPoint {
    let outdated =
        draws.chance(settings.share_outdated).then(|| if draws.chance(0.5) { Fault::Shifted } else { Fault::Rebuilt });
    let fault = if errors.chance(settings.share_gone) { Some(Fault::Gone) } else { outdated };
    let modelled = match fault {
        None => house.clone(),
        Some(Fault::Gone) => shifted(house, [12.0, 30.0], errors),
        Some(Fault::Shifted) => shifted(house, [1.0, 4.0], draws),
        Some(Fault::Rebuilt) => former(house, draws),
    };
    let (mut corners, edges) = modelled.roof_wireframe();
    for corner in &mut corners {
        *corner += Vector3::from_fn(|_, _| settings.sigma_m * draws.normal());
    }
    let mut edges_m: Vec<_> =
        edges.iter().map(|&[from, to]| Segment3 { start: corners[from], end: corners[to] }).collect();
    let (shift_m, edge_shifts_m) = err(&mut edges_m, settings, errors);
    let reference_m = edges_m.iter().map(Segment3::midpoint).sum::<Vector3<f64>>() / edges_m.len() as f64;
    let control_point = ControlPoint {
        name: format!("house-{index:03}"),
        sigma_m: settings.sigma_m,
        reference_m,
        edges_m,
        edge_sigmas_m: Vec::new(),
        scene: None,
    };
    SimulatedControlPoint { control_point, building: index, fault, shift_m, edge_shifts_m }
}

/// Shifts all edges together and each by itself, and leaves some out; returns the shifts of those that stay.
fn err(edges_m: &mut Vec<Segment3>, settings: &ControlSettings, errors: &mut Draws) -> (Vector3<f64>, Vec<f64>) {
    let shift_m = Vector3::from_fn(|_, _| settings.sigma_shift_m * errors.normal());
    let mut measured = Vec::with_capacity(edges_m.len());
    let mut own_shifts_m = Vec::with_capacity(edges_m.len());
    for (passed, edge) in edges_m.iter().enumerate() {
        let own_m = settings.sigma_edge_m * errors.normal();
        let still_to_come = edges_m.len() - passed;
        if errors.chance(settings.share_missing) && measured.len() + still_to_come > LEAST_EDGES {
            continue;
        }
        let along = (edge.end - edge.start).xy().try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector2::zeros);
        let moved = shift_m + (left_of(along) * own_m).push(0.0);
        measured.push(Segment3 { start: edge.start + moved, end: edge.end + moved });
        own_shifts_m.push(own_m);
    }
    *edges_m = measured;
    (shift_m, own_shifts_m)
}

fn shifted(house: &Building, [least_m, most_m]: [f64; 2], draws: &mut Draws) -> Building {
    let aside: Vector2<f64> = direction(draws.between(0.0, std::f64::consts::TAU)) * draws.between(least_m, most_m);
    Building { centre_m: house.centre_m + aside, ..house.clone() }
}

fn former(house: &Building, draws: &mut Draws) -> Building {
    let roof = match house.roof {
        Roof::Gable { slope } => Roof::Hip { slope: slope * 0.75 },
        Roof::Hip { slope } => Roof::Gable { slope: slope * 1.3 },
        Roof::Flat => Roof::Gable { slope: 0.8 },
    };
    let width_m = house.width_m * draws.between(0.65, 0.9);
    let length_m = (house.length_m * draws.between(0.7, 1.1)).max(width_m + 1.0);
    Building { roof, width_m, length_m, ..house.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::TownSettings;

    fn surveyed(seed: u64, settings: &ControlSettings) -> (Town, Vec<SimulatedControlPoint>) {
        let town = Town::build(seed, &TownSettings::default());
        let control = survey(&town, seed, settings);
        (town, control)
    }

    #[test]
    fn sound_control_scatters_about_the_roof_by_its_sigma() {
        let settings = ControlSettings { share: 1.0, sigma_m: 0.05, share_outdated: 0.0, ..ControlSettings::default() };
        let mut squares = Vec::new();
        for seed in 1..=5 {
            let (town, control) = surveyed(seed, &settings);
            for point in control {
                assert_eq!(point.fault, None);
                let truth = town.buildings[point.building].roof_edges_m();
                assert_eq!(truth.len(), point.control_point.edges_m.len());
                squares.extend(truth.iter().zip(&point.control_point.edges_m).flat_map(|(t, m)| {
                    let d = m.start - t.start;
                    [d.x * d.x, d.y * d.y, d.z * d.z]
                }));
            }
        }
        let sigma_m = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((sigma_m - 0.05).abs() < 0.002, "sigma {sigma_m} from {} coordinates", squares.len());
    }

    #[test]
    fn a_roof_s_edges_meet_in_common_corners() {
        let (_, control) = surveyed(3, &ControlSettings::default());
        let gable = control.iter().find(|point| point.control_point.edges_m.len() == 7).unwrap();
        let edges = &gable.control_point.edges_m;
        assert_eq!(edges[0].start, edges[3].end); // ridge and verge
        assert_eq!(edges[1].start, edges[3].start); // eaves and verge
    }

    #[test]
    fn the_share_of_outdated_control_is_what_was_asked() {
        let settings = ControlSettings { share: 1.0, sigma_m: 0.0, share_outdated: 0.3, ..ControlSettings::default() };
        let all: Vec<_> = (1..=8).flat_map(|seed| surveyed(seed, &settings).1).collect();
        let faulty = all.iter().filter(|point| point.fault.is_some()).count() as f64 / all.len() as f64;
        assert!((faulty - 0.3).abs() < 0.08, "{faulty} of {}", all.len());
        for point in all.iter().filter(|point| point.fault == Some(Fault::Rebuilt)) {
            let seed = (1..=8).find(|&seed| {
                let (town, control) = surveyed(seed, &settings);
                control.iter().any(|other| other == point)
                    && town.buildings[point.building].roof_edges_m() == point.control_point.edges_m
            });
            assert_eq!(seed, None, "a rebuilt house is modelled as it is");
        }
    }

    #[test]
    fn models_err_together_and_edge_by_edge_with_their_sigmas() {
        let settings = ControlSettings {
            share: 1.0,
            sigma_m: 0.0,
            share_outdated: 0.0,
            sigma_shift_m: 0.3,
            sigma_edge_m: 0.2,
            ..ControlSettings::default()
        };
        let (mut shifts, mut own) = (Vec::new(), Vec::new());
        for seed in 1..=8 {
            let (town, control) = surveyed(seed, &settings);
            for point in control {
                let truth = town.buildings[point.building].roof_edges_m();
                shifts.extend(point.shift_m.iter().copied());
                own.extend(point.edge_shifts_m.iter().copied());
                for ((edge, true_edge), own_m) in
                    point.control_point.edges_m.iter().zip(&truth).zip(&point.edge_shifts_m)
                {
                    let along = (true_edge.end - true_edge.start).xy().normalize();
                    let off = edge.midpoint() - true_edge.midpoint() - point.shift_m;
                    assert!((along.perp(&off.xy()) - own_m).abs() < 1e-9 && along.dot(&off.xy()).abs() < 1e-9);
                }
            }
        }
        let sigma = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        // four standard deviations of a standard deviation
        assert!((sigma(&shifts) / 0.3 - 1.0).abs() < 4.0 / (2.0 * shifts.len() as f64).sqrt());
        assert!((sigma(&own) / 0.2 - 1.0).abs() < 4.0 / (2.0 * own.len() as f64).sqrt());
    }

    #[test]
    fn the_share_of_missing_edges_and_of_missing_houses_is_what_was_asked() {
        let settings =
            ControlSettings { share: 1.0, share_gone: 0.2, share_missing: 0.25, ..ControlSettings::default() };
        let all: Vec<_> = (1..=8).flat_map(|seed| surveyed(seed, &settings).1).collect();
        let gone = all.iter().filter(|point| point.fault == Some(Fault::Gone)).count() as f64 / all.len() as f64;
        assert!((gone - 0.2).abs() < 0.08, "{gone} of {}", all.len());
        let whole: Vec<_> =
            (1..=8).flat_map(|seed| surveyed(seed, &ControlSettings { share_missing: 0.0, ..settings }).1).collect();
        let edges =
            |points: &[SimulatedControlPoint]| -> usize { points.iter().map(|p| p.control_point.edges_m.len()).sum() };
        let kept = edges(&all) as f64 / edges(&whole) as f64;
        // those that would fall below three edges keep some more
        assert!((0.74..0.80).contains(&kept), "{kept}");
        assert!(all.iter().all(|point| point.control_point.edges_m.len() >= LEAST_EDGES));
    }
}
