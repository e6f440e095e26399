//! Places of marks from the distances between them: older calibrations give nothing else.
//!
//! Distances say nothing of where the figure lies and how it is turned. That is taken from the approximate places: their
//! centroid is kept, and on the whole nothing is turned (a free network with inner constraints). The scale is that of
//! the distances.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// A distance that was measured between two marks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Indices of the marks.
    pub between: [usize; 2],
    /// As measured.
    pub distance_mm: f64,
    /// Its standard deviation.
    pub sigma_mm: f64,
}

/// Adjusted places.
#[derive(Debug, Clone, PartialEq)]
pub struct Trilateration {
    /// In the order of the approximate ones.
    pub positions_mm: Vec<Vector2<f64>>,
    /// Of all coordinates x, y of the marks in their order, with the distances' standard deviations as given.
    pub covariance_mm2: DMatrix<f64>,
    /// Measured less adjusted distances, in their order.
    pub residuals_mm: Vec<f64>,
    /// By how much larger the residuals are than the standard deviations say; 1 if nothing is redundant.
    pub sigma0: f64,
    /// Distances beyond those that are needed.
    pub redundancy: usize,
}

/// Why distances give no places.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrilaterationError {
    /// A distance is not between two of the marks, or not positive.
    #[error(
        "distance {distance} is not a positive one between two different marks, with a positive standard deviation"
    )]
    Malformed {
        /// Its index.
        distance: usize,
    },
    /// The marks can move although the distances stay.
    #[error(
        "{given} distances between {marks} marks leave {missing} of the {needed} needed for their figure undetermined"
    )]
    Undetermined {
        /// Distances there are.
        given: usize,
        /// Marks there are.
        marks: usize,
        /// Independent distances that determine a figure of so many marks.
        needed: usize,
        /// How many of these are missing.
        missing: usize,
        /// A mark that can move.
        movable: usize,
    },
    /// The iteration does not come to rest.
    #[error("the distances cannot be reconciled with the approximate positions; the adjustment does not converge")]
    Diverges,
    /// A distance does not fit the others.
    #[error(
        "a distance differs by {residual_mm:.3} mm from what the others say, which is {ratio:.0} times its standard \
         deviation"
    )]
    Contradictory {
        /// Index of the one that fits worst.
        distance: usize,
        /// Measured less adjusted.
        residual_mm: f64,
        /// That, in units of its own standard deviation.
        ratio: f64,
        /// Of the whole adjustment.
        sigma0: f64,
    },
}

const STEPS: usize = 50;
const TOLERANCE_MM: f64 = 1e-10;
/// A singular value of the design, whose rows are unit vectors, below this is a movement that the distances do not see.
const RANK_TOLERANCE: f64 = 1e-4;
/// A residual of so many standard deviations is a blunder: by chance it comes once in millions.
const BLUNDER: f64 = 5.0;
/// A residual with less redundancy than this says nothing.
const LEAST_REDUNDANCY: f64 = 1e-6;
/// Translations and a rotation.
const FREE: usize = 3;

impl Trilateration {
    /// Standard deviation of a mark's coordinates, the mean over all directions.
    #[must_use]
    pub fn sigma_mm(&self, mark: usize) -> f64 {
        (self.covariance(mark).trace() / 2.0).max(0.0).sqrt()
    }

    /// Covariance of a mark.
    #[must_use]
    pub fn covariance(&self, mark: usize) -> Matrix2<f64> {
        self.covariance_mm2.fixed_view::<2, 2>(2 * mark, 2 * mark).into_owned()
    }
}

/// Adjusts the places of marks to distances between them by least squares.
///
/// # Errors
/// [`TrilaterationError`] if the distances do not determine the figure, or contradict each other.
pub fn trilaterate(
    approximate_mm: &[Vector2<f64>],
    distances: &[Distance],
) -> Result<Trilateration, TrilaterationError> {
    check(approximate_mm.len(), distances)?;
    check_rank(approximate_mm, distances)?;
    let constraints = inner_constraints(approximate_mm);
    let mut positions = approximate_mm.to_vec();
    for _ in 0..STEPS {
        let inverse = bordered_inverse(&positions, distances, &constraints).ok_or(TrilaterationError::Diverges)?;
        let step = step(&inverse, &positions, approximate_mm, distances, &constraints);
        for (k, position) in positions.iter_mut().enumerate() {
            *position += Vector2::new(step[2 * k], step[2 * k + 1]);
        }
        let largest = step.amax();
        if !largest.is_finite() {
            break;
        }
        if largest < TOLERANCE_MM {
            return finished(positions, distances, &constraints);
        }
    }
    Err(TrilaterationError::Diverges)
}

fn check(marks: usize, distances: &[Distance]) -> Result<(), TrilaterationError> {
    let right = |given: &Distance| {
        let [i, j] = given.between;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        i != j && i.max(j) < marks && positive(given.distance_mm) && positive(given.sigma_mm)
    };
    match distances.iter().position(|given| !right(given)) {
        Some(distance) => Err(TrilaterationError::Malformed { distance }),
        None => Ok(()),
    }
}

fn check_rank(approximate_mm: &[Vector2<f64>], distances: &[Distance]) -> Result<(), TrilaterationError> {
    let unknowns = 2 * approximate_mm.len();
    let needed = unknowns.saturating_sub(FREE);
    let design = design(approximate_mm, distances, |_| 1.0);
    // of the square matrix, so that the movements that no distance sees are among its eigenvectors
    let eigen = (design.transpose() * &design + orthonormal_projection(approximate_mm)).symmetric_eigen();
    let unseen: Vec<usize> =
        (0..unknowns).filter(|k| eigen.eigenvalues[*k] < RANK_TOLERANCE * RANK_TOLERANCE).collect();
    let Some(first) = unseen.first() else { return Ok(()) };
    let movable = eigen.eigenvectors.column(*first).iamax() / 2;
    let (given, marks, missing) = (distances.len(), approximate_mm.len(), unseen.len());
    Err(TrilaterationError::Undetermined { given, marks, needed, missing, movable })
}

/// Projects onto the movements of the whole figure.
fn orthonormal_projection(approximate_mm: &[Vector2<f64>]) -> DMatrix<f64> {
    let basis = inner_constraints(approximate_mm);
    &basis * basis.transpose()
}

/// Movements of the whole figure, one a column, orthonormal: along x, along y, about the centroid.
fn inner_constraints(approximate_mm: &[Vector2<f64>]) -> DMatrix<f64> {
    let count = approximate_mm.len().max(1) as f64;
    let centroid = approximate_mm.iter().sum::<Vector2<f64>>() / count;
    let radius =
        approximate_mm.iter().map(|p| (p - centroid).norm_squared()).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    DMatrix::from_fn(2 * approximate_mm.len(), FREE, |row, column| {
        let from_centroid = approximate_mm[row / 2] - centroid;
        match (column, row % 2) {
            (0, 0) | (1, 1) => 1.0 / count.sqrt(),
            (2, 0) => -from_centroid.y / radius,
            (2, 1) => from_centroid.x / radius,
            _ => 0.0,
        }
    })
}

/// Derivatives of the distances, each row divided by its sigma.
fn design(positions: &[Vector2<f64>], distances: &[Distance], sigma: impl Fn(&Distance) -> f64) -> DMatrix<f64> {
    let mut design = DMatrix::zeros(distances.len(), 2 * positions.len());
    for (row, given) in distances.iter().enumerate() {
        let [i, j] = given.between;
        let difference = positions[j] - positions[i];
        let direction = difference / difference.norm().max(f64::MIN_POSITIVE) / sigma(given);
        for axis in 0..2 {
            design[(row, 2 * i + axis)] = -direction[axis];
            design[(row, 2 * j + axis)] = direction[axis];
        }
    }
    design
}

/// Inverse of the normal equations with the constraints as a border; its first block is the covariance.
fn bordered_inverse(
    positions: &[Vector2<f64>],
    distances: &[Distance],
    constraints: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let unknowns = 2 * positions.len();
    let design = design(positions, distances, |given| given.sigma_mm);
    let normal = design.transpose() * design;
    // both parts of one size, for the sake of the numbers
    let scale = normal.trace() / unknowns as f64;
    let mut bordered = DMatrix::zeros(unknowns + FREE, unknowns + FREE);
    bordered.view_mut((0, 0), (unknowns, unknowns)).copy_from(&(normal / scale));
    bordered.view_mut((0, unknowns), (unknowns, FREE)).copy_from(constraints);
    bordered.view_mut((unknowns, 0), (FREE, unknowns)).copy_from(&constraints.transpose());
    let inverse = bordered.try_inverse()?;
    let mut scaled = inverse;
    let mut block = scaled.view_mut((0, 0), (unknowns, unknowns));
    block /= scale;
    Some(scaled)
}

fn step(
    inverse: &DMatrix<f64>,
    positions: &[Vector2<f64>],
    approximate_mm: &[Vector2<f64>],
    distances: &[Distance],
    constraints: &DMatrix<f64>,
) -> DVector<f64> {
    let unknowns = 2 * positions.len();
    let design = design(positions, distances, |given| given.sigma_mm);
    let misclosures = DVector::from_iterator(
        distances.len(),
        distances.iter().zip(residuals(positions, distances)).map(|(given, residual)| residual / given.sigma_mm),
    );
    let moved = DVector::from_fn(unknowns, |row, _| (approximate_mm[row / 2] - positions[row / 2])[row % 2]);
    inverse.view((0, 0), (unknowns, unknowns)) * (design.transpose() * misclosures)
        + inverse.view((0, unknowns), (unknowns, FREE)) * (constraints.transpose() * moved)
}

/// Measured less present distances.
fn residuals<'a>(positions: &'a [Vector2<f64>], distances: &'a [Distance]) -> impl Iterator<Item = f64> + 'a {
    distances.iter().map(|given| {
        let [i, j] = given.between;
        given.distance_mm - (positions[j] - positions[i]).norm()
    })
}

fn finished(
    positions_mm: Vec<Vector2<f64>>,
    distances: &[Distance],
    constraints: &DMatrix<f64>,
) -> Result<Trilateration, TrilaterationError> {
    let unknowns = 2 * positions_mm.len();
    let inverse = bordered_inverse(&positions_mm, distances, constraints).ok_or(TrilaterationError::Diverges)?;
    let covariance_mm2 = inverse.view((0, 0), (unknowns, unknowns)).into_owned();
    let residuals_mm: Vec<f64> = residuals(&positions_mm, distances).collect();
    let redundancy = distances.len() + FREE - unknowns;
    let squares: f64 = distances.iter().zip(&residuals_mm).map(|(given, v)| (v / given.sigma_mm).powi(2)).sum();
    let sigma0 = if redundancy > 0 { (squares / redundancy as f64).sqrt() } else { 1.0 };
    let adjusted = Trilateration { positions_mm, covariance_mm2, residuals_mm, sigma0, redundancy };
    adjusted.check_blunders(distances)?;
    Ok(adjusted)
}

impl Trilateration {
    fn check_blunders(&self, distances: &[Distance]) -> Result<(), TrilaterationError> {
        let design = design(&self.positions_mm, distances, |given| given.sigma_mm);
        let explained = &design * &self.covariance_mm2;
        let ratio = |k: usize| {
            let redundancy = 1.0 - explained.row(k).dot(&design.row(k));
            let own = (self.residuals_mm[k] / distances[k].sigma_mm).abs();
            if redundancy > LEAST_REDUNDANCY { own / redundancy.sqrt() } else { 0.0 }
        };
        let worst = (0..distances.len()).map(|k| (k, ratio(k))).max_by(|a, b| a.1.total_cmp(&b.1));
        match worst {
            Some((distance, ratio)) if ratio > BLUNDER => {
                let (residual_mm, sigma0) = (self.residuals_mm[distance], self.sigma0);
                Err(TrilaterationError::Contradictory { distance, residual_mm, ratio, sigma0 })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    const SIDE: f64 = 212.0;
    const HALF: f64 = SIDE / 2.0;

    fn square() -> Vec<Vector2<f64>> {
        [[-HALF, -HALF], [HALF, -HALF], [HALF, HALF], [-HALF, HALF]].map(Vector2::from).to_vec()
    }

    /// All six distances between the corners, exactly as they are.
    fn all(corners: &[Vector2<f64>], sigma_mm: f64) -> Vec<Distance> {
        let pairs = (0..corners.len()).flat_map(|i| (i + 1..corners.len()).map(move |j| [i, j]));
        let distance = |[i, j]: [usize; 2]| (corners[j] - corners[i]).norm();
        pairs.map(|between| Distance { between, distance_mm: distance(between), sigma_mm }).collect()
    }

    #[test]
    fn a_square_with_sides_and_diagonals_has_its_closed_form() {
        // sides and diagonals stretched alike: the square grows about its centre
        let mut distances = all(&square(), 0.005);
        for given in &mut distances {
            given.distance_mm *= 1.001;
        }
        let adjusted = trilaterate(&square(), &distances).unwrap();
        for (position, corner) in adjusted.positions_mm.iter().zip(square()) {
            assert!((position - corner * 1.001).norm() < 1e-8, "{position}");
        }
        assert_eq!(adjusted.redundancy, 1);
        assert!(adjusted.sigma0 < 1e-6);
        let trace = adjusted.covariance_mm2.trace() / 0.005_f64.powi(2);
        assert!((trace - closed_trace()).abs() < 1e-6, "{trace}");
        for mark in 0..4 {
            let expected = 0.005 * (closed_trace() / 8.0).sqrt();
            assert!((adjusted.sigma_mm(mark) - expected).abs() < 1e-9);
        }
    }

    /// Trace of the covariance in units of the distances' variance. By the symmetry of the square its movements of unit
    /// length are eigenvectors of the normal equations. Growing (each corner by 1/2 outwards) changes the sides by 1/√2
    /// and the diagonals by 1: eigenvalue 4/2 + 2 = 4. Shear along the diagonals changes these by ±1 and no side: 2. Shear
    /// along the sides changes these by ±1/√2 and no diagonal: 2. Two trapezia change two sides by ±1: 2 and 2.
    fn closed_trace() -> f64 {
        1.0 / 4.0 + 4.0 / 2.0
    }

    #[test]
    fn centroid_and_rotation_are_those_of_the_approximate_places() {
        let moved = [[0.4, -0.2], [-0.3, 0.5], [0.1, 0.2], [0.3, -0.4]].map(Vector2::from);
        let truth: Vec<Vector2<f64>> = square().iter().zip(moved).map(|(corner, by)| corner + by).collect();
        let adjusted = trilaterate(&square(), &all(&truth, 0.003)).unwrap();
        let shifts: Vec<Vector2<f64>> =
            adjusted.positions_mm.iter().zip(square()).map(|(p, corner)| p - corner).collect();
        assert!(shifts.iter().sum::<Vector2<f64>>().norm() < 1e-8);
        let turned: f64 = shifts.iter().zip(square()).map(|(shift, corner)| corner.perp(shift)).sum();
        assert!(turned.abs() < 1e-6);
        for (given, found) in all(&truth, 1.0).iter().zip(all(&adjusted.positions_mm, 1.0)) {
            assert!((given.distance_mm - found.distance_mm).abs() < 1e-8);
        }
    }

    #[test]
    fn the_covariance_is_the_scatter() {
        let mut marks = square();
        marks.extend([[-110.0, 0.0], [110.0, 1.0], [2.0, 110.0], [0.0, -110.0]].map(Vector2::from));
        let truth = all(&marks, 0.005);
        let expected = trilaterate(&marks, &truth).unwrap();
        let mut noise = Draws::new(7);
        let (rounds, unknowns) = (4000, 2 * marks.len());
        let mut scatter = DMatrix::zeros(unknowns, unknowns);
        let mut sigma0_squared = 0.0;
        for _ in 0..rounds {
            let mut measured = truth.clone();
            for given in &mut measured {
                given.distance_mm += given.sigma_mm * noise.normal();
            }
            let adjusted = trilaterate(&marks, &measured).unwrap();
            let error = DVector::from_fn(unknowns, |k, _| (adjusted.positions_mm[k / 2] - marks[k / 2])[k % 2]);
            scatter += &error * error.transpose() / f64::from(rounds);
            sigma0_squared += adjusted.sigma0.powi(2) / f64::from(rounds);
        }
        let scale = expected.covariance_mm2.diagonal().max();
        let difference = (&scatter - &expected.covariance_mm2).amax() / scale;
        assert!(difference < 0.1, "{difference}");
        assert!((sigma0_squared - 1.0).abs() < 0.03, "{sigma0_squared}");
    }

    #[test]
    fn too_few_distances_are_refused_with_what_is_missing() {
        let sides: Vec<Distance> = all(&square(), 0.005).into_iter().filter(|d| d.distance_mm < 250.0).collect();
        let error = trilaterate(&square(), &sides).unwrap_err();
        assert!(
            matches!(error, TrilaterationError::Undetermined { given: 4, marks: 4, needed: 5, missing: 1, .. }),
            "{error}"
        );
        // many distances, and yet one mark hangs on a single one
        let mut marks = square();
        marks.push(Vector2::new(0.0, 110.0));
        let distances: Vec<Distance> =
            all(&marks, 0.005).into_iter().filter(|d| d.between[1] < 4 || d.between == [0, 4]).collect();
        let error = trilaterate(&marks, &distances).unwrap_err();
        assert!(matches!(error, TrilaterationError::Undetermined { missing: 1, movable: 4, .. }), "{error:?}");
        // one distance between two marks is enough for them
        let two = [Vector2::new(-100.0, 0.0), Vector2::new(100.0, 0.0)];
        let distance = Distance { between: [0, 1], distance_mm: 201.0, sigma_mm: 0.01 };
        let adjusted = trilaterate(&two, &[distance]).unwrap();
        assert!((adjusted.positions_mm[1] - Vector2::new(100.5, 0.0)).norm() < 1e-9);
        assert_eq!((adjusted.redundancy, adjusted.sigma0), (0, 1.0));
    }

    #[test]
    fn contradictory_distances_are_refused_with_the_numbers() {
        let mut distances = all(&square(), 0.005);
        distances[1].distance_mm += 1.0;
        let error = trilaterate(&square(), &distances).unwrap_err();
        let TrilaterationError::Contradictory { residual_mm, ratio, sigma0, .. } = error else {
            panic!("{error}");
        };
        assert!(residual_mm.abs() > 0.1 && ratio > 50.0 && sigma0 > 50.0, "{residual_mm} {ratio} {sigma0}");
        let wrong = [Distance { between: [0, 4], distance_mm: 1.0, sigma_mm: 1.0 }];
        assert_eq!(trilaterate(&square(), &wrong), Err(TrilaterationError::Malformed { distance: 0 }));
    }
}
