//! Which layings of a plate look alike.

use nalgebra::{Matrix2, Rotation2, Vector2};

use super::correlation::Correlator;
use super::laying::Laying;
use super::plate::{Fiducial, Plate};
use super::template::{Placing, Template};
use crate::features::GreyWindow;

/// Marks are at the same place if they are nearer than this: what the calibration adds to the design is a few
/// hundredths of a millimetre, and the search allows for no more.
const SAME_PLACE_MM: f64 = 0.25;
/// Cells for a millimetre when the looks of marks are compared, and the coefficient from which they look alike.
const CELLS_PER_MM: f64 = 9.7;
const ALIKE: f64 = 0.97;
/// Cells that belong to one of them only, as a share.
const MOST_DIFFERENT: f64 = 0.1;

/// Layings under which the marks look alike, so that but for the last micrometres they do not tell which it is: each with
/// the mark that is, under the first of them, in the place of every mark.
pub(super) type Group = Vec<(Laying, Vec<usize>)>;

/// All layings in groups.
pub(super) fn groups(plate: &Plate) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for laying in Laying::all() {
        let same = groups.iter_mut().find_map(|group| Some((in_place(plate, laying, group[0].0)?, group)));
        match same {
            Some((order, group)) => group.push((laying, order)),
            None => groups.push(vec![(laying, (0..plate.fiducials.len()).collect())]),
        }
    }
    groups
}

/// For each mark under one laying of a group, the mark that is in its place under another one of it; `None` if one of
/// them is not in the group.
pub(super) fn permutation(group: &Group, laying: Laying, other: Laying) -> Option<Vec<usize>> {
    let order = |wanted: Laying| group.iter().find(|(laying, _)| *laying == wanted).map(|(_, order)| order);
    let (order, other) = (order(laying)?, order(other)?);
    order.iter().map(|first| other.iter().position(|of_other| of_other == first)).collect()
}

/// For each mark under one laying, the mark that is in its place under another; `None` if the marks tell them apart.
fn in_place(plate: &Plate, laying: Laying, other: Laying) -> Option<Vec<usize>> {
    let moved = laying.onto(other);
    let in_place_of = |mark: &Fiducial| {
        let place = moved * mark.position_mm;
        plate
            .fiducials
            .iter()
            .position(|other| (other.position_mm - place).norm() < SAME_PLACE_MM && look_alike(mark, &moved, other))
    };
    plate.fiducials.iter().map(in_place_of).collect()
}

/// Whether a mark, moved with the plate, looks like another one.
fn look_alike(mark: &Fiducial, moved: &Matrix2<f64>, other: &Fiducial) -> bool {
    let drawn = |mark: &Fiducial, moved: &Matrix2<f64>| {
        let turned = moved * Rotation2::new(mark.rotation_rad).matrix();
        let cells_from_mm = Matrix2::new(CELLS_PER_MM, 0.0, 0.0, -CELLS_PER_MM) * turned;
        Template::draw(&mark.mark, &Placing { cells_from_mm, centre: Vector2::zeros(), blur: 0.5, core: false })
    };
    let (mut a, b) = (drawn(mark, moved), drawn(other, &Matrix2::identity()));
    if a.half != b.half {
        return false;
    }
    let differ = a.care.iter().zip(&b.care).filter(|(a, b)| a != b).count();
    // cells on the rim may belong to the one and not to the other
    a.care.iter_mut().zip(&b.care).for_each(|(a, b)| *a &= *b);
    let side = b.side();
    let window = GreyWindow { origin_px: [0, 0], reduction: 1, width: side, height: side, grey: b.grey };
    let fit = Correlator::new(&a).and_then(|correlator| correlator.fit(&window, [a.half; 2]));
    fit.is_some_and(|fit| fit.rho > ALIKE) && (differ as f64) < MOST_DIFFERENT * a.count() as f64
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::interior::mark::{Library, Mark};

    fn plate(marks: &[(f64, f64, Library, f64)]) -> Plate {
        let fiducial = |(k, (x, y, library, deg)): (usize, &(f64, f64, Library, f64))| Fiducial {
            name: k.to_string(),
            position_mm: Vector2::new(x + 0.01, y - 0.02),
            sigma_mm: 0.002,
            mark: Arc::new(Mark::Library(*library)),
            rotation_rad: deg.to_radians(),
        };
        let fiducials = marks.iter().enumerate().map(fiducial).collect();
        Plate { fiducials, asymmetric: None, data_strip: None, format_mm: [230.0, 230.0] }
    }

    #[test]
    fn marks_in_a_square_leave_all_eight_open_and_others_fewer() {
        use Library::{WildRc20, ZeissRmk};
        let count = |marks: &[(f64, f64, Library, f64)]| {
            let groups = groups(&plate(marks));
            assert!(groups.iter().all(|group| group.len() == groups[0].len()));
            groups.len()
        };
        let corners =
            [(-106.0, -106.0), (106.0, 106.0), (-106.0, 106.0), (106.0, -106.0)].map(|(x, y)| (x, y, WildRc20, 0.0));
        assert_eq!(count(&corners), 1);
        let wedges = [(113.0, 0.0, 0.0), (0.0, 113.0, 90.0), (-113.0, 0.0, 180.0), (0.0, -113.0, 270.0)]
            .map(|(x, y, deg)| (x, y, ZeissRmk, deg));
        assert_eq!(count(&wedges), 1);
        // one wedge points elsewhere: only its own mirror image looks alike
        let mut odd = wedges;
        odd[0].3 = 180.0;
        assert_eq!(count(&odd), 4);
        let oblong = corners.map(|(x, y, library, deg)| (x, 0.8 * y, library, deg));
        assert_eq!(count(&oblong), 2);
        let five = [&corners[..], &[(-100.0, 30.0, WildRc20, 0.0)]].concat();
        assert_eq!(count(&five), 8);
    }

    #[test]
    fn a_permutation_says_which_mark_is_where_another_would_be() {
        let corners = [(-106.0, -106.0), (106.0, -106.0), (106.0, 106.0), (-106.0, 106.0)]
            .map(|(x, y)| (x, y, Library::WildRc10, 0.0));
        let plate = plate(&corners);
        let straight = Laying { quarter_turns: 0, mirrored: false };
        let turned = Laying { quarter_turns: 1, mirrored: false };
        // turned counter-clockwise, the first mark (bottom left) comes to the bottom right, where the second was
        assert_eq!(permutation(&groups(&plate)[0], turned, straight), Some(vec![1, 2, 3, 0]));
        // and it is the same by way of any third one
        for (a, b) in Laying::all().into_iter().flat_map(|a| Laying::all().map(|b| (a, b))) {
            assert_eq!(permutation(&groups(&plate)[0], a, b), in_place(&plate, a, b));
        }
    }
}
