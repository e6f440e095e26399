//! The ground: a gently undulating surface that is known in closed form.

use nalgebra::{Vector2, Vector3};

use super::draws::{Draws, direction};

/// A height for every east and north: a mean and a few long waves.
#[derive(Debug, Clone, PartialEq)]
pub struct Terrain {
    /// The mean height, above the frame's zero.
    pub mean_height_m: f64,
    waves: Vec<Wave>,
}

#[derive(Debug, Clone, PartialEq)]
struct Wave {
    /// Phase gained by each metre to the east and to the north.
    wave_number: Vector2<f64>,
    phase_rad: f64,
    amplitude_m: f64,
}

/// Rays that descend less than this per unit of length do not reach the ground within any sensible distance.
const SHALLOWEST_RAY: f64 = 0.05;

/// Steps of the intersection, each of which shrinks the error by the slope of the ground times the tangent of the
/// ray's tilt, here below 1/5.
const INTERSECTION_STEPS: usize = 20;
const INTERSECTION_TOLERANCE_M: f64 = 1e-6;

impl Terrain {
    /// Level ground.
    #[must_use]
    pub fn level(height_m: f64) -> Self {
        Self { mean_height_m: height_m, waves: Vec::new() }
    }

    pub(crate) fn draw(draws: &mut Draws, mean_height_m: f64, relief_m: f64) -> Self {
        // lengths that differ by irregular factors, so that the pattern does not repeat within the town
        let waves = [(430.0, 0.5), (290.0, 0.3), (170.0, 0.14), (110.0, 0.06)].map(|(length_m, share)| Wave {
            wave_number: direction(draws.between(0.0, std::f64::consts::TAU)) * (std::f64::consts::TAU / length_m),
            phase_rad: draws.between(0.0, std::f64::consts::TAU),
            amplitude_m: relief_m * share / 2.0,
        });
        Self { mean_height_m, waves: waves.to_vec() }
    }

    /// The height at an east and north.
    #[must_use]
    pub fn height_m(&self, plan_m: Vector2<f64>) -> f64 {
        let wave = |w: &Wave| w.amplitude_m * libm::sin(w.wave_number.dot(&plan_m) + w.phase_rad);
        self.mean_height_m + self.waves.iter().map(wave).sum::<f64>()
    }

    /// The point of the surface at an east and north.
    #[must_use]
    pub fn point_m(&self, plan_m: Vector2<f64>) -> Vector3<f64> {
        Vector3::new(plan_m.x, plan_m.y, self.height_m(plan_m))
    }

    /// The surface's upward unit normal at an east and north.
    #[must_use]
    pub fn normal(&self, plan_m: Vector2<f64>) -> Vector3<f64> {
        let slope = |w: &Wave| w.wave_number * (w.amplitude_m * libm::cos(w.wave_number.dot(&plan_m) + w.phase_rad));
        let gradient: Vector2<f64> = self.waves.iter().map(slope).sum();
        Vector3::new(-gradient.x, -gradient.y, 1.0).normalize()
    }

    /// Where a ray from above meets the surface; `None` for rays that do not descend.
    #[must_use]
    pub fn meets(&self, origin_m: Vector3<f64>, ray: Vector3<f64>) -> Option<Vector3<f64>> {
        let ray = ray.normalize();
        if ray.z > -SHALLOWEST_RAY {
            return None;
        }
        let at_height = |height_m: f64| origin_m + ray * ((height_m - origin_m.z) / ray.z);
        let mut point = at_height(self.mean_height_m);
        for _ in 0..INTERSECTION_STEPS {
            let height_m = self.height_m(point.xy());
            let off_m = (height_m - point.z).abs();
            point = at_height(height_m);
            if off_m < INTERSECTION_TOLERANCE_M {
                break;
            }
        }
        Some(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::draws::Purpose;
    use approx::assert_relative_eq;

    fn drawn() -> Terrain {
        Terrain::draw(&mut Draws::new(4, Purpose::Town), 60.0, 8.0)
    }

    #[test]
    fn rays_meet_the_surface() {
        let terrain = drawn();
        let origin = Vector3::new(20.0, -30.0, 290.0);
        for ray in [Vector3::new(0.0, 0.0, -1.0), Vector3::new(0.7, -0.3, -1.0), Vector3::new(-1.2, 0.9, -1.0)] {
            let point = terrain.meets(origin, ray).unwrap();
            assert_relative_eq!(point.z, terrain.height_m(point.xy()), epsilon = 1e-6);
            assert_relative_eq!((point - origin).normalize(), ray.normalize(), epsilon = 1e-9);
        }
        assert!(terrain.meets(origin, Vector3::new(1.0, 0.0, 0.1)).is_none());
    }

    #[test]
    fn normal_agrees_with_finite_differences_and_relief_with_what_was_asked() {
        let terrain = drawn();
        let mut range = (f64::MAX, f64::MIN);
        for k in 0..2000 {
            let at = Vector2::new(f64::from(k % 50) * 20.0, f64::from(k / 50) * 23.0);
            let (h, east, north) = (1e-3, Vector2::x() * 1e-3, Vector2::y() * 1e-3);
            let tangent = |step: Vector2<f64>| (terrain.point_m(at + step) - terrain.point_m(at - step)) / (2.0 * h);
            assert_relative_eq!(tangent(east).cross(&tangent(north)).normalize(), terrain.normal(at), epsilon = 1e-6);
            range = (range.0.min(terrain.height_m(at)), range.1.max(terrain.height_m(at)));
        }
        assert!((range.1 - range.0 - 8.0).abs() < 1.5, "relief {range:?}");
    }
}
