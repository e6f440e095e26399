//! Check points: buildings that an orientation was not found by tell how right it is.

use super::outcome::in_view;
use super::run::Run;
use super::{CheckPointResult, Fault};
use crate::orientation::ControlPoint;
use crate::orientation::adjust::Adjustment;
use crate::orientation::check::checked;
use crate::orientation::extract::Extraction;
use crate::orientation::predict::Approximation;
use crate::orientation::search::Search;
use crate::orientation::select::well_spread;

/// Buildings that are checked, at most: as many as an image is oriented by.
const MOST_CHECKED: usize = 60;

impl Run<'_> {
    /// What the image shows of the check points that are in view under an adjusted orientation; those that were not
    /// found are told as well.
    pub(super) fn check_points(
        &self,
        adjustment: &Adjustment,
        extraction: &mut Extraction,
    ) -> Result<Vec<CheckPointResult>, Fault> {
        let camera = &self.task.camera;
        let orientation = adjustment.orientation;
        let approximation = Approximation { orientation, ..self.task.approximation.clone() };
        let all = Search::new(camera, &self.task.check, &approximation);
        let shown: Vec<_> = in_view(&all, None).map(|index| self.task.check[index].clone()).collect();
        let shown = well_spread(&shown, MOST_CHECKED);
        let search = Search::new(camera, &shown, &approximation);
        let found = checked(&search, &adjustment.prediction(), extraction)?;
        let result = |(index, point): (usize, &ControlPoint)| {
            let predicted_px = orientation.reduced_px(camera.principal_distance_px, point.reference_m)?;
            let found = found.iter().find(|found| found.control_point == index);
            let residual_px = found.map(|found| found.shift_px.norm());
            let depth_m = -orientation.camera_coordinates(point.reference_m).z;
            Some(CheckPointResult {
                name: point.name.clone(),
                predicted_px: camera.pixel_from_reduced(predicted_px),
                located_px: found.map(|found| camera.pixel_from_reduced(predicted_px + found.shift_px)),
                segments_matched: found.map_or(0, |found| found.edges_matched),
                residual_px,
                residual_m: residual_px.map(|residual_px| residual_px * depth_m / camera.principal_distance_px),
            })
        };
        Ok(shown.iter().enumerate().filter_map(result).collect())
    }
}
