//! How far is an ortho-photo off? Against an ortho-photo that exists, or against lines on the ground that are known, such
//! as kerbs, walls, and edges of flat roofs that the elevation model has.

mod edges;
mod matching;

use nalgebra::{Matrix2, Matrix2x3, Vector2};

pub use edges::against_edges;
pub use matching::against_ortho_photo;

use crate::features::{GreyWindow, Picture, PictureError, PixelRect};

/// An ortho-photo with its place.
#[derive(Clone, Copy)]
pub struct OrthoPhoto<'a> {
    /// Its pixels.
    pub picture: &'a dyn Picture,
    /// Grid coordinates of pixels (x right, y down, 1), counted from the corner of the top-left one.
    pub ground_from_pixel: Matrix2x3<f64>,
}

/// What is off at one place.
#[derive(Debug, Clone, PartialEq)]
pub struct Offset {
    /// Easting and northing.
    pub at_m: Vector2<f64>,
    /// Where the ortho-photo has it, less where it is; of an edge only the part across it.
    pub shift_m: Vector2<f64>,
}

/// What is off altogether.
#[derive(Debug, Clone, PartialEq)]
pub struct Shift {
    /// Places where something could be recognized: both show it, and it is like no other place nearby.
    pub tried: usize,
    /// Where something was found that is like what is looked for.
    pub offsets: Vec<Offset>,
    /// The shift that all have in common, robustly: east, north.
    pub common_m: Vector2<f64>,
    /// Root mean square length of the offsets.
    pub rms_m: f64,
    /// Of 95 in 100 the length is not larger.
    pub p95_m: f64,
    /// Side of a pixel of the ortho-photo.
    pub gsd_m: f64,
}

/// Why it cannot be told how far an ortho-photo is off.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OrthoError {
    /// A picture cannot be read.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// Too little was found for the ground to be the same, or for the shift to be within the search.
    #[error(
        "only {found} of {tried} places were found again, and it takes at least {LEAST_FOUND} and a fifth of them; is it the \
         same ground, and the same CRS? A shift beyond {search_m} m is found only in a wider search"
    )]
    Few {
        /// Places that were found again.
        found: usize,
        /// Places where something could be recognized.
        tried: usize,
        /// How far was searched.
        search_m: f64,
    },
    /// What was found lies about like chance.
    #[error(
        "the {found} places that were found have no shift in common: more than half are farther than {} m from any; a shift \
         beyond {search_m} m is found only in a wider search", search_m * AGREEING
    )]
    Scattered {
        /// Places that were found.
        found: usize,
        /// How far was searched.
        search_m: f64,
    },
    /// All lines run alike, and none tells the shift along them.
    #[error("the {found} lines that were found tell one direction only; give some that run across the others")]
    OneDirection {
        /// Lines that were found.
        found: usize,
    },
}

/// With fewer places nothing is told.
const LEAST_FOUND: usize = 5;
/// One in so many places must be found again: between years the ground changes, but not all of it.
const ONE_IN: usize = 5;
/// Half of what is found must lie within this share of the search around the common shift. By chance a twentieth of the
/// places does, and a quarter of the lines.
const AGREEING: f64 = 0.25;

/// What comes of looking at a place.
enum Look<T> {
    /// There is nothing that could be recognized.
    Blind,
    /// There is, but it was not found again.
    Lost,
    /// It was found.
    Found(T),
}

/// What was found, and at how many places it was looked for; unless that is too little to tell anything.
fn evidence<T>(looks: Vec<Look<T>>, search_m: f64) -> Result<(Vec<T>, usize), OrthoError> {
    let tried = looks.iter().filter(|look| !matches!(look, Look::Blind)).count();
    let found: Vec<T> =
        looks.into_iter().filter_map(|look| if let Look::Found(found) = look { Some(found) } else { None }).collect();
    if found.len() < LEAST_FOUND || ONE_IN * found.len() < tried {
        return Err(OrthoError::Few { found: found.len(), tried, search_m });
    }
    Ok((found, tried))
}

/// Refuses what agrees no better than chance does, by what is left of each place when the common shift is taken away.
fn check_agreement(left_m: impl Iterator<Item = f64>, found: usize, search_m: f64) -> Result<(), OrthoError> {
    if median(left_m.map(f64::abs)) > AGREEING * search_m {
        return Err(OrthoError::Scattered { found, search_m });
    }
    Ok(())
}

impl OrthoPhoto<'_> {
    /// Side of a pixel on the ground.
    #[must_use]
    pub fn gsd_m(&self) -> f64 {
        self.linear().determinant().abs().sqrt()
    }

    fn linear(&self) -> Matrix2<f64> {
        self.ground_from_pixel.fixed_view::<2, 2>(0, 0).into_owned()
    }

    /// The pixel of a place; `None` for a georeference that is none.
    fn pixel(&self, ground_m: Vector2<f64>) -> Option<Vector2<f64>> {
        Some(self.linear().try_inverse()? * (ground_m - self.ground_from_pixel.column(2)))
    }

    /// Least and largest easting and northing.
    fn extent_m(&self) -> [Vector2<f64>; 2] {
        let [width, height] = self.picture.size_px().map(f64::from);
        let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
            .map(|(x, y)| self.ground_from_pixel * nalgebra::Vector3::new(x, y, 1.0));
        let [first, rest @ ..] = corners;
        rest.into_iter().fold([first; 2], |[least, most], corner| [least.inf(&corner), most.sup(&corner)])
    }

    /// Grey values around a place, out to `radius_m` to all sides.
    fn around(&self, at_m: Vector2<f64>, radius_m: f64) -> Result<Option<Around>, PictureError> {
        let Some(centre) = self.pixel(at_m) else { return Ok(None) };
        let radius_px = radius_m / self.gsd_m() + 2.0;
        let [width, height] = self.picture.size_px().map(f64::from);
        let least = Vector2::new((centre.x - radius_px).floor().max(0.0), (centre.y - radius_px).floor().max(0.0));
        let most = Vector2::new((centre.x + radius_px).ceil().min(width), (centre.y + radius_px).ceil().min(height));
        if most.x - least.x < 2.0 || most.y - least.y < 2.0 {
            return Ok(None);
        }
        let size = most - least;
        let rect = PixelRect { x: least.x as u32, y: least.y as u32, width: size.x as u32, height: size.y as u32 };
        let Some(pixel_from_ground) = self.linear().try_inverse() else { return Ok(None) };
        let origin_m = self.ground_from_pixel.column(2).into_owned();
        Ok(Some(Around { window: self.picture.window(rect, 1)?, pixel_from_ground, origin_m }))
    }
}

/// A window that is asked by places on the ground.
struct Around {
    window: GreyWindow,
    pixel_from_ground: Matrix2<f64>,
    origin_m: Vector2<f64>,
}

impl Around {
    /// The grey value between four pixels; `None` outside, and where black says that the ortho-photo has no data.
    fn grey(&self, ground_m: Vector2<f64>) -> Option<f64> {
        let pixel = self.pixel_from_ground * (ground_m - self.origin_m);
        let [left, top] = self.window.origin_px.map(f64::from);
        let (x, y) = (pixel.x - left - 0.5, pixel.y - top - 0.5);
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if column + 1 >= self.window.width || row + 1 >= self.window.height {
            return None;
        }
        let value = |dx: usize, dy: usize| f64::from(self.window.grey[(row + dy) * self.window.width + column + dx]);
        let [a, b, c, d] = [value(0, 0), value(1, 0), value(0, 1), value(1, 1)];
        if [a, b, c, d].contains(&0.0) {
            return None;
        }
        let (fx, fy) = (x - column as f64, y - row as f64);
        Some((a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy)
    }
}

impl Shift {
    fn of(tried: usize, offsets: Vec<Offset>, common_m: Vector2<f64>, gsd_m: f64) -> Self {
        let mut lengths: Vec<f64> = offsets.iter().map(|offset| offset.shift_m.norm()).collect();
        lengths.sort_by(f64::total_cmp);
        let squares: f64 = lengths.iter().map(|length| length * length).sum();
        let last = (0.95 * lengths.len() as f64) as usize;
        Self {
            tried,
            common_m,
            rms_m: (squares / lengths.len().max(1) as f64).sqrt(),
            p95_m: lengths.get(last).or(lengths.last()).copied().unwrap_or(0.0),
            gsd_m,
            offsets,
        }
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
