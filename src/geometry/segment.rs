//! Straight line segments in the plane and in space.

use nalgebra::{Vector2, Vector3};

/// A segment in space; the frame is said by the name of what holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment3 {
    /// Its first end point.
    pub start: Vector3<f64>,
    /// Its second end point.
    pub end: Vector3<f64>,
}

impl Segment3 {
    /// The point half-way between the ends.
    #[must_use]
    pub fn midpoint(&self) -> Vector3<f64> {
        (self.start + self.end) / 2.0
    }

    /// The distance between the ends.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.end - self.start).norm()
    }
}

/// A segment in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment2 {
    /// Its first end point.
    pub start: Vector2<f64>,
    /// Its second end point.
    pub end: Vector2<f64>,
}

impl Segment2 {
    /// The point half-way between the ends.
    #[must_use]
    pub fn midpoint(&self) -> Vector2<f64> {
        (self.start + self.end) / 2.0
    }

    /// The distance between the ends.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.end - self.start).norm()
    }

    /// The unit vector from start to end; zero for a segment without length.
    #[must_use]
    pub fn direction(&self) -> Vector2<f64> {
        (self.end - self.start).try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector2::zeros)
    }

    /// The direction turned by a quarter, from x towards y.
    #[must_use]
    pub fn normal(&self) -> Vector2<f64> {
        let along = self.direction();
        Vector2::new(-along.y, along.x)
    }
}
