//! Eight spatial resections at once, each by Gauss and Newton with the same number of points.
//!
//! The minimum is that of `resect`; only the way there differs: a step turns by the Cayley transform of its small
//! rotation, which agrees with the exponential to the third order.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::lanes::{Lanes, WIDTH, dot};
use crate::estimation::{PointObservation, Prior};
use crate::geometry::ExteriorOrientation;

/// Steps at most, after the one that was linearised for all alike: convergence is quadratic, and from d pixels away a
/// step leads to about d²/c pixels. What has not come to rest by then is carried on by itself.
const MOST_STEPS: usize = 3;
/// A squared step in its own metric after which the next one changes nothing.
const SMALL_STEP_SQUARED: f64 = 1e-2;
/// One observed point of each of the eight problems.
#[derive(Clone, Copy)]
pub(super) struct PointLanes {
    object_m: [Lanes; 3],
    image_px: [Lanes; 2],
    /// 1 / sigma
    root_weight: Lanes,
}

impl PointLanes {
    pub(super) fn new(points: [&PointObservation; WIDTH]) -> Self {
        let lanes = |f: &dyn Fn(&PointObservation) -> f64| Lanes(points.map(f));
        Self {
            object_m: [lanes(&|p| p.object_m.x), lanes(&|p| p.object_m.y), lanes(&|p| p.object_m.z)],
            image_px: [lanes(&|p| p.image_px.x), lanes(&|p| p.image_px.y)],
            root_weight: lanes(&|p| 1.0 / p.sigma_px),
        }
    }
}

/// Prior knowledge in the form that the steps need.
pub(super) struct PriorLanes {
    centre_m: [f64; 3],
    /// Of the rotation from object space to the camera frame: w, x, y, z.
    rotation: [f64; 4],
    information: [[f64; 6]; 6],
}

impl PriorLanes {
    pub(super) fn new(prior: &Prior) -> Self {
        let ExteriorOrientation { projection_centre_m, .. } = prior.orientation;
        Self {
            centre_m: projection_centre_m.into(),
            rotation: quaternion(&prior.orientation),
            information: prior.information.into(),
        }
    }
}

fn quaternion(orientation: &ExteriorOrientation) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(&orientation.camera_from_object);
    [q.w, q.i, q.j, q.k]
}

/// Eight orientations.
#[derive(Clone, Copy)]
pub(super) struct EightOrientations {
    centre_m: [Lanes; 3],
    rotation: [Lanes; 4],
    principal_distance_px: f64,
}

/// The upper triangle of the normal equations, row by row, with their right-hand side as the last column.
pub(super) type Triangle = [[Lanes; 7]; 6];

impl EightOrientations {
    /// Eight times the same.
    pub(super) fn all(orientation: &ExteriorOrientation, principal_distance_px: f64) -> Self {
        let centre: [f64; 3] = orientation.projection_centre_m.into();
        Self {
            centre_m: centre.map(Lanes::all),
            rotation: quaternion(orientation).map(Lanes::all),
            principal_distance_px,
        }
    }

    /// One of the eight.
    pub(super) fn one(&self, lane: usize) -> ExteriorOrientation {
        let [w, x, y, z] = self.rotation.map(|q| q.0[lane]);
        ExteriorOrientation {
            projection_centre_m: Vector3::from(self.centre_m.map(|c| c.0[lane])),
            camera_from_object: UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).to_rotation_matrix(),
        }
    }

    /// Some steps of Gauss and Newton, and which of the eight have come to rest: the steps end when all that are
    /// `wanted` have. Those without a minimum end anywhere.
    #[inline(always)]
    pub(super) fn resect<const N: usize>(
        &mut self,
        points: &[PointLanes; N],
        prior: Option<&PriorLanes>,
        wanted: &[bool; WIDTH],
    ) -> [bool; WIDTH] {
        let mut at_rest = [false; WIDTH];
        for _ in 0..MOST_STEPS {
            let mut triangle = self.equations(points, prior);
            let right_side = triangle.each_ref().map(|row| row[6]);
            let step = solve(&mut triangle);
            self.take(&step);
            let squared = dot(&step, &right_side);
            for (rests, squared) in at_rest.iter_mut().zip(squared.0) {
                *rests = squared < SMALL_STEP_SQUARED;
            }
            if wanted.iter().zip(&at_rest).fold(true, |all, (wanted, rests)| all & (*rests | !*wanted)) {
                break;
            }
        }
        at_rest
    }

    #[inline(always)]
    fn matrix(&self) -> [[Lanes; 3]; 3] {
        let [w, x, y, z] = self.rotation;
        let [xx, yy, zz] = [x * x, y * y, z * z];
        let [xy, xz, yz, wx, wy, wz] = [x * y, x * z, y * z, w * x, w * y, w * z];
        let one = Lanes::all(1.0);
        let two = Lanes::all(2.0);
        [
            [one - two * (yy + zz), two * (xy - wz), two * (xz + wy)],
            [two * (xy + wz), one - two * (xx + zz), two * (yz - wx)],
            [two * (xz - wy), two * (yz + wx), one - two * (xx + yy)],
        ]
    }

    #[inline(always)]
    fn camera_coordinates(&self, matrix: &[[Lanes; 3]; 3], object_m: &[Lanes; 3]) -> [Lanes; 3] {
        let from_centre =
            [object_m[0] - self.centre_m[0], object_m[1] - self.centre_m[1], object_m[2] - self.centre_m[2]];
        [dot(&matrix[0], &from_centre), dot(&matrix[1], &from_centre), dot(&matrix[2], &from_centre)]
    }

    #[inline(always)]
    fn equations<const N: usize>(&self, points: &[PointLanes; N], prior: Option<&PriorLanes>) -> Triangle {
        let matrix = self.matrix();
        let mut triangle = [[Lanes::ZERO; 7]; 6];
        let mut rows = [[[Lanes::ZERO; 7]; 2]; N];
        for (rows, point) in rows.iter_mut().zip(points) {
            self.rows(&matrix, point, rows);
        }
        for row in 0..6 {
            for column in row..7 {
                let mut sum = Lanes::ZERO;
                for [x, y] in &rows {
                    sum = sum + x[row] * x[column] + y[row] * y[column];
                }
                triangle[row][column] = sum;
            }
        }
        if let Some(prior) = prior {
            let misclosure = self.step_to(prior);
            for (row, information) in triangle.iter_mut().zip(&prior.information) {
                for (element, information) in row.iter_mut().zip(information) {
                    *element = *element + Lanes::all(*information);
                }
                row[6] = row[6] + dot(&information.map(Lanes::all), &misclosure);
            }
        }
        triangle
    }

    /// The two observation equations of a point, divided by its standard deviation: six derivatives and misclosure.
    #[inline(always)]
    fn rows(&self, matrix: &[[Lanes; 3]; 3], point: &PointLanes, rows: &mut [[Lanes; 7]; 2]) {
        let [u, v, w] = self.camera_coordinates(matrix, &point.object_m);
        let c = Lanes::all(self.principal_distance_px) * point.root_weight;
        let inverse = Lanes::all(1.0) / w;
        let (a, b, scale) = (u * inverse, v * inverse, c * inverse);
        let zero = Lanes::ZERO;
        let (ca, cb) = (c * a, c * b);
        let cab = ca * b;
        // -(d image / du) R, and (d image / du) [u]x, where x = -c U/W and y = c V/W
        let [row_x, row_y] = rows;
        for k in 0..3 {
            row_x[k] = scale * (matrix[0][k] - a * matrix[2][k]);
            row_y[k] = scale * (b * matrix[2][k] - matrix[1][k]);
        }
        row_x[3] = zero - cab;
        row_x[4] = c + ca * a;
        row_x[5] = zero - cb;
        row_x[6] = point.image_px[0] * point.root_weight + ca;
        row_y[3] = c + cb * b;
        row_y[4] = zero - cab;
        row_y[5] = zero - ca;
        row_y[6] = point.image_px[1] * point.root_weight - cb;
    }

    /// The step to the prior's orientation.
    #[inline(always)]
    fn step_to(&self, prior: &PriorLanes) -> [Lanes; 6] {
        let [w, x, y, z] = self.rotation;
        let [pw, px, py, pz] = prior.rotation.map(Lanes::all);
        // the prior's rotation times the inverse of the own one
        let turn_w = pw * w + px * x + py * y + pz * z;
        let turn =
            [px * w - pw * x - py * z + pz * y, py * w - pw * y - pz * x + px * z, pz * w - pw * z - px * y + py * x];
        let factor = rotation_vector_factor(turn_w, dot(&turn, &turn));
        let centre: [Lanes; 3] = std::array::from_fn(|k| Lanes::all(prior.centre_m[k]) - self.centre_m[k]);
        [centre[0], centre[1], centre[2], factor * turn[0], factor * turn[1], factor * turn[2]]
    }

    /// Moves each of the eight by its step.
    #[inline(always)]
    pub(super) fn take(&mut self, step: &[Lanes; 6]) {
        for (centre, step) in self.centre_m.iter_mut().zip(step) {
            *centre = *centre + *step;
        }
        let half = Lanes::all(-0.5);
        let [a, b, c] = [step[3] * half, step[4] * half, step[5] * half];
        let [w, x, y, z] = self.rotation;
        // (1, a, b, c) times the rotation
        let turned = [
            w - a * x - b * y - c * z,
            x + a * w + b * z - c * y,
            y + b * w + c * x - a * z,
            z + c * w + a * y - b * x,
        ];
        let scale = dot(&turned, &turned).map(|square| 1.0 / square.sqrt());
        self.rotation = turned.map(|q| q * scale);
    }

    /// The squared distance in the image of a point from where each of the eight projects it.
    #[inline(always)]
    pub(super) fn squared_residuals_px(&self) -> impl Fn(&PointObservation) -> Lanes + '_ {
        let matrix = self.matrix();
        let c = Lanes::all(self.principal_distance_px);
        move |point| {
            let object: [f64; 3] = point.object_m.into();
            let [u, v, w] = self.camera_coordinates(&matrix, &object.map(Lanes::all));
            let scale = c / w;
            let (x, y) = (Lanes::all(point.image_px.x) + u * scale, Lanes::all(point.image_px.y) - v * scale);
            // behind the camera there is no image
            (x * x + y * y).with(w, |squared, w| if w < 0.0 { squared } else { f64::INFINITY })
        }
    }
}

/// What makes the vector part of a unit quaternion its rotation vector, with the sign of [`ExteriorOrientation`]'s
/// theta. `-4 atan(t) / t` with `t` the tangent of a quarter of the angle: a few terms do for less than 90 degrees.
#[inline(always)]
fn rotation_vector_factor(w: Lanes, squared: Lanes) -> Lanes {
    let sign = w.map(|w| if w < 0.0 { -1.0 } else { 1.0 });
    let one = Lanes::all(1.0);
    let inverse = one / (one + sign * w);
    let t_squared = squared * inverse * inverse;
    let mut series = Lanes::ZERO;
    for k in (0..9_u32).rev() {
        let coefficient = f64::from(2 * k + 1).recip() * if k % 2 == 0 { 1.0 } else { -1.0 };
        series = series * t_squared + Lanes::all(coefficient);
    }
    Lanes::all(-4.0) * sign * inverse * series
}

/// The solution by elimination without pivots. Undetermined lanes give what is not a number.
#[inline(always)]
pub(super) fn solve(triangle: &mut Triangle) -> [Lanes; 6] {
    let mut inverse_pivots = [Lanes::ZERO; 6];
    for k in 0..6 {
        let (above, below) = triangle.split_at_mut(k + 1);
        let pivot_row = &above[k];
        inverse_pivots[k] = Lanes::all(1.0) / pivot_row[k];
        for (row, below) in (k + 1..6).zip(below) {
            let factor = pivot_row[row] * inverse_pivots[k];
            for column in row..7 {
                below[column] = below[column] - factor * pivot_row[column];
            }
        }
    }
    let mut solution = triangle.each_ref().map(|row| row[6]);
    for k in (0..6).rev() {
        for column in k + 1..6 {
            solution[k] = solution[k] - triangle[k][column] * solution[column];
        }
        solution[k] = solution[k] * inverse_pivots[k];
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::resect;
    use crate::estimation::simulated::{Draws, PRINCIPAL_DISTANCE_PX as C, flight, points};
    use approx::assert_relative_eq;
    use nalgebra::{Matrix6, Vector6};

    const WANTED: [bool; WIDTH] = [true; WIDTH];

    fn prior(turn_rad: f64) -> Prior {
        let sigmas = Vector6::new(3.0, 4.0, 5.0, 0.01, 0.02, 0.03);
        let information = Matrix6::from_diagonal(&sigmas.map(|s| 1.0 / (s * s)));
        let step = Vector6::new(2.0, -3.0, 1.0, 0.6 * turn_rad, -0.5 * turn_rad, 0.62 * turn_rad);
        Prior { orientation: flight().moved(&step), information }
    }

    fn five_points() -> [[PointObservation; WIDTH]; 5] {
        let mut draws = Draws::new(31);
        let all: [Vec<PointObservation>; WIDTH] = std::array::from_fn(|_| points(&mut draws, &flight(), 5, 0.7));
        std::array::from_fn(|place| std::array::from_fn(|lane| all[lane][place]))
    }

    #[test]
    fn each_of_the_eight_is_the_resection_of_its_points() {
        let points = five_points();
        let lanes = points.each_ref().map(|eight| PointLanes::new(eight.each_ref()));
        let start = flight().moved(&Vector6::new(10.0, -8.0, 5.0, 0.02, -0.01, 0.02));
        for prior in [None, Some(prior(0.01))] {
            let mut eight = EightOrientations::all(&start, C);
            let prior_lanes = prior.as_ref().map(PriorLanes::new);
            let first = eight.resect(&lanes, prior_lanes.as_ref(), &WANTED);
            let second = eight.resect(&lanes, prior_lanes.as_ref(), &WANTED);
            assert!(first.iter().zip(second).all(|(first, second)| *first && second));
            for lane in 0..WIDTH {
                let own: Vec<_> = points.iter().map(|eight| eight[lane]).collect();
                let expected = resect(&own, prior.as_ref(), &start, C).unwrap();
                let off = expected.orientation.step_to(&eight.one(lane));
                let squared = off.dot(&(expected.covariance.try_inverse().unwrap() * off));
                assert!(squared < 1e-6, "{squared} standard deviations squared");
            }
        }
    }

    #[test]
    fn the_step_to_a_prior_is_that_of_the_geometry() {
        let eight = EightOrientations::all(&flight(), C);
        for turn_rad in [0.0, 1e-9, 0.01, 0.3, 1.0, -1.2] {
            let prior = prior(turn_rad);
            let step = eight.step_to(&PriorLanes::new(&prior)).map(|lanes| lanes.0[3]);
            let expected = flight().step_to(&prior.orientation);
            assert_relative_eq!(Vector6::from(step), expected, epsilon = 1e-7);
        }
    }

    #[test]
    fn points_behind_the_camera_have_no_residual() {
        let point = five_points()[0][0];
        let eight = EightOrientations::all(&flight(), C);
        let squared = eight.squared_residuals_px()(&point).0;
        let expected = (flight().reduced_px(C, point.object_m).unwrap() - point.image_px).norm_squared();
        assert_relative_eq!(squared[5], expected, epsilon = 1e-9);
        let behind = PointObservation { object_m: point.object_m + Vector3::new(0.0, 0.0, 900.0), ..point };
        assert_eq!(eight.squared_residuals_px()(&behind).0, [f64::INFINITY; WIDTH]);
    }
}
