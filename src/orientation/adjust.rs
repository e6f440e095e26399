//! Robust maximum-likelihood adjustment with all line segments (Förstner and Läbe step 3; Schickler 1992).
//!
//! Observed are the distances of a segment's ends from the projected edge, with the segment's covariance and the
//! uncertainty of the edge's own ends. Nothing is observed along the edge: where a segment ends says little about
//! where the edge ends (on real photographs the ends, even released one by one as in Schickler, made the result
//! worse), and so a part of an edge serves as well as the whole. What the edges of one building have in common, an
//! error of the model or a gutter taken for the rim of the roof, is an unknown shift of the building in the image with
//! a prior: so a building of thirty edges does not outvote three of five.

use nalgebra::{Matrix2, Matrix2x6, Matrix6, Matrix6x2, RowVector2, Vector2, Vector6};

use super::ControlPoint;
use super::extract::ObservedSegment;
use super::matching::Match;
use super::predict::Prediction;
use crate::estimation::robust::Weighting;
use crate::estimation::{NormalEquations, Prior};
use crate::geometry::{Camera, ExteriorOrientation};

/// What a building takes to the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Index of the control point.
    pub control_point: usize,
    /// Its matched pieces; `Match::edge` counts its edges.
    pub matches: Vec<Match>,
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
    /// For each building whether each of its matches kept its weight.
    pub kept: Vec<Vec<bool>>,
}

impl Adjustment {
    /// The square root of the variance factor.
    #[must_use]
    pub fn sigma0(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.squares / self.redundancy as f64).sqrt() }
    }

    /// For predicting with it: its covariance is scaled where the observations fit worse than was assumed.
    #[must_use]
    pub fn prediction(&self) -> Prediction {
        let inflation = self.sigma0().max(1.0).powi(2);
        Prediction { orientation: self.orientation, covariance: self.covariance * inflation }
    }
}

/// Standard deviation of the shift that all edges of a building share, beside that of its coordinates: 1 to 3 px
/// were seen on real photographs (`../shared/bench/README.md`).
pub const SIGMA_SHIFT_PX: f64 = 1.0;
/// Which of the lines along the rim of a roof was measured as the edge, and which one the image shows, adds to the
/// stated accuracy of the coordinates.
const EDGE_DEFINITION: f64 = 1.5;
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
    /// Adjusts from `start`; `None` if the parameters are not determined or an edge comes to lie behind the camera.
    #[must_use]
    pub fn adjust(&self, buildings: Vec<Building>, start: &ExteriorOrientation) -> Option<Adjustment> {
        let mut orientation = *start;
        let mut buildings = buildings;
        for weighting in STEPS {
            let linear = self.linearised(&buildings, &orientation, weighting)?;
            let step = self.equations(&linear, &orientation).solve()?;
            orientation = orientation.moved(&step);
            for (building, own) in buildings.iter_mut().zip(&linear) {
                building.shift_px += own.shift_step(&step)?;
            }
        }
        let linear = self.linearised(&buildings, &orientation, Weighting::Rejecting)?;
        let equations = self.equations(&linear, &orientation);
        let away = orientation.step_to(&self.prior.orientation);
        let squares = linear.iter().map(|l| l.squares).sum::<f64>() + away.dot(&(self.prior.information * away));
        // the shifts are as many unknowns as their priors are observations, and so are the six parameters
        let redundancy = linear.iter().map(|l| l.observations).sum::<usize>();
        Some(Adjustment {
            orientation,
            covariance: equations.inverse()?,
            squares,
            redundancy,
            kept: linear.into_iter().map(|l| l.kept).collect(),
            buildings,
        })
    }

    fn linearised(
        &self,
        buildings: &[Building],
        at: &ExteriorOrientation,
        weighting: Weighting,
    ) -> Option<Vec<Linear>> {
        buildings.iter().map(|building| self.linear(building, at, weighting)).collect()
    }

    fn equations(&self, linear: &[Linear], at: &ExteriorOrientation) -> NormalEquations {
        let mut equations = NormalEquations::new();
        equations.add_prior(self.prior, at);
        for building in linear {
            building.reduce_into(&mut equations);
        }
        equations
    }

    /// Standard deviation in the image of the edges of a control point.
    fn sigma_model_px(&self, control_point: &ControlPoint, at: &ExteriorOrientation) -> f64 {
        let depth_m = -at.camera_coordinates(control_point.reference_m).z;
        EDGE_DEFINITION * control_point.sigma_m * self.camera.principal_distance_px / depth_m.max(1.0)
    }

    fn linear(&self, building: &Building, at: &ExteriorOrientation, weighting: Weighting) -> Option<Linear> {
        let control_point = &self.control[building.control_point];
        let sigma_model_px = self.sigma_model_px(control_point, at);
        // the stated accuracy of the coordinates moves the building as a whole as well
        let shift_sigma_px = (sigma_model_px / EDGE_DEFINITION).hypot(SIGMA_SHIFT_PX);
        let mut linear = Linear::with_prior(building.shift_px, shift_sigma_px);
        let mut pieces = vec![0_u32; control_point.edges_m.len()];
        for found in &building.matches {
            pieces[found.edge] += 1;
        }
        for found in &building.matches {
            let piece = self.piece(building, found, at)?;
            // the pieces of one edge share its errors: together they count as one
            let variance = sigma_model_px.powi(2) * f64::from(pieces[found.edge]);
            linear.add(&piece, variance, weighting);
        }
        Some(linear)
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

/// The linearised observations of a building: six parameters and its shift.
struct Linear {
    matrix: Matrix6<f64>,
    right_side: Vector6<f64>,
    coupling: Matrix6x2<f64>,
    shift_matrix: Matrix2<f64>,
    shift_right_side: Vector2<f64>,
    squares: f64,
    observations: usize,
    kept: Vec<bool>,
}

impl Linear {
    fn with_prior(shift_px: Vector2<f64>, sigma_px: f64) -> Self {
        let information = sigma_px.powi(-2);
        Self {
            matrix: Matrix6::zeros(),
            right_side: Vector6::zeros(),
            coupling: Matrix6x2::zeros(),
            shift_matrix: Matrix2::identity() * information,
            shift_right_side: -shift_px * information,
            squares: shift_px.norm_squared() * information,
            observations: 0,
            kept: Vec::new(),
        }
    }

    fn add(&mut self, piece: &Piece, model_variance: f64, weighting: Weighting) {
        let normal = RowVector2::new(-piece.along.y, piece.along.x);
        let mut jacobian = Matrix2x6::zeros();
        let mut model = Matrix2::zeros();
        let mut misclosure = Vector2::zeros();
        for (row, (end, at)) in piece.ends.iter().zip(piece.at).enumerate() {
            jacobian.set_row(row, &(normal * (piece.by_start * (1.0 - at) + piece.by_end * at)));
            misclosure[row] = (normal * (end - piece.start)).x;
            model.set_row(row, &RowVector2::new(1.0 - at, at));
        }
        let covariance = piece.covariance + model * model.transpose() * model_variance;
        let Some(weights) = covariance.try_inverse() else {
            self.kept.push(false);
            return;
        };
        let squares = misclosure.dot(&(weights * misclosure));
        let factor = weighting.factor(squares / 2.0);
        self.kept.push(factor > 0.1);
        let by_shift = Matrix2::from_rows(&[normal, normal]);
        let weights = weights * factor;
        self.matrix += jacobian.transpose() * weights * jacobian;
        self.right_side += jacobian.transpose() * weights * misclosure;
        self.coupling += jacobian.transpose() * weights * by_shift;
        self.shift_matrix += by_shift.transpose() * weights * by_shift;
        self.shift_right_side += by_shift.transpose() * weights * misclosure;
        self.squares += factor * squares;
        self.observations += if factor > 0.0 { 2 } else { 0 };
    }

    /// Eliminates the shift.
    fn reduce_into(&self, equations: &mut NormalEquations) {
        let Some(inverse) = self.shift_matrix.try_inverse() else { return };
        equations.matrix += self.matrix - self.coupling * inverse * self.coupling.transpose();
        equations.right_side += self.right_side - self.coupling * (inverse * self.shift_right_side);
    }

    /// The step of the shift that belongs to a step of the parameters.
    fn shift_step(&self, dx: &Vector6<f64>) -> Option<Vector2<f64>> {
        Some(self.shift_matrix.try_inverse()? * (self.shift_right_side - self.coupling.transpose() * dx))
    }
}
