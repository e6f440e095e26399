//! Eight spatial resections at once, each by Gauss and Newton with the same number of points.
//!
//! The minimum is that of `resect`; only the way there differs: a step turns by the Cayley transform of its small
//! rotation, which agrees with the exponential to the third order.

use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector6};

use super::lanes::{Lanes, WIDTH, dot};
use crate::estimation::{PointObservation, Prior};
use crate::geometry::ExteriorOrientation;

/// Steps at most: what has not come to rest by then has mostly no minimum nearby.
const MOST_STEPS: usize = 6;
/// A squared step in its own metric after which the next one changes nothing: convergence is quadratic.
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

/// The upper triangle of the normal equations, row by row, and their right-hand side.
type Triangle = [[Lanes; 6]; 6];

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

    /// Gauss and Newton until all have come to rest, or it takes too long. Those without a minimum end anywhere.
    #[inline(always)]
    pub(super) fn resect<const N: usize>(&mut self, points: &[PointLanes; N], prior: Option<&PriorLanes>) {
        for _ in 0..MOST_STEPS {
            let (triangle, right_side) = self.equations(points, prior);
            let step = solve(triangle, right_side);
            self.take(&step);
            let length = dot(&step, &right_side);
            if length.0.iter().fold(false, |moving, squared| moving | (*squared > SMALL_STEP_SQUARED)) {
                continue;
            }
            break;
        }
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
        let from_centre = [
            object_m[0] - self.centre_m[0],
            object_m[1] - self.centre_m[1],
            object_m[2] - self.centre_m[2],
        ];
        [dot(&matrix[0], &from_centre), dot(&matrix[1], &from_centre), dot(&matrix[2], &from_centre)]
    }

    #[inline(always)]
    fn equations<const N: usize>(
        &self,
        points: &[PointLanes; N],
        prior: Option<&PriorLanes>,
    ) -> (Triangle, [Lanes; 6]) {
        let matrix = self.matrix();
        let (mut triangle, mut right_side) = ([[Lanes::ZERO; 6]; 6], [Lanes::ZERO; 6]);
        if let Some(prior) = prior {
            let misclosure = self.step_to(prior);
            for row in 0..6 {
                for column in row..6 {
                    triangle[row][column] = Lanes::all(prior.information[row][column]);
                }
                right_side[row] = dot(&prior.information[row].map(Lanes::all), &misclosure);
            }
        }
        let mut rows = [[[Lanes::ZERO; 7]; 2]; N];
        for (rows, point) in rows.iter_mut().zip(points) {
            *rows = self.rows(&matrix, point);
        }
        for row in 0..6 {
            for column in row..7 {
                let mut sum = if column < 6 { triangle[row][column] } else { right_side[row] };
                for [x, y] in &rows {
                    sum = sum + x[row] * x[column] + y[row] * y[column];
                }
                if column < 6 {
                    triangle[row][column] = sum;
                } else {
                    right_side[row] = sum;
                }
            }
        }
        (triangle, right_side)
    }

    /// The two observation equations of a point, divided by its standard deviation: six derivatives and misclosure.
    #[inline(always)]
    fn rows(&self, matrix: &[[Lanes; 3]; 3], point: &PointLanes) -> [[Lanes; 7]; 2] {
        let [u, v, w] = self.camera_coordinates(matrix, &point.object_m);
        let c = Lanes::all(self.principal_distance_px) * point.root_weight;
        let inverse = Lanes::all(1.0) / w;
        let (a, b, scale) = (u * inverse, v * inverse, c * inverse);
        let zero = Lanes::ZERO;
        let (ca, cb) = (c * a, c * b);
        let cab = ca * b;
        // -(d image / du) R, and (d image / du) [u]x, where x = -c U/W and y = c V/W
        let centre = |k: usize| scale * (matrix[0][k] - a * matrix[2][k]);
        let centre_y = |k: usize| scale * (b * matrix[2][k] - matrix[1][k]);
        let x = point.image_px[0] * point.root_weight + ca;
        let y = point.image_px[1] * point.root_weight - cb;
        [
            [centre(0), centre(1), centre(2), zero - cab, c + ca * a, zero - cb, x],
            [centre_y(0), centre_y(1), centre_y(2), c + cb * b, zero - cab, zero - ca, y],
        ]
    }

    /// The step to the prior's orientation.
    #[inline(always)]
    fn step_to(&self, prior: &PriorLanes) -> [Lanes; 6] {
        let [w, x, y, z] = self.rotation;
        let [pw, px, py, pz] = prior.rotation.map(Lanes::all);
        // the prior's rotation times the inverse of the own one
        let turn_w = pw * w + px * x + py * y + pz * z;
        let turn = [
            px * w - pw * x - py * z + pz * y,
            py * w - pw * y - pz * x + px * z,
            pz * w - pw * z - px * y + py * x,
        ];
        let factor = rotation_vector_factor(turn_w, dot(&turn, &turn));
        let centre: [Lanes; 3] = std::array::from_fn(|k| Lanes::all(prior.centre_m[k]) - self.centre_m[k]);
        [centre[0], centre[1], centre[2], factor * turn[0], factor * turn[1], factor * turn[2]]
    }

    #[inline(always)]
    fn take(&mut self, step: &[Lanes; 6]) {
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

/// The solution by `L D L'`. Undetermined lanes give what is not a number.
#[inline(always)]
fn solve(mut triangle: Triangle, right_side: [Lanes; 6]) -> [Lanes; 6] {
    let mut solution = right_side;
    let mut inverse_pivots = [Lanes::ZERO; 6];
    for k in 0..6 {
        // rows above have been subtracted already
        inverse_pivots[k] = Lanes::all(1.0) / triangle[k][k];
        for row in k + 1..6 {
            let factor = triangle[k][row] * inverse_pivots[k];
            for column in row..6 {
                triangle[row][column] = triangle[row][column] - factor * triangle[k][column];
            }
            solution[row] = solution[row] - factor * solution[k];
        }
    }
    for k in (0..6).rev() {
        for column in k + 1..6 {
            solution[k] = solution[k] - triangle[k][column] * solution[column];
        }
        solution[k] = solution[k] * inverse_pivots[k];
    }
    solution
}
