//! A mark as it is expected in the scan: grey values on the scan's own raster, and which of them count.

use nalgebra::{Matrix2, Vector2};

use super::figure::Figure;
use super::mark::{Cut, Mark};

/// Grey values of an expected mark, an odd number of cells a side; its centre lies in the middle cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Template {
    /// Cells from the middle one to the rim.
    pub(super) half: usize,
    /// Row by row.
    pub(super) grey: Vec<f32>,
    /// Whether a cell counts.
    pub(super) care: Vec<bool>,
}

/// How a mark is to be drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placing {
    /// From the mark's own frame, millimetres, to cells.
    pub(super) cells_from_mm: Matrix2<f64>,
    /// From the centre of the middle cell to the mark's centre, cells.
    pub(super) centre: Vector2<f64>,
    /// Blur of the scanner, cells, beside that of the cell itself.
    pub(super) blur: f64,
    /// Whether only the mark itself is drawn, without its surroundings: on the lowest level.
    pub(super) core: bool,
}

/// More cells are never drawn on one side of the middle: what is farther out is left out on the lowest level.
const LARGEST_HALF: usize = 170;

impl Template {
    pub(super) fn side(&self) -> usize {
        2 * self.half + 1
    }

    /// Draws a mark.
    pub(super) fn draw(mark: &Mark, placing: &Placing) -> Self {
        let scale = placing.cells_from_mm.determinant().abs().sqrt();
        let mm_from_cells = placing.cells_from_mm.try_inverse().unwrap_or_else(Matrix2::zeros);
        let half = Self::half_of(mark, placing);
        match mark {
            Mark::Library(library) => {
                let figure = Figure::of(*library);
                // a cell's box has the variance 1/12
                let blur_mm = (placing.blur.powi(2) + 1.0 / 12.0).sqrt() / scale;
                Self::of(half, placing.centre, |from_centre| {
                    let place = mm_from_cells * from_centre;
                    let belongs = figure.cares(place) && (!placing.core || figure.is_core(place));
                    // edges are evened out, for which what is beside them is needed
                    (belongs || figure.edges).then(|| (figure.grey(place, blur_mm) as f32, belongs))
                })
            }
            Mark::Cut(cut) => {
                let steps = (1.0 / (scale * cut.pixel_mm)).ceil().max(1.0);
                Self::of(half, placing.centre, |from_centre| {
                    cut.mean(&mm_from_cells, from_centre, steps as usize).map(|grey| (grey, true))
                })
            }
        }
    }

    /// Cells from the middle to the rim of a mark that is drawn so.
    pub(super) fn half_of(mark: &Mark, placing: &Placing) -> usize {
        let extent_mm = match mark {
            Mark::Library(library) if placing.core => Figure::of(*library).core_mm,
            Mark::Library(library) => Figure::of(*library).extent_mm,
            Mark::Cut(cut) => cut.extent_mm(),
        };
        // turned, the corners of a square reach farther
        let extent = extent_mm * placing.cells_from_mm.determinant().abs().sqrt();
        ((1.1 * extent).ceil() as usize + 1).min(LARGEST_HALF)
    }

    /// `grey` gives the value of a cell by the vector from the mark's centre, and whether it counts.
    fn of(half: usize, centre: Vector2<f64>, grey: impl Fn(Vector2<f64>) -> Option<(f32, bool)>) -> Self {
        let side = 2 * half + 1;
        let mut template = Self { half, grey: Vec::with_capacity(side * side), care: Vec::with_capacity(side * side) };
        for row in 0..side {
            for column in 0..side {
                let cell = Vector2::new(column as f64 - half as f64, row as f64 - half as f64);
                let value = grey(cell - centre);
                let (grey, belongs) = value.unwrap_or_default();
                template.care.push(belongs);
                template.grey.push(grey);
            }
        }
        template
    }

    /// Cells that count.
    pub(super) fn count(&self) -> usize {
        self.care.iter().filter(|care| **care).count()
    }
}

impl Cut {
    /// Half of the longer side on the film, from the centre.
    pub(super) fn extent_mm(&self) -> f64 {
        let (width, height) = (self.width as f64, self.height as f64);
        let farthest = [self.centre_px.x, width - self.centre_px.x, self.centre_px.y, height - self.centre_px.y];
        farthest.into_iter().fold(0.0, f64::max) * self.pixel_mm
    }

    /// The mean of `steps` x `steps` places of a cell; nothing if one of them does not count.
    fn mean(&self, mm_from_cells: &Matrix2<f64>, from_centre: Vector2<f64>, steps: usize) -> Option<f32> {
        let at = |k: usize| (k as f64 + 0.5) / steps as f64 - 0.5;
        let mut sum = 0.0;
        for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
            sum += self.value(mm_from_cells * (from_centre + Vector2::new(at(i), at(j))))?;
        }
        Some(sum / (steps * steps) as f32)
    }

    /// Between the four nearest pixels, all of which must count. `place_mm` has y up, the cut's rows run down.
    fn value(&self, place_mm: Vector2<f64>) -> Option<f32> {
        let x = self.centre_px.x + place_mm.x / self.pixel_mm - 0.5;
        let y = self.centre_px.y - place_mm.y / self.pixel_mm - 0.5;
        let (column, row) = (x.floor(), y.floor());
        if column < 0.0 || row < 0.0 || column as usize + 1 >= self.width || row as usize + 1 >= self.height {
            return None;
        }
        let (fx, fy) = ((x - column) as f32, (y - row) as f32);
        let index = row as usize * self.width + column as usize;
        let pixel = |k: usize| self.care[k].then(|| self.grey[k]);
        let above = (1.0 - fx) * pixel(index)? + fx * pixel(index + 1)?;
        let below = (1.0 - fx) * pixel(index + self.width)? + fx * pixel(index + self.width + 1)?;
        Some((1.0 - fy) * above + fy * below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interior::mark::Library;

    fn placing(scale: f64, centre: Vector2<f64>) -> Placing {
        Placing { cells_from_mm: Matrix2::new(scale, 0.0, 0.0, -scale), centre, blur: 0.5, core: false }
    }

    /// The centre of gravity of the light near the middle, from the middle of the template.
    fn dot(template: &Template, reach: usize) -> Vector2<f64> {
        let mut sum = (0.0, Vector2::zeros());
        for row in template.half - reach..=template.half + reach {
            for column in template.half - reach..=template.half + reach {
                let light = f64::from(template.grey[row * template.side() + column]);
                let cell = Vector2::new(column as f64, row as f64).map(|v| v - template.half as f64);
                sum = (sum.0 + light, sum.1 + light * cell);
            }
        }
        sum.1 / sum.0
    }

    #[test]
    fn the_mark_s_centre_is_where_it_is_asked_for() {
        let centre = Vector2::new(0.3, -0.2);
        let template = Template::draw(&Mark::Library(Library::WildRc20), &placing(50.0, centre));
        assert!((dot(&template, 12) - centre).norm() < 1e-3);
    }

    #[test]
    fn a_cut_mark_is_drawn_at_its_own_size_and_at_others() {
        let drawn = Template::draw(&Mark::Library(Library::WildRc20), &placing(50.0, Vector2::new(0.3, -0.2)));
        let side = drawn.side();
        let middle = drawn.half as f64 + 0.5;
        let cut = Mark::Cut(Cut {
            width: side,
            height: side,
            grey: drawn.grey.clone(),
            care: drawn.care.clone(),
            centre_px: Vector2::new(middle + 0.3, middle - 0.2),
            pixel_mm: 0.02,
        });
        for (scale, reach) in [(50.0, 12), (23.0, 6)] {
            let centre = Vector2::new(-0.25, 0.4);
            let again = Template::draw(&cut, &placing(scale, centre));
            assert!((dot(&again, reach) - centre).norm() < 0.02, "{scale}");
        }
    }
}
