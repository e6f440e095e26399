//! Robust maximum-likelihood adjustment with all line segments (Förstner and Läbe step 3; Schickler 1992).
//!
//! Observed are the distances of a segment's ends from the projected edge, with the segment's covariance and the
//! uncertainty of the edge's own ends. Nothing is observed along the edge: where a segment ends says little about
//! where the edge ends (on real photographs the ends, even released one by one as in Schickler, made the result
//! worse), and so a part of an edge serves as well as the whole. What the edges of one building have in common is an
//! unknown shift of the building with a prior (`shifts`): so a building of thirty edges does not outvote three of five,
//! nor a row of neighbours a single one elsewhere.

#[cfg(test)]
mod overhang_tests;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, Matrix2, Matrix2x6, Matrix6, RowVector2, Vector2};

use super::ControlPoint;
use super::extract::ObservedSegment;
use super::matching::Match;
use super::predict::Prediction;
use super::shifts::{self, BuildingEquations, Reduced, SHARE_OF_THE_BUILDING, ShiftPrior};
use crate::estimation::Prior;
use crate::estimation::robust::Weighting;
use crate::geometry::{Camera, ExteriorOrientation};
use crate::scenes::Measured;

/// What a building, or a scene, takes to the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Index of the control point.
    pub control_point: usize,
    /// Its matched pieces; `Match::edge` counts its edges.
    pub matches: Vec<Match>,
    /// The reference of a scene, measured in the image.
    pub measured: Option<Measured>,
    /// The shift that its edges have in common, reduced pixels: where it is less where it is predicted.
    pub shift_px: Vector2<f64>,
}

/// The adjusted orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjustment {
    /// The orientation.
    pub orientation: ExteriorOrientation,
    /// A-priori covariance of `[dX0, theta]`.
    pub covariance: Matrix6<f64>,
    /// Weighted sum of squared residuals.
    pub squares: f64,
    /// Observations less unknowns.
    pub redundancy: usize,
    /// The buildings with their shifts.
    pub buildings: Vec<Building>,
    /// For each building whether each of its matches, or the measured point of a scene, kept its weight.
    pub kept: Vec<Vec<bool>>,
    /// For each building what was added to the variance of its shift because it does not fit, px².
    pub excess: Vec<f64>,
}

impl Adjustment {
    /// The square root of the variance factor.
    #[must_use]
    pub fn sigma0(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.squares / self.redundancy as f64).sqrt() }
    }

    /// The buildings of which at least one match kept its weight, as indices of their control points.
    pub fn held_by(&self) -> impl Iterator<Item = usize> {
        let with_kept = self.buildings.iter().zip(&self.kept);
        with_kept.filter(|(_, kept)| kept.contains(&true)).map(|(building, _)| building.control_point)
    }

    /// For predicting with it: its covariance is scaled where the observations fit worse than was assumed.
    #[must_use]
    pub fn prediction(&self) -> Prediction {
        let inflation = self.sigma0().max(1.0).powi(2);
        Prediction { orientation: self.orientation, covariance: self.covariance * inflation }
    }
}

/// Variance of an edge beside its building's shift: that of the whole edge (the gutter, not the rim), and that of each
/// of its ends. Measured under the reference orientations of `../shared/bench`: the lines of 1200 edges lie 0.5 to
/// 1.1 px off, whether 0.4 or 1.8 px is stated for their coordinates, and their ends differ by 0.5 to 1 px.
const WHOLE_EDGE_PX2: f64 = 0.45;
const END_PX2: f64 = 0.1;
/// What is stated for the coordinates is shared: half of the variance is the building's ([`super::shifts`]), a quarter
/// each the edge's and the end's.
const SHARE_OF_THE_EDGE: f64 = 0.25;
const SHARE_OF_THE_END: f64 = 0.25;
/// The weights from step to step (method 1.4).
const STEPS: [Weighting; 8] = [
    Weighting::Convex,
    Weighting::Convex,
    Weighting::Convex,
    Weighting::Redescending,
    Weighting::Redescending,
    Weighting::Redescending,
    Weighting::Rejecting,
    Weighting::Rejecting,
];

/// Everything the adjustment reads.
pub struct Model<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The control points.
    pub control: &'a [ControlPoint],
    /// The segments that the matches refer to.
    pub observed: &'a [ObservedSegment],
    /// The approximation as an observation.
    pub prior: &'a Prior,
}

impl Model<'_> {
    /// Adjusts from `start`; `None` if the parameters are not determined.
    #[must_use]
    pub fn adjust(&self, buildings: Vec<Building>, start: &ExteriorOrientation) -> Option<Adjustment> {
        let shift_prior = self.shift_prior(&buildings, start)?;
        let (mut orientation, mut buildings) = (*start, buildings);
        for weighting in STEPS {
            let excess = shift_prior.excess(&shifts_px(&buildings));
            orientation = self.step(&shift_prior, &mut buildings, &orientation, weighting, &excess)?;
        }
        let excess = shift_prior.excess(&shifts_px(&buildings));
        self.ended(&shift_prior, buildings, orientation, excess)
    }

    /// One step of the orientation and of the shifts.
    fn step(
        &self,
        shift_prior: &ShiftPrior,
        buildings: &mut [Building],
        at: &ExteriorOrientation,
        weighting: Weighting,
        excess: &[f64],
    ) -> Option<ExteriorOrientation> {
        let linear = self.linearised(buildings, at, weighting);
        let information = shift_prior.information(excess)?;
        let reduced = self.reduced(&information, buildings, &linear, at)?;
        let step = reduced.equations.solve()?;
        for (building, step) in buildings.iter_mut().zip(reduced.shift_steps(&step)) {
            building.shift_px += step;
        }
        Some(at.moved(&step))
    }

    fn ended(
        &self,
        shift_prior: &ShiftPrior,
        buildings: Vec<Building>,
        orientation: ExteriorOrientation,
        excess: Vec<f64>,
    ) -> Option<Adjustment> {
        let linear = self.linearised(&buildings, &orientation, Weighting::Rejecting);
        let information = shift_prior.information(&excess)?;
        let reduced = self.reduced(&information, &buildings, &linear, &orientation)?;
        let away = orientation.step_to(&self.prior.orientation);
        let squares = linear.iter().map(|l| l.squares).sum::<f64>()
            + shifts::squares(&information, &shifts_px(&buildings))
            + away.dot(&(self.prior.information * away));
        // the shifts are as many unknowns as their priors are observations, and so are the six parameters
        let redundancy = linear.iter().map(|l| l.observations).sum::<usize>();
        Some(Adjustment {
            orientation,
            covariance: reduced.equations.inverse()?,
            squares,
            redundancy,
            kept: linear.into_iter().map(|l| l.kept).collect(),
            buildings,
            excess,
        })
    }

    pub(super) fn shift_prior(&self, buildings: &[Building], at: &ExteriorOrientation) -> Option<ShiftPrior> {
        let control = || buildings.iter().map(|building| &self.control[building.control_point]);
        let places: Option<Vec<_>> = control().map(|point| at.reduced_px(1.0, point.reference_m)).collect();
        let stated_px2 = control().map(|point| {
            // a scene has no edges that could have errors of their own
            let share = if point.scene.is_some() { 1.0 } else { SHARE_OF_THE_BUILDING };
            share * sigma_control_px(self.camera, point, at).powi(2)
        });
        let of_camera = |a, b| self.camera.interior_covariance_px2(a, b);
        Some(ShiftPrior::new(&places?, &stated_px2.collect::<Vec<f64>>(), of_camera))
    }

    /// The normal equations of the six parameters.
    fn reduced(
        &self,
        information: &DMatrix<f64>,
        buildings: &[Building],
        linear: &[Linear],
        at: &ExteriorOrientation,
    ) -> Option<Reduced> {
        let of_buildings: Vec<BuildingEquations> = linear.iter().map(|l| l.equations.clone()).collect();
        let mut reduced = shifts::eliminated(&of_buildings, information, &shifts_px(buildings))?;
        reduced.equations.add_prior(self.prior, at);
        Some(reduced)
    }

    pub(super) fn linearised(
        &self,
        buildings: &[Building],
        at: &ExteriorOrientation,
        weighting: Weighting,
    ) -> Vec<Linear> {
        buildings.iter().map(|building| self.linear(building, at, weighting)).collect()
    }

    fn linear(&self, building: &Building, at: &ExteriorOrientation, weighting: Weighting) -> Linear {
        let control_point = &self.control[building.control_point];
        let in_image_px = |sigma_m| sigma_in_image_px(self.camera, control_point, at, sigma_m);
        let sigma_control_px = in_image_px(control_point.sigma_m);
        let mut linear = Linear::default();
        let mut length_px = vec![0.0; control_point.edges_m.len()];
        for found in &building.matches {
            length_px[found.edge] += self.observed[found.segment].length_px;
        }
        for found in &building.matches {
            // an end of the edge behind the camera
            let Some(piece) = self.piece(building, found, at) else {
                linear.kept.push(false);
                continue;
            };
            let share = self.observed[found.segment].length_px / length_px[found.edge];
            let sigma_edge_px = in_image_px(control_point.edge_sigma_m(found.edge));
            let variance = EdgeVariance::of_piece(sigma_control_px, sigma_edge_px, share);
            linear.add(&piece, variance, weighting);
        }
        if let Some(measured) = &building.measured {
            let c = self.camera.principal_distance_px;
            match at.reduced_px_with_jacobian(c, control_point.reference_m) {
                Some((image, jacobian)) => {
                    linear.add_point(measured, image + building.shift_px, &jacobian, weighting);
                }
                None => linear.kept.push(false),
            }
        }
        linear
    }

    fn piece(&self, building: &Building, found: &Match, at: &ExteriorOrientation) -> Option<Piece> {
        let edge = &self.control[building.control_point].edges_m[found.edge];
        let c = self.camera.principal_distance_px;
        let (start, by_start) = at.reduced_px_with_jacobian(c, edge.start)?;
        let (end, by_end) = at.reduced_px_with_jacobian(c, edge.end)?;
        let (start, end) = (start + building.shift_px, end + building.shift_px);
        let segment = &self.observed[found.segment];
        let along = (end - start).try_normalize(1e-6)?;
        let length = (end - start).norm();
        let ends = [segment.segment_px.start, segment.segment_px.end];
        let at = ends.map(|p| along.dot(&(p - start)) / length);
        Some(Piece { start, by_start, by_end, along, ends, at, covariance: segment.covariance_across })
    }
}

/// An image segment with the projected edge that it is a piece of.
struct Piece {
    start: Vector2<f64>,
    by_start: Matrix2x6<f64>,
    by_end: Matrix2x6<f64>,
    along: Vector2<f64>,
    ends: [Vector2<f64>; 2],
    at: [f64; 2],
    covariance: Matrix2<f64>,
}

/// The stated accuracy of a control point's coordinates, in the image.
pub(super) fn sigma_control_px(camera: &Camera, control_point: &ControlPoint, at: &ExteriorOrientation) -> f64 {
    sigma_in_image_px(camera, control_point, at, control_point.sigma_m)
}

/// A standard deviation in metres at a control point, in the image.
pub(super) fn sigma_in_image_px(
    camera: &Camera,
    control_point: &ControlPoint,
    at: &ExteriorOrientation,
    sigma_m: f64,
) -> f64 {
    let depth_m = -at.camera_coordinates(control_point.reference_m).z;
    sigma_m * camera.principal_distance_px / depth_m.max(1.0)
}

fn shifts_px(buildings: &[Building]) -> Vec<Vector2<f64>> {
    buildings.iter().map(|building| building.shift_px).collect()
}

/// Variances of an edge across itself, px².
#[derive(Debug, Clone, Copy)]
struct EdgeVariance {
    /// Of a shift of the whole edge.
    whole: f64,
    /// Of each of its ends.
    end: f64,
}

impl EdgeVariance {
    /// Of a piece that is a share of all that was found of an edge: the pieces have its errors in common, and together
    /// they count as one. By what an edge is worse than the coordinates in general it is shifted as a whole: the eave is
    /// parallel to the wall.
    fn of_piece(sigma_control_px: f64, sigma_edge_px: f64, share: f64) -> Self {
        let stated = sigma_control_px.min(sigma_edge_px).powi(2);
        let own = sigma_edge_px.powi(2) - stated;
        Self {
            whole: (WHOLE_EDGE_PX2 + SHARE_OF_THE_EDGE * stated + own) / share,
            end: (END_PX2 + SHARE_OF_THE_END * stated) / share,
        }
    }
}

/// The linearised observations of a building, and what became of them.
#[derive(Default)]
pub(super) struct Linear {
    pub(super) equations: BuildingEquations,
    squares: f64,
    observations: usize,
    kept: Vec<bool>,
}

impl Linear {
    fn add_point(
        &mut self,
        measured: &Measured,
        image_px: Vector2<f64>,
        jacobian: &Matrix2x6<f64>,
        weighting: Weighting,
    ) {
        let misclosure = measured.at_px - image_px;
        let Some(weights) = measured.covariance.try_inverse() else {
            self.kept.push(false);
            return;
        };
        let squares = misclosure.dot(&(weights * misclosure));
        let factor = weighting.factor(squares / 2.0);
        self.kept.push(factor > 0.1);
        self.equations.add(jacobian, &Matrix2::identity(), &misclosure, &(weights * factor));
        self.squares += factor * squares;
        self.observations += if factor > 0.0 { 2 } else { 0 };
    }

    fn add(&mut self, piece: &Piece, edge: EdgeVariance, weighting: Weighting) {
        let normal = RowVector2::new(-piece.along.y, piece.along.x);
        let mut jacobian = Matrix2x6::zeros();
        let mut model = Matrix2::zeros();
        let mut misclosure = Vector2::zeros();
        for (row, (end, at)) in piece.ends.iter().zip(piece.at).enumerate() {
            jacobian.set_row(row, &(normal * (piece.by_start * (1.0 - at) + piece.by_end * at)));
            misclosure[row] = (normal * (end - piece.start)).x;
            model.set_row(row, &RowVector2::new(1.0 - at, at));
        }
        let covariance = piece.covariance + model * model.transpose() * edge.end + Matrix2::from_element(edge.whole);
        let Some(weights) = covariance.try_inverse() else {
            self.kept.push(false);
            return;
        };
        let squares = misclosure.dot(&(weights * misclosure));
        let factor = weighting.factor(squares / 2.0);
        self.kept.push(factor > 0.1);
        self.equations.add(&jacobian, &Matrix2::from_rows(&[normal, normal]), &misclosure, &(weights * factor));
        self.squares += factor * squares;
        self.observations += if factor > 0.0 { 2 } else { 0 };
    }
}
