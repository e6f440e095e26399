//! The lens of a film camera as calibration reports give it: principal distance and points in the plate, and a distortion
//! that corrects what was *measured*, in millimetres (method 4.2, 4.3).

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// Distortion as in the reports of the USGS (SMAC): with x, y measured from the point of symmetry in millimetres and
/// r² = x² + y², the corrected coordinates are
/// x (1 + k0 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + [p1 (r² + 2 x²) + 2 p2 x y] (1 + p3 r² + p4 r⁴), and y alike.
/// What a report tabulates as radial distortion is the negative of the polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Smac {
    /// Radial coefficients, of 1, r², r⁴, r⁶, r⁸.
    pub k: [f64; 5],
    /// Decentring coefficients.
    pub p: [f64; 4],
}

/// The lens of a film camera. Coordinates are in the plate: millimetres, x in the direction of flight, y to its left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Film {
    /// Calibrated principal distance.
    pub principal_distance_mm: f64,
    /// Principal point of autocollimation: the foot of the perpendicular from the projection centre.
    pub principal_point_mm: Vector2<f64>,
    /// Principal point of symmetry: the centre of the distortion.
    pub symmetry_point_mm: Vector2<f64>,
    /// Distortion.
    pub distortion: Smac,
    /// Width (x) and height (y) of the image on the film, about the plate's origin.
    pub format_mm: [f64; 2],
}

/// Why a lens cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// Not a positive, finite length.
    #[error("{name} is {value} mm; it must be positive and finite")]
    NotPositive {
        /// The parameter's name in the contract.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A parameter is not a number.
    #[error("{name} is not a finite number")]
    NotFinite {
        /// The parameter's name in the contract.
        name: &'static str,
    },
    /// A point lies outside the image.
    #[error("{name} is ({x_mm}, {y_mm}) mm, which is outside the image on the film")]
    Outside {
        /// The parameter's name in the contract.
        name: &'static str,
        /// Its coordinates.
        x_mm: f64,
        /// Its coordinates.
        y_mm: f64,
    },
    /// Two places of the scene would fall on the same place of the film.
    #[error("the distortion folds the image at ({x_mm:.0}, {y_mm:.0}) mm: it cannot be inverted there")]
    Folds {
        /// Where.
        x_mm: f64,
        /// Where.
        y_mm: f64,
    },
    /// The table of the distortion does not determine its polynomial.
    #[error("the table of the distortion needs at least {least} different radii above 0, and as many values as radii")]
    Table {
        /// Rows that are needed.
        least: usize,
    },
}

const INVERSION_STEPS: usize = 20;
const INVERSION_TOLERANCE_MM: f64 = 1e-9;
/// Places along each side at which the distortion must be invertible.
const CHECKED: u32 = 16;
/// Powers of a table's polynomial: r, r³, r⁵, r⁷.
const POWERS: usize = 4;

impl Smac {
    /// From a table of radial distortion, as reports before the polynomials have it: odd powers of the radius by least
    /// squares, as many as the table determines, at most four.
    ///
    /// # Errors
    /// [`FilmError::Table`] if there are too few rows.
    pub fn of_table(radius_mm: &[f64], distortion_mm: &[f64]) -> Result<Self, FilmError> {
        let rows: Vec<(f64, f64)> =
            radius_mm.iter().zip(distortion_mm).filter(|(r, _)| **r > 0.0).map(|(r, d)| (*r, *d)).collect();
        let least = 2;
        let powers = POWERS.min(rows.len().saturating_sub(1)).max(1);
        let finite = rows.iter().all(|(r, d)| r.is_finite() && d.is_finite());
        if radius_mm.len() != distortion_mm.len() || rows.len() < least || !finite {
            return Err(FilmError::Table { least });
        }
        // in units of the largest radius, so that the powers are of one size
        let largest = rows.iter().map(|(r, _)| *r).fold(0.0, f64::max);
        let design = DMatrix::from_fn(rows.len(), powers, |i, j| (rows[i].0 / largest).powi(2 * j as i32 + 1));
        let values = DVector::from_iterator(rows.len(), rows.iter().map(|(_, d)| -d));
        let decomposed = design.svd(true, true);
        if decomposed.rank(1e-9) < powers {
            return Err(FilmError::Table { least });
        }
        let solved = decomposed.solve(&values, 1e-12).map_err(|_| FilmError::Table { least })?;
        let mut k = [0.0; 5];
        for (j, (k, value)) in k.iter_mut().zip(solved.iter()).enumerate() {
            *k = value / largest.powi(2 * j as i32 + 1);
        }
        Ok(Self { k, p: [0.0; 4] })
    }

    fn radial(&self, r2: f64) -> f64 {
        self.k.iter().rev().fold(0.0, |sum, k| sum * r2 + k)
    }

    /// What corrects a measured place, both from the point of symmetry.
    fn correction(&self, measured: Vector2<f64>) -> Vector2<f64> {
        let (x, y, r2) = (measured.x, measured.y, measured.norm_squared());
        let [p1, p2, p3, p4] = self.p;
        let decentring =
            Vector2::new(p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y, 2.0 * p1 * x * y + p2 * (r2 + 2.0 * y * y));
        measured * self.radial(r2) + decentring * (1.0 + r2 * (p3 + r2 * p4))
    }
}

impl Film {
    /// A lens whose parameters are finite and whose distortion can be inverted all over the image.
    ///
    /// # Errors
    /// [`FilmError`] names the parameter that is at fault.
    pub fn new(
        principal_distance_mm: f64,
        principal_point_mm: Vector2<f64>,
        symmetry_point_mm: Vector2<f64>,
        distortion: Smac,
        format_mm: [f64; 2],
    ) -> Result<Self, FilmError> {
        let lengths = [
            ("principal_distance_mm", principal_distance_mm),
            ("format_mm", format_mm[0]),
            ("format_mm", format_mm[1]),
        ];
        if let Some((name, value)) = lengths.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            return Err(FilmError::NotPositive { name, value });
        }
        if distortion.k.iter().chain(&distortion.p).any(|value| !value.is_finite()) {
            return Err(FilmError::NotFinite { name: "distortion" });
        }
        for (name, point) in [("principal_point_mm", principal_point_mm), ("symmetry_point_mm", symmetry_point_mm)] {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(FilmError::NotFinite { name });
            }
            if point.x.abs() >= format_mm[0] / 2.0 || point.y.abs() >= format_mm[1] / 2.0 {
                return Err(FilmError::Outside { name, x_mm: point.x, y_mm: point.y });
            }
        }
        let film = Self { principal_distance_mm, principal_point_mm, symmetry_point_mm, distortion, format_mm };
        film.check_inverse()?;
        Ok(film)
    }

    /// Where an undistorted image would have had a measured place of the plate.
    #[must_use]
    pub fn corrected_mm(&self, measured_mm: Vector2<f64>) -> Vector2<f64> {
        measured_mm + self.distortion.correction(measured_mm - self.symmetry_point_mm)
    }

    /// The inverse of [`Film::corrected_mm`], by Newton's method; `None` where the distortion cannot be inverted.
    #[must_use]
    pub fn measured_mm(&self, corrected_mm: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut measured = corrected_mm;
        for _ in 0..INVERSION_STEPS {
            let step = self.jacobian(measured).try_inverse()? * (corrected_mm - self.corrected_mm(measured));
            measured += step;
            if !measured.iter().all(|value| value.is_finite()) {
                return None;
            }
            if step.norm() < INVERSION_TOLERANCE_MM {
                // past a fold Newton may end on the wrong branch, where the mapping turns over
                return (self.jacobian(measured).determinant() > 0.0).then_some(measured);
            }
        }
        None
    }

    /// The angle between the axis and the ray of the corner of the image that is farthest from it.
    #[must_use]
    pub fn half_view_rad(&self) -> f64 {
        let away = |corner: Vector2<f64>| (self.corrected_mm(corner) - self.principal_point_mm).norm();
        (self.places_mm(1).map(away).fold(0.0, f64::max) / self.principal_distance_mm).atan()
    }

    /// Whether the distortion does not turn over at a measured place.
    pub(super) fn is_unfolded(&self, measured_mm: Vector2<f64>) -> bool {
        self.jacobian(measured_mm).determinant() > 0.0
    }

    /// Derivatives of the corrected by the measured place.
    fn jacobian(&self, measured_mm: Vector2<f64>) -> Matrix2<f64> {
        // millimetres: the differences are exact to far more than Newton's method needs
        const STEP_MM: f64 = 1e-3;
        let along = |axis: usize| {
            let step = Vector2::ith(axis, STEP_MM);
            (self.corrected_mm(measured_mm + step) - self.corrected_mm(measured_mm - step)) / (2.0 * STEP_MM)
        };
        Matrix2::from_columns(&[along(0), along(1)])
    }

    /// Places of the plate all over the image, `steps` + 1 along each side.
    pub(crate) fn places_mm(&self, steps: u32) -> impl Iterator<Item = Vector2<f64>> {
        let [width, height] = self.format_mm;
        let at = move |k: u32, side: f64| side * (f64::from(k) / f64::from(steps) - 0.5);
        (0..=steps).flat_map(move |i| (0..=steps).map(move |j| Vector2::new(at(i, width), at(j, height))))
    }

    fn check_inverse(&self) -> Result<(), FilmError> {
        for place in self.places_mm(CHECKED) {
            let returns = self.measured_mm(self.corrected_mm(place)).is_some_and(|back| (back - place).norm() < 1e-6);
            if !returns {
                return Err(FilmError::Folds { x_mm: place.x, y_mm: place.y });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RC30: Film = Film {
        principal_distance_mm: 153.0,
        principal_point_mm: Vector2::new(0.004, -0.002),
        symmetry_point_mm: Vector2::new(0.010, 0.006),
        distortion: Smac { k: [2e-5, -3e-9, 8e-14, 0.0, 0.0], p: [1e-8, -2e-8, 1e-6, 0.0] },
        format_mm: [230.0, 230.0],
    };

    #[test]
    fn the_correction_is_the_formula_of_the_reports() {
        let (x, y) = (80.0 - 0.010, -95.0 - 0.006);
        let r2: f64 = x * x + y * y;
        let radial = 2e-5 - 3e-9 * r2 + 8e-14 * r2 * r2;
        let decentring = 1.0 + 1e-6 * r2;
        let dx = x * radial + (1e-8 * (r2 + 2.0 * x * x) - 4e-8 * x * y) * decentring;
        let dy = y * radial + (2e-8 * x * y - 2e-8 * (r2 + 2.0 * y * y)) * decentring;
        let corrected = RC30.corrected_mm(Vector2::new(80.0, -95.0));
        assert!((corrected - Vector2::new(80.0 + dx, -95.0 + dy)).norm() < 1e-12);
        let back = RC30.measured_mm(corrected).unwrap();
        assert!((back - Vector2::new(80.0, -95.0)).norm() < 1e-8);
    }

    /// Method 4.3: at 7.5 to 40 degrees the polynomial of OSL/3221 gives +1.3, +2.4, +3.1, +2.6, +1.0, -2.9 micrometres,
    /// its table -1, -2, -3, -3, -1, +3.
    #[test]
    fn a_table_is_the_negative_of_its_polynomial() {
        let degrees = [7.5_f64, 15.0, 22.7, 30.0, 35.0, 40.0];
        let radii: Vec<f64> = degrees.iter().map(|degrees| 153.0 * degrees.to_radians().tan()).collect();
        let table: Vec<f64> = [-1.3, -2.4, -3.1, -2.6, -1.0, 2.9].iter().map(|um| um * 1e-3).collect();
        let distortion = Smac::of_table(&radii, &table).unwrap();
        let film = Film::new(153.0, Vector2::zeros(), Vector2::zeros(), distortion, [230.0, 230.0]).unwrap();
        for (radius, um) in radii.iter().zip([1.3, 2.4, 3.1, 2.6, 1.0, -2.9]) {
            let moved = film.corrected_mm(Vector2::new(*radius, 0.0)).x - radius;
            assert!((moved * 1e3 - um).abs() < 0.35, "{radius}: {moved}");
        }
        assert!(Smac::of_table(&[0.0, 50.0], &[0.0, 1e-3]).is_err());
        assert!(Smac::of_table(&[10.0, 50.0], &[1e-3]).is_err());
    }

    #[test]
    fn lenses_that_make_no_sense_are_refused() {
        let new = |c, p: [f64; 2], k1| {
            let distortion = Smac { k: [0.0, k1, 0.0, 0.0, 0.0], p: [0.0; 4] };
            Film::new(c, p.into(), p.into(), distortion, [230.0, 230.0])
        };
        assert!(new(153.0, [0.01, 0.0], 1e-9).is_ok());
        assert!(matches!(
            new(-153.0, [0.0; 2], 0.0),
            Err(FilmError::NotPositive { name: "principal_distance_mm", .. })
        ));
        assert!(matches!(new(153.0, [120.0, 0.0], 0.0), Err(FilmError::Outside { name: "principal_point_mm", .. })));
        assert!(matches!(new(153.0, [0.0; 2], f64::NAN), Err(FilmError::NotFinite { .. })));
        assert!(matches!(new(153.0, [0.0; 2], -1e-3), Err(FilmError::Folds { .. })));
    }
}
