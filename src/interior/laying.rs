//! The eight ways in which a film can lie on the scanner.

use nalgebra::{Matrix2, Vector2};

/// How the plate lies in the scan: turned, and perhaps with the wrong side up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Laying {
    /// Quarter turns, counter-clockwise as one sees the scan, 0 to 3.
    pub quarter_turns: u8,
    /// Wrong-reading: mirrored about the plate's y axis before it is turned.
    pub mirrored: bool,
}

impl Laying {
    /// All eight, right-reading ones first.
    #[must_use]
    pub fn all() -> [Self; 8] {
        std::array::from_fn(|k| Self { quarter_turns: (k % 4) as u8, mirrored: k >= 4 })
    }

    /// The directions of the plate's axes in the scan (x right, y down), of unit length.
    #[must_use]
    pub fn axes(self) -> Matrix2<f64> {
        let upright = Matrix2::new(if self.mirrored { -1.0 } else { 1.0 }, 0.0, 0.0, -1.0);
        // counter-clockwise where y runs down
        let quarter = Matrix2::new(0.0, 1.0, -1.0, 0.0);
        (0..self.quarter_turns % 4).fold(upright, |axes, _| quarter * axes)
    }

    /// The laying that a transformation from plate to pixels comes nearest to.
    #[must_use]
    pub fn nearest(linear: &Matrix2<f64>) -> Self {
        let mut best = (f64::NEG_INFINITY, Self { quarter_turns: 0, mirrored: false });
        for laying in Self::all() {
            let likeness = (laying.axes().transpose() * linear).trace();
            if likeness > best.0 {
                best = (likeness, laying);
            }
        }
        best.1
    }

    /// How the plate would have to be moved onto itself for `other` to look like this laying: a point of the plate that
    /// `self` puts somewhere is put there by `other` from this matrix times the point.
    #[must_use]
    pub fn onto(self, other: Self) -> Matrix2<f64> {
        other.axes().transpose() * self.axes()
    }

    /// Where a point of the plate comes to lie in the scan, in units of the plate about its origin.
    #[must_use]
    pub fn apply(self, plate: Vector2<f64>) -> Vector2<f64> {
        self.axes() * plate
    }

    /// The turn in degrees.
    #[must_use]
    pub fn turn_deg(self) -> u32 {
        90 * u32::from(self.quarter_turns % 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plate_is_turned_as_one_sees_it() {
        let right = Vector2::new(1.0, 0.0);
        let lies = |quarter_turns, mirrored| Laying { quarter_turns, mirrored }.apply(right);
        assert_eq!(lies(0, false), Vector2::new(1.0, 0.0));
        // a quarter turn counter-clockwise takes what was on the right to the top
        assert_eq!(lies(1, false), Vector2::new(0.0, -1.0));
        assert_eq!(lies(0, true), Vector2::new(-1.0, 0.0));
        let up = Laying { quarter_turns: 0, mirrored: true }.apply(Vector2::new(0.0, 1.0));
        assert_eq!(up, Vector2::new(0.0, -1.0));
    }

    #[test]
    fn right_reading_layings_have_a_negative_determinant_because_rows_run_down() {
        for laying in Laying::all() {
            assert_eq!(laying.axes().determinant() > 0.0, laying.mirrored);
            let nearly = nalgebra::Rotation2::new(0.5).matrix() * laying.axes() * 40.0;
            assert_eq!(Laying::nearest(&nearly), laying);
        }
    }

    #[test]
    fn one_laying_is_another_of_a_moved_plate() {
        let point = Vector2::new(3.0, 1.0);
        for (a, b) in Laying::all().into_iter().flat_map(|a| Laying::all().map(|b| (a, b))) {
            assert_eq!(a.apply(point), b.apply(a.onto(b) * point));
        }
    }
}
