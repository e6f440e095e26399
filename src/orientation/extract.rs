//! Line segments of the image where they are needed: tile by tile, each tile once, at two resolutions.
//!
//! Real photographs are soft: at full resolution detectors find little, at a half to a quarter of it much. So the
//! segments are taken from a *fine* and a *coarse* level.

use std::collections::HashSet;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::places::Places;
use crate::features::{Detection, LineSegment, Picture, PictureError, PixelRect, Tiling, line_segments};
use crate::geometry::{Camera, Segment2};
use crate::scenes::{ImageKeys, Measured};

/// A line segment of the image in reduced coordinates (pixels about the principal point, free of distortion).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedSegment {
    /// Its end points, reduced.
    pub segment_px: Segment2,
    /// Unit vector from start to end. On which side it is brighter depends on whether the scan is mirrored.
    pub direction: Vector2<f64>,
    /// Distance between the ends.
    pub length_px: f64,
    /// Covariance of the distances of start and end across the line.
    pub covariance_across: Matrix2<f64>,
    /// Whether it comes from the coarse level.
    pub coarse: bool,
    /// Its end points in pixels of the file.
    pub file_px: Segment2,
}

/// Cells along a side of a tile, at the fine level.
const TILE_CELLS: u32 = 1024;

/// Edges of so many pixels can be found on the level with half the resolution without loss.
const EDGE_FOR_REDUCTION_PX: f64 = 40.0;

/// Places so near to each other lead to the same measurement of a scene.
const SAME_START_PX: f64 = 1.5;

/// What is extracted of one image: segments and, for scenes, key points, growing with the regions that are asked for.
pub struct Extraction<'a> {
    picture: &'a dyn Picture,
    camera: &'a Camera,
    detection: Detection,
    fine_reduction: u32,
    tiles_done: HashSet<[u32; 2]>,
    segments: Vec<ObservedSegment>,
    /// Where those of the fine and of the coarse level are.
    places: [Places; 2],
    /// Key points, for control scenes.
    keys: ImageKeys<'a>,
    /// Scenes that were measured, by their control points, with the places where that began.
    measured: Vec<(usize, Vector2<f64>, Option<Measured>)>,
}

impl<'a> Extraction<'a> {
    /// Nothing is extracted yet. `edge_px` is the typical length of the edges that are looked for: where they are
    /// long, the finest level is left out.
    #[must_use]
    pub fn new(picture: &'a dyn Picture, camera: &'a Camera, edge_px: f64) -> Self {
        let fine_reduction = if edge_px >= EDGE_FOR_REDUCTION_PX { 2 } else { 1 };
        Self {
            picture,
            camera,
            detection: Detection::default(),
            fine_reduction,
            tiles_done: HashSet::new(),
            segments: Vec::new(),
            places: [0; 2].map(|_| Places::new(camera.frame_radius_px())),
            keys: ImageKeys::new(picture, camera, 1),
            measured: Vec::new(),
        }
    }

    /// The same, with the key points of a picture that is reduced by so much.
    #[must_use]
    pub fn for_scenes(self, reduction: u32) -> Self {
        Self { keys: ImageKeys::new(self.picture, self.camera, reduction), ..self }
    }

    /// Columns and rows of the picture.
    #[must_use]
    pub fn picture_px(&self) -> [u32; 2] {
        self.picture.size_px()
    }

    /// The key points so far.
    #[must_use]
    pub fn keys(&self) -> &ImageKeys<'a> {
        &self.keys
    }

    /// Finds the key points in rectangles given in pixels of the file.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn cover_keys(&mut self, rectangles_px: &[[Vector2<f64>; 2]]) -> Result<(), PictureError> {
        self.keys.cover(rectangles_px)
    }

    /// Measures a scene in the picture, at the resolution of its key points, unless that was done from about the same
    /// place: it leads to the same one.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn measured(
        &mut self,
        control_point: usize,
        start_px: Vector2<f64>,
        measure: impl FnOnce(&dyn Picture, u32) -> Result<Option<Measured>, PictureError>,
    ) -> Result<Option<Measured>, PictureError> {
        let same = |(k, start, _): &&(usize, Vector2<f64>, _)| {
            *k == control_point && (start - start_px).norm() < SAME_START_PX
        };
        if let Some((_, _, measured)) = self.measured.iter().find(same) {
            return Ok(*measured);
        }
        let measured = measure(self.picture, self.keys.reduction())?;
        self.measured.push((control_point, start_px, measured));
        Ok(measured)
    }

    /// Extracts the tiles that touch a rectangle given in pixels of the file (it may reach out of the picture).
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn cover(&mut self, least_px: Vector2<f64>, largest_px: Vector2<f64>) -> Result<(), PictureError> {
        self.cover_all(&[[least_px, largest_px]])
    }

    /// The same for many rectangles, with all cores; the order of the segments does not depend on their number.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn cover_all(&mut self, rectangles_px: &[[Vector2<f64>; 2]]) -> Result<(), PictureError> {
        let mut missing = Vec::new();
        for rectangle in rectangles_px {
            for tile in self.tiling().touching(*rectangle) {
                if self.tiles_done.insert(tile) {
                    missing.push(tile);
                }
            }
        }
        let found: Vec<_> = missing.par_iter().map(|tile| self.segments_of(*tile)).collect();
        for of_tile in found {
            for segment in of_tile? {
                self.places[usize::from(segment.coarse)].add(self.segments.len(), &segment);
                self.segments.push(segment);
            }
        }
        Ok(())
    }

    /// How many pixels of the file were read so far.
    #[must_use]
    pub fn pixels_read(&self) -> u64 {
        self.tiling().pixels(&self.tiles_done) + self.keys.pixels_read()
    }

    fn tiling(&self) -> Tiling {
        Tiling { size_px: self.picture.size_px(), side_px: self.tile_px() }
    }

    /// Pixels along a side of a tile.
    fn tile_px(&self) -> u32 {
        TILE_CELLS * self.fine_reduction
    }

    /// Pixels of the file along a side of a cell of the fine level.
    #[must_use]
    pub fn fine_reduction(&self) -> u32 {
        self.fine_reduction
    }

    /// All segments so far.
    #[must_use]
    pub fn segments(&self) -> &[ObservedSegment] {
        &self.segments
    }

    /// Those with their indices that touch the square about a reduced point with sides of `2 * reach_px`, and some
    /// others.
    pub fn near(&self, centre_px: Vector2<f64>, reach_px: f64) -> impl Iterator<Item = (usize, &ObservedSegment)> {
        let indices = self.places.iter().flat_map(move |level| level.near(centre_px, reach_px));
        indices.map(|index| (index, &self.segments[index]))
    }

    /// Of these the ones of the coarse level.
    pub fn coarse_near(&self, centre_px: Vector2<f64>, reach_px: f64) -> impl Iterator<Item = &ObservedSegment> {
        self.places[1].near(centre_px, reach_px).map(|index| &self.segments[index])
    }

    fn segments_of(&self, [column, row]: [u32; 2]) -> Result<Vec<ObservedSegment>, PictureError> {
        let side = self.tile_px();
        let rect = PixelRect { x: column * side, y: row * side, width: side, height: side };
        let mut segments = Vec::new();
        let fine = self.picture.window(rect, self.fine_reduction)?;
        for (window, coarse) in [(&fine, false), (&fine.halved(), true)] {
            let found = line_segments(window, &self.detection);
            segments.extend(found.iter().filter_map(|line| observed(self.camera, line, coarse)));
        }
        Ok(segments)
    }
}

/// The segment with its lens distortion removed; `None` where that is impossible, and beside the frame: around the
/// image a scan shows the rim of the film with marks and texts.
fn observed(camera: &Camera, line: &LineSegment, coarse: bool) -> Option<ObservedSegment> {
    if !camera.contains(line.segment.midpoint(), 0.0) {
        return None;
    }
    let reduced = |p| camera.reduced_from_pixel(p);
    let segment_px = Segment2 { start: reduced(line.segment.start)?, end: reduced(line.segment.end)? };
    Some(ObservedSegment {
        segment_px,
        direction: segment_px.direction(),
        length_px: segment_px.length(),
        // a mirrored scan turns the sense of both distances alike
        covariance_across: line.covariance_across * camera.reduced_per_pixel_across(&line.segment).powi(2),
        coarse,
        file_px: line.segment,
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::features::GreyWindow;
    use crate::geometry::Brown;

    /// White right of column 700, black left of it; remembers what was read.
    struct Step {
        read: Mutex<Vec<(PixelRect, u32)>>,
    }

    const SIZE: [u32; 2] = [5000, 3000];

    impl Picture for Step {
        fn size_px(&self) -> [u32; 2] {
            SIZE
        }

        fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
            self.read.lock().unwrap().push((rect, reduction));
            let cells = |at: u32, length: u32, size: u32| (length.min(size - at)).div_ceil(reduction) as usize;
            let (width, height) = (cells(rect.x, rect.width, SIZE[0]), cells(rect.y, rect.height, SIZE[1]));
            let column = |k: usize| rect.x as usize + k * reduction as usize;
            let grey = |k: usize| if column(k % width) >= 700 { 200.0 } else { 50.0 };
            let grey = (0..width * height).map(grey).collect();
            Ok(GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey })
        }
    }

    fn camera() -> Camera {
        Camera::new(SIZE, 4000.0, Vector2::new(2500.0, 1500.0), Brown::default()).unwrap()
    }

    #[test]
    fn only_what_is_needed_is_read_and_only_once() {
        let (picture, camera) = (Step { read: Mutex::default() }, camera());
        let mut extraction = Extraction::new(&picture, &camera, 100.0);
        let square = |extraction: &mut Extraction, least: f64, largest: f64| {
            extraction.cover(Vector2::repeat(least), Vector2::repeat(largest)).unwrap();
        };
        square(&mut extraction, 600.0, 800.0);
        // one tile of 2048 px, for both levels
        assert_eq!(picture.read.lock().unwrap().len(), 1);
        square(&mut extraction, -500.0, 1000.0);
        assert_eq!(picture.read.lock().unwrap().len(), 1);
        square(&mut extraction, 6000.0, 7000.0);
        assert_eq!(picture.read.lock().unwrap().len(), 1);
        assert_eq!(extraction.pixels_read(), 2048 * 2048);
        square(&mut extraction, 1900.0, 2100.0);
        assert_eq!(picture.read.lock().unwrap().len(), 4);
        // the lower tiles end with the picture
        assert_eq!(extraction.pixels_read(), 4096 * 3000);
    }

    #[test]
    fn an_edge_is_found_on_both_levels_where_it_is() {
        let (picture, camera) = (Step { read: Mutex::default() }, camera());
        let mut extraction = Extraction::new(&picture, &camera, 100.0);
        extraction.cover(Vector2::repeat(600.0), Vector2::repeat(800.0)).unwrap();
        for coarse in [false, true] {
            let found: Vec<_> = extraction.segments().iter().filter(|s| s.coarse == coarse).collect();
            assert_eq!(found.len(), 1);
            assert!(found[0].length_px > 2000.0);
            for end in [found[0].segment_px.start, found[0].segment_px.end] {
                assert!((end.x - (700.0 - 2500.0)).abs() < 0.1, "{end}");
            }
        }
    }

    #[test]
    fn short_edges_are_looked_for_at_full_resolution() {
        let (picture, camera) = (Step { read: Mutex::default() }, camera());
        assert_eq!(Extraction::new(&picture, &camera, 30.0).fine_reduction, 1);
        assert_eq!(Extraction::new(&picture, &camera, 120.0).fine_reduction, 2);
    }
}
