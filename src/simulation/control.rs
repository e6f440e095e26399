//! Control points as a survey would deliver them: the roof lines of some of the houses, with its errors.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::building::{Building, Roof};
use super::draws::{Draws, Purpose, direction};
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
}

impl Default for ControlSettings {
    fn default() -> Self {
        Self { share: 0.5, sigma_m: 0.05, share_outdated: 0.05 }
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
}

/// Measures a part of a town's houses.
#[must_use]
pub fn survey(town: &Town, seed: u64, settings: &ControlSettings) -> Vec<SimulatedControlPoint> {
    let draws = &mut Draws::new(seed, Purpose::Control);
    let mut houses: Vec<usize> = (0..town.buildings.len())
        .filter(|&index| town.buildings[index].purpose == super::building::Use::Main)
        .collect();
    draws.shuffle(&mut houses);
    houses.truncate((houses.len() as f64 * settings.share).round() as usize);
    houses.sort_unstable();
    houses.into_iter().map(|index| measure(index, &town.buildings[index], settings, draws)).collect()
}

fn measure(index: usize, house: &Building, settings: &ControlSettings, draws: &mut Draws) -> SimulatedControlPoint {
    let fault =
        draws.chance(settings.share_outdated).then(|| if draws.chance(0.5) { Fault::Shifted } else { Fault::Rebuilt });
    let modelled = match fault {
        None => house.clone(),
        Some(Fault::Shifted) => shifted(house, draws),
        Some(Fault::Rebuilt) => former(house, draws),
    };
    let (mut corners, edges) = modelled.roof_wireframe();
    for corner in &mut corners {
        *corner += Vector3::from_fn(|_, _| settings.sigma_m * draws.normal());
    }
    let edges_m: Vec<_> = edges.iter().map(|&[from, to]| Segment3 { start: corners[from], end: corners[to] }).collect();
    let reference_m = edges_m.iter().map(Segment3::midpoint).sum::<Vector3<f64>>() / edges_m.len() as f64;
    let control_point =
        ControlPoint { name: format!("house-{index:03}"), sigma_m: settings.sigma_m, reference_m, edges_m };
    SimulatedControlPoint { control_point, building: index, fault }
}

fn shifted(house: &Building, draws: &mut Draws) -> Building {
    let aside: Vector2<f64> = direction(draws.between(0.0, std::f64::consts::TAU)) * draws.between(1.0, 4.0);
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
        let settings = ControlSettings { share: 1.0, sigma_m: 0.05, share_outdated: 0.0 };
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
        let settings = ControlSettings { share: 1.0, sigma_m: 0.0, share_outdated: 0.3 };
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
}
