//! From the plate to the scan: similarity, affine or projective, with its covariance.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2};

/// How the film may be deformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Shift, turn and one scale: four parameters.
    Similarity,
    /// Also different scales and a shear, as films shrink: six.
    Affine,
    /// Also a tilt: eight.
    Projective,
}

impl Kind {
    /// Unknowns.
    #[must_use]
    pub fn parameters(self) -> usize {
        match self {
            Self::Similarity => 4,
            Self::Affine => 6,
            Self::Projective => 8,
        }
    }

    /// Its name in requests and answers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Similarity => "similarity",
            Self::Affine => "affine",
            Self::Projective => "projective",
        }
    }
}

/// A mark in both frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// In the plate.
    pub plate_mm: Vector2<f64>,
    /// In the scan.
    pub image_px: Vector2<f64>,
    /// Of their difference, in the scan: what was measured, what is calibrated, and what the film does.
    pub covariance_px2: Matrix2<f64>,
}

/// The plate in units in which its coordinates are about 1, so that all parameters are pixels at the marks.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    centre_mm: Vector2<f64>,
    radius_mm: f64,
    /// Similarities have no reflection of their own: -1 where the plate's y axis must be turned down first.
    sign: f64,
}

/// An estimated transformation.
#[derive(Debug, Clone, PartialEq)]
pub struct Transformation {
    /// Its kind.
    pub kind: Kind,
    unit: Unit,
    parameters: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Weighted sum of squared residuals.
    pub squares: f64,
    /// Observations less unknowns.
    pub redundancy: usize,
}

const STEPS: usize = 8;

impl Transformation {
    /// The most likely one; `None` if the marks do not determine it. `mirrored`: the scan is wrong-reading.
    #[must_use]
    pub fn fit(kind: Kind, mirrored: bool, observations: &[Observation]) -> Option<Self> {
        let count = kind.parameters();
        if 2 * observations.len() < count {
            return None;
        }
        let unit = Unit::of(observations, mirrored)?;
        let mut parameters = match kind {
            // a tilt is seen only where there is an image
            Kind::Projective => {
                Self::fit(Kind::Affine, mirrored, observations)?.parameters.resize_vertically(count, 0.0)
            }
            _ => DVector::zeros(count),
        };
        let steps = if kind == Kind::Projective { STEPS } else { 1 };
        let mut normal = DMatrix::zeros(count, count);
        for step in 0..=steps {
            normal = DMatrix::zeros(count, count);
            let mut right = DVector::zeros(count);
            for observation in observations {
                let place = unit.place(observation.plate_mm);
                let design = design(kind, place, &parameters);
                let weight = observation.covariance_px2.try_inverse()?;
                let misclosure = observation.image_px - image(kind, place, &parameters);
                normal += design.transpose() * weight * &design;
                right += design.transpose() * weight * misclosure;
            }
            if step < steps {
                parameters += inverse(&normal)? * right;
            }
        }
        let covariance = inverse(&normal)?;
        let mut fitted =
            Self { kind, unit, parameters, covariance, squares: 0.0, redundancy: 2 * observations.len() - count };
        fitted.squares = observations.iter().filter_map(|o| fitted.squares_of(o)).sum();
        fitted.parameters.iter().all(|p| p.is_finite()).then_some(fitted)
    }

    fn squares_of(&self, observation: &Observation) -> Option<f64> {
        let residual = self.residual_px(observation);
        Some(residual.dot(&(observation.covariance_px2.try_inverse()? * residual)))
    }

    /// The pixel of a point of the plate.
    #[must_use]
    pub fn pixel_from_plate(&self, plate_mm: Vector2<f64>) -> Vector2<f64> {
        image(self.kind, self.unit.place(plate_mm), &self.parameters)
    }

    /// Where a mark was found, less where the transformation has it.
    #[must_use]
    pub fn residual_px(&self, observation: &Observation) -> Vector2<f64> {
        observation.image_px - self.pixel_from_plate(observation.plate_mm)
    }

    /// The covariance of a point's pixel, of the transformation alone.
    #[must_use]
    pub fn covariance_px2(&self, plate_mm: Vector2<f64>) -> Matrix2<f64> {
        let design = self.design_at(plate_mm);
        let covariance = &design * &self.covariance * design.transpose();
        Matrix2::new(covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 0)], covariance[(1, 1)])
    }

    /// Derivatives of a point's pixel by the parameters.
    pub(super) fn design_at(&self, plate_mm: Vector2<f64>) -> DMatrix<f64> {
        design(self.kind, self.unit.place(plate_mm), &self.parameters)
    }

    /// Covariance of the parameters.
    pub(super) fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// The square root of the variance factor; 1 without redundancy.
    #[must_use]
    pub fn sigma0(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.squares / self.redundancy as f64).sqrt() }
    }

    /// As a matrix for homogeneous coordinates, from millimetres to pixels, its last element being 1 (scaled so).
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        let p = &self.parameters;
        let unit = match self.kind {
            Kind::Similarity => {
                let s = self.unit.sign;
                Matrix3::new(p[2], -s * p[3], p[0], p[3], s * p[2], p[1], 0.0, 0.0, 1.0)
            }
            Kind::Affine => Matrix3::new(p[2], p[3], p[0], p[4], p[5], p[1], 0.0, 0.0, 1.0),
            Kind::Projective => Matrix3::new(p[2], p[3], p[0], p[4], p[5], p[1], p[6], p[7], 1.0),
        };
        let (r, c) = (self.unit.radius_mm, self.unit.centre_mm);
        let from_plate = Matrix3::new(1.0 / r, 0.0, -c.x / r, 0.0, 1.0 / r, -c.y / r, 0.0, 0.0, 1.0);
        let matrix = unit * from_plate;
        matrix / matrix[(2, 2)]
    }

    /// Covariance of the image displacement `(d0 + d1 x + d2 y)` about the plate's origin: of the matrix's elements
    /// `[a11, a12, a13, a21, a22, a23]` (pixels per millimetre, pixels), to first order there.
    #[must_use]
    pub fn covariance_of_affine(&self) -> nalgebra::Matrix6<f64> {
        // the displacements of three points determine those of all
        let corners = [Vector2::zeros(), Vector2::new(1.0, 0.0), Vector2::new(0.0, 1.0)];
        let mut design = DMatrix::zeros(6, self.kind.parameters());
        for (k, corner) in corners.iter().enumerate() {
            let rows = self::design(self.kind, self.unit.place(*corner), &self.parameters);
            design.rows_mut(2 * k, 2).copy_from(&rows);
        }
        #[rustfmt::skip]
        let from_displacements = nalgebra::Matrix6::new(
            -1.0, 0.0, 1.0, 0.0, 0.0, 0.0,
            -1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
            1.0, 0.0, 0.0, 0.0, 0.0, 0.0,
            0.0, -1.0, 0.0, 1.0, 0.0, 0.0,
            0.0, -1.0, 0.0, 0.0, 0.0, 1.0,
            0.0, 1.0, 0.0, 0.0, 0.0, 0.0,
        );
        let elements = from_displacements * design;
        let covariance = &elements * &self.covariance * elements.transpose();
        nalgebra::Matrix6::from_iterator(covariance.iter().copied())
    }

    /// Pixels along each of the plate's axes for a millimetre, and by how much their angle exceeds a right one (radians).
    #[must_use]
    pub fn shape(&self) -> ([f64; 2], f64) {
        let origin = self.pixel_from_plate(Vector2::zeros());
        let axis = |unit: Vector2<f64>| self.pixel_from_plate(unit) - origin;
        let (x, y) = (axis(Vector2::x()), axis(Vector2::y()));
        let sine = x.dot(&y) / (x.norm() * y.norm());
        ([x.norm(), y.norm()], -sine.clamp(-1.0, 1.0).asin())
    }

    /// How much less precise it is without some observations: `lambda_max` of `(C' - C) C^-1` (method 1.9).
    pub(super) fn loss_without(&self, rest: &Self) -> Option<f64> {
        // both in the parameters of this one: the displacements of as many points as determine them
        let lost = rest.in_parameters_of(self)? - &self.covariance;
        let root = self.covariance.clone().cholesky()?;
        let half = root.l_dirty().solve_lower_triangular(&lost)?;
        let whole = root.l_dirty().solve_lower_triangular(&half.transpose())?;
        let loss = (&whole + whole.transpose()).symmetric_eigenvalues().max() / 2.0;
        Some(loss.max(0.0))
    }

    /// This covariance, expressed in the parameters of another transformation of the same kind.
    fn in_parameters_of(&self, other: &Self) -> Option<DMatrix<f64>> {
        let count = self.kind.parameters();
        let places = [(1.0, 0.3), (-1.0, 0.4), (0.2, 1.0), (-0.3, -1.0)];
        let stacked = |of: &Self| {
            let mut rows = DMatrix::zeros(8, count);
            for (k, (x, y)) in places.iter().enumerate() {
                let plate_mm = other.unit.centre_mm + Vector2::new(*x, *y) * other.unit.radius_mm;
                rows.rows_mut(2 * k, 2).copy_from(&design(of.kind, of.unit.place(plate_mm), &of.parameters));
            }
            rows
        };
        let (theirs, ours) = (stacked(other), stacked(self));
        let change = (theirs.transpose() * &theirs).cholesky()?.solve(&(theirs.transpose() * ours));
        Some(&change * &self.covariance * change.transpose())
    }
}

/// The inverse of a normal matrix; `None` if it is singular. Its parameters may be of very different sizes.
fn inverse(normal: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = normal.diagonal().map(|value| 1.0 / value.sqrt());
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| normal[(i, j)] * scale[i] * scale[j]);
    let eigenvalues = scaled.symmetric_eigenvalues();
    let determined = eigenvalues.min() > 1e-9 * eigenvalues.max();
    let inverse = determined.then(|| scaled.cholesky())??.inverse();
    Some(DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

impl Unit {
    fn of(observations: &[Observation], mirrored: bool) -> Option<Self> {
        let count = observations.len() as f64;
        let centre_mm = observations.iter().map(|o| o.plate_mm).sum::<Vector2<f64>>() / count;
        let squares: f64 = observations.iter().map(|o| (o.plate_mm - centre_mm).norm_squared()).sum();
        let radius_mm = (squares / count).sqrt();
        (radius_mm > 0.0).then_some(Self { centre_mm, radius_mm, sign: if mirrored { 1.0 } else { -1.0 } })
    }

    fn place(&self, plate_mm: Vector2<f64>) -> (Vector2<f64>, f64) {
        ((plate_mm - self.centre_mm) / self.radius_mm, self.sign)
    }
}

fn image(kind: Kind, (place, sign): (Vector2<f64>, f64), p: &DVector<f64>) -> Vector2<f64> {
    let (x, y) = (place.x, place.y);
    let shift = Vector2::new(p[0], p[1]);
    match kind {
        Kind::Similarity => shift + Vector2::new(p[2] * x - p[3] * sign * y, p[3] * x + p[2] * sign * y),
        Kind::Affine => shift + Vector2::new(p[2] * x + p[3] * y, p[4] * x + p[5] * y),
        Kind::Projective => {
            (shift + Vector2::new(p[2] * x + p[3] * y, p[4] * x + p[5] * y)) / (1.0 + p[6] * x + p[7] * y)
        }
    }
}

fn design(kind: Kind, (place, sign): (Vector2<f64>, f64), p: &DVector<f64>) -> DMatrix<f64> {
    let (x, y) = (place.x, place.y);
    match kind {
        Kind::Similarity => {
            let y = sign * y;
            DMatrix::from_row_slice(2, 4, &[1.0, 0.0, x, -y, 0.0, 1.0, y, x])
        }
        Kind::Affine => DMatrix::from_row_slice(2, 6, &[1.0, 0.0, x, y, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, y]),
        Kind::Projective => {
            let n = 1.0 / (1.0 + p[6] * x + p[7] * y);
            let at = image(kind, (place, sign), p);
            let (u, v) = (at.x * n, at.y * n);
            #[rustfmt::skip]
            let rows = [
                n, 0.0, x * n, y * n, 0.0, 0.0, -u * x, -u * y,
                0.0, n, 0.0, 0.0, x * n, y * n, -v * x, -v * y,
            ];
            DMatrix::from_row_slice(2, 8, &rows)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    fn plate() -> [Vector2<f64>; 8] {
        [
            (-106.0, -106.0),
            (106.0, 106.0),
            (-106.0, 106.0),
            (106.0, -106.0),
            (-113.0, 0.0),
            (113.0, 0.0),
            (0.0, 113.0),
            (0.0, -113.0),
        ]
        .map(|(x, y)| Vector2::new(x, y))
    }

    fn truth(place: Vector2<f64>) -> Vector2<f64> {
        Matrix2::new(50.1, 0.9, 0.8, -49.9) * place + Vector2::new(6000.0, 6100.0)
    }

    fn observed(draws: &mut Draws, places: &[Vector2<f64>], sigma: f64) -> Vec<Observation> {
        let observe = |plate_mm: &Vector2<f64>| Observation {
            plate_mm: *plate_mm,
            image_px: truth(*plate_mm) + Vector2::new(draws.normal(), draws.normal()) * sigma,
            covariance_px2: Matrix2::identity() * sigma * sigma,
        };
        places.iter().map(observe).collect()
    }

    type Mapping<'a> = &'a dyn Fn(Vector2<f64>) -> Vector2<f64>;

    #[test]
    fn every_kind_returns_itself() {
        let mut draws = Draws::new(1);
        let turned = |p: Vector2<f64>| {
            nalgebra::Rotation2::new(0.3) * Vector2::new(40.0 * p.x, -40.0 * p.y) + Vector2::new(9.0, 5.0)
        };
        let tilted = |p: Vector2<f64>| truth(p) / (1.0 + 1e-5 * p.x - 2e-5 * p.y);
        let mut exact = observed(&mut draws, &plate(), 1.0);
        let cases: [(Kind, Mapping); 3] =
            [(Kind::Similarity, &turned), (Kind::Affine, &truth), (Kind::Projective, &tilted)];
        for (kind, truth) in cases {
            exact.iter_mut().for_each(|o| o.image_px = truth(o.plate_mm));
            let fitted = Transformation::fit(kind, false, &exact).unwrap();
            let place = Vector2::new(31.0, -77.0);
            assert!((fitted.pixel_from_plate(place) - truth(place)).norm() < 1e-6, "{kind:?}");
            assert!(fitted.squares < 1e-9);
            let image = fitted.matrix() * place.push(1.0);
            assert!((image.xy() / image.z - truth(place)).norm() < 1e-6);
        }
        assert_eq!(Transformation::fit(Kind::Affine, false, &exact[..2]), None);
        // four on a line determine no affine
        let line: Vec<_> =
            (0..4).map(|k| Observation { plate_mm: Vector2::new(f64::from(k), 0.0), ..exact[0] }).collect();
        assert_eq!(Transformation::fit(Kind::Affine, false, &line), None);
    }

    #[test]
    fn points_scatter_as_their_covariance_says() {
        let mut draws = Draws::new(5);
        let place = Vector2::new(-80.0, 110.0);
        let (mut mahalanobis, mut squares, mut of_matrix) = (0.0, 0.0, 0.0);
        let runs = 2000;
        for _ in 0..runs {
            let fitted = Transformation::fit(Kind::Affine, false, &observed(&mut draws, &plate(), 0.2)).unwrap();
            let error = fitted.pixel_from_plate(place) - truth(place);
            mahalanobis += error.dot(&(fitted.covariance_px2(place).try_inverse().unwrap() * error));
            squares += fitted.squares;
            let m = fitted.matrix();
            let elements = nalgebra::Vector6::new(
                m[(0, 0)] - 50.1,
                m[(0, 1)] - 0.9,
                m[(0, 2)] - 6000.0,
                m[(1, 0)] - 0.8,
                m[(1, 1)] + 49.9,
                m[(1, 2)] - 6100.0,
            );
            of_matrix += elements.dot(&(fitted.covariance_of_affine().try_inverse().unwrap() * elements));
        }
        let mean = |sum: f64| sum / f64::from(runs);
        assert!((mean(mahalanobis) - 2.0).abs() < 0.15, "{}", mean(mahalanobis));
        assert!((mean(squares) - 10.0).abs() < 0.4);
        assert!((mean(of_matrix) - 6.0).abs() < 0.3);
    }
}
