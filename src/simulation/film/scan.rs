//! The scan, rendered where it is looked at.

use nalgebra::Vector2;

use super::camera::TruePlate;
use super::painter::Painter;
use super::settings::ScanSettings;
use super::sheet::Sheet;
use super::texture::{Land, Texture};
use super::tone::Tone;
use super::truth::{Layout, ScanTruth, TrueMark};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::interior::Plate;
use crate::simulation::draws::{Draws, Purpose};

/// Pixels along a side of the blocks whose figures are collected together, and of the zones that hold such blocks.
const BLOCK_PX: u32 = 16;
const ZONE_PX: u32 = 256;
/// Pixels between the places where what changes slowly is worked out, and how many of them there are along a block.
const LAND_PX: u32 = 8;
const LANDS: usize = (BLOCK_PX / LAND_PX) as usize + 1;
/// The same in cells, for reduced windows.
const BLOCK_CELLS: u32 = 2;
const ZONE_CELLS: u32 = 32;
/// A little more than the square root of 2: half a square's diagonal by half its side.
const DIAGONAL: f64 = 1.42;
/// Rows of pixels that are rendered at once; a multiple of all reductions that are exact.
const BAND_PX: u32 = 96;
/// Up to this reduction the cells are exact means of pixels.
const EXACT_REDUCTION: u32 = 3;
/// Spots along a side of a reduced cell, where there are figures and where there is content alone.
const SPOTS: u32 = 4;
const CONTENT_SPOTS: u32 = 2;

/// Gives what the film shows as a grey window, 0 to 255 as in a positive, in pixels of the scan.
pub type Rendering<'a> = Box<dyn Fn(PixelRect, u32) -> GreyWindow + Sync + Send + 'a>;

/// What the image on the film shows.
pub enum Content<'a> {
    /// A landscape of no place, from a seed.
    Texture(u64),
    /// Whatever a function gives for a rectangle of the scan's pixels, reduced as asked for, as
    /// [`Picture::window`] does. Response, polarity, uneven light and grain of the scan come on top of it.
    Rendered(Rendering<'a>),
}

enum Image<'a> {
    Texture(Texture),
    Rendered(Rendering<'a>),
}

/// A scanned film of which everything is known.
pub struct SimulatedScan<'a> {
    plate: Plate,
    truth: ScanTruth,
    layout: Layout,
    sheet: Sheet,
    tone: Tone,
    image: Image<'a>,
    /// One by half the width and height.
    per_half: [f32; 2],
}

/// Pixels in the making.
struct Target {
    rect: PixelRect,
    content: Vec<f32>,
    grey: Vec<f32>,
}

impl Target {
    fn index(&self, x: u32, y: u32) -> usize {
        (y - self.rect.y) as usize * self.rect.width as usize + (x - self.rect.x) as usize
    }
}

/// What changes slowly, row by row over a block.
type Lands = [[Land; LANDS]; LANDS];

impl<'a> SimulatedScan<'a> {
    /// Draws a scan; nothing is rendered yet. Its content is a texture from the same seed.
    #[must_use]
    pub fn draw(seed: u64, settings: &ScanSettings) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmPlate);
        let plate =
            TruePlate::draw(settings.camera, settings.asymmetric, settings.data_strip, &settings.plate, &mut draws);
        let outside = plate.asymmetric_mm.is_some_and(|place| {
            place.iter().zip(settings.camera.opening_mm()).any(|(place, half)| place.abs() > f64::from(half))
        });
        let margin_mm = if settings.data_strip.is_some() {
            draws.between(15.0, 18.0)
        } else if outside {
            draws.between(11.0, 15.0)
        } else {
            draws.between(4.0, 12.0)
        };
        let layout = Layout::draw(settings, settings.camera.opening_mm(), margin_mm, seed);
        let tone = Tone::draw(&settings.scanner, seed);
        let sheet = Sheet::draw(settings, &plate, &tone, seed);
        let truth = truth(settings, &plate, &sheet, &layout);
        let image = Image::Texture(texture(seed));
        let per_half = layout.size_px.map(|side_px| 2.0 / side_px as f32);
        Self { plate: plate.known, truth, layout, sheet, tone, image, per_half }
    }

    /// The same with other content.
    #[must_use]
    pub fn with_content(self, content: Content<'a>) -> Self {
        let image = match content {
            Content::Texture(seed) => Image::Texture(texture(seed)),
            Content::Rendered(rendering) => Image::Rendered(rendering),
        };
        Self { image, ..self }
    }

    /// What is known of the plate beforehand.
    #[must_use]
    pub fn plate(&self) -> &Plate {
        &self.plate
    }

    /// What is not known beforehand.
    #[must_use]
    pub fn truth(&self) -> &ScanTruth {
        &self.truth
    }

    /// The size of a pixel as the file states it.
    #[must_use]
    pub fn nominal_pixel_um(&self) -> f64 {
        self.layout.nominal_pixel_um
    }

    fn plate_at(&self, x_px: f64, y_px: f64) -> Vector2<f64> {
        self.layout.plate(Vector2::new(x_px, y_px))
    }

    /// The part of a rectangle that lies in the scan.
    fn clipped(&self, rect: PixelRect) -> PixelRect {
        let [width_px, height_px] = self.layout.size_px;
        let (x, y) = (rect.x.min(width_px), rect.y.min(height_px));
        PixelRect { x, y, width: rect.width.min(width_px - x), height: rect.height.min(height_px - y) }
    }

    /// Grey values before rounding, row by row, of a rectangle within the scan.
    pub(super) fn pixels(&self, rect: PixelRect) -> Vec<f32> {
        let content = match &self.image {
            Image::Rendered(rendering) => rendering(rect, 1).grey,
            Image::Texture(_) => Vec::new(),
        };
        let mut target = Target { rect, content, grey: vec![0.0; rect.width as usize * rect.height as usize] };
        for zone in tiles(rect, ZONE_PX) {
            let sheet = self.near(zone, BLOCK_PX);
            for block in tiles(zone, BLOCK_PX) {
                self.block(block, &sheet, &mut target);
            }
        }
        self.tone.add_grain(rect, &mut target.grey);
        target.grey
    }

    /// The part of the film that may be felt in a rectangle and in blocks of such a side that reach beyond it.
    fn near(&self, rect: PixelRect, block_px: u32) -> Sheet {
        let centre = |from: u32, length: u32| f64::from(from) + 0.5 * f64::from(length);
        let centre_mm = self.plate_at(centre(rect.x, rect.width), centre(rect.y, rect.height));
        let (pixel_mm, block_px) = (self.layout.pixel_mm(), f64::from(block_px));
        let half_px = 0.5 * f64::from(rect.width.max(rect.height)) + block_px;
        // a cell's blur is less than a pixel's and a block's side together
        let sigma_mm = (self.tone.blur_px + block_px) * pixel_mm;
        self.sheet.near(centre_mm, half_px * DIAGONAL * pixel_mm, sigma_mm)
    }

    /// The pixels of a block without grain.
    fn block(&self, block: PixelRect, sheet: &Sheet, target: &mut Target) {
        // all pixels of the raster's block see the same figures, in whatever window they are
        let (left, top) = (block.x - block.x % BLOCK_PX, block.y - block.y % BLOCK_PX);
        let half_px = 0.5 * f64::from(BLOCK_PX);
        let centre_mm = self.plate_at(f64::from(left) + half_px, f64::from(top) + half_px);
        let pixel_mm = self.layout.pixel_mm();
        let sigma_mm = (self.tone.blur_px.powi(2) + 1.0 / 12.0).sqrt() * pixel_mm;
        let painter = Painter::new(sheet, self.truth.negative, centre_mm, half_px * pixel_mm * DIAGONAL, sigma_mm);
        let texture = match &self.image {
            Image::Texture(texture) if painter.shows_content() => Some((texture, self.lands(texture, left, top))),
            _ => None,
        };
        let right_mm = self.layout.steps_mm()[0];
        for y in block.y..block.y + block.height {
            let row_mm = self.plate_at(0.5, f64::from(y) + 0.5);
            let start = target.index(block.x, y);
            let lands = texture.as_ref().map(|(texture, lands)| (texture, between(lands, y - top)));
            for (index, x) in (start..).zip(block.x..block.x + block.width) {
                let place_mm = row_mm + right_mm * f64::from(x);
                let content = match &lands {
                    Some((texture, lands)) => texture.grey(place_mm, &along(lands, x - left), pixel_mm),
                    None => target.content.get(index).map_or(0.0, |grey| grey / 255.0),
                };
                let light = painter.light(content, place_mm) * self.light_at(x as f32, y as f32);
                target.grey[index] = self.tone.grey(light);
            }
        }
    }

    /// What changes slowly, at the corners of the parts of a block.
    fn lands(&self, texture: &Texture, left: u32, top: u32) -> Lands {
        let land = |column: usize, row: usize| {
            let at = |first: u32, part: usize| f64::from(first + part as u32 * LAND_PX) + 0.5;
            texture.land(self.plate_at(at(left, column), at(top, row)), self.layout.pixel_mm())
        };
        std::array::from_fn(|row| std::array::from_fn(|column| land(column, row)))
    }

    fn light_at(&self, x_px: f32, y_px: f32) -> f32 {
        let [right, down] = self.per_half;
        self.tone.light(x_px * right - 1.0, y_px * down - 1.0)
    }

    /// The means of exact pixels.
    fn averaged(&self, rect: PixelRect, reduction: u32, window: &mut GreyWindow) {
        let mut at = 0;
        for top in (rect.y..rect.y + rect.height).step_by(BAND_PX as usize) {
            let band = PixelRect { y: top, height: BAND_PX.min(rect.y + rect.height - top), ..rect };
            let pixels: Vec<f32> = self.pixels(band).into_iter().map(rounded).collect();
            for rows in pixels.chunks((reduction * rect.width) as usize) {
                for column in (0..rect.width as usize).step_by(reduction as usize) {
                    let to = (column + reduction as usize).min(rect.width as usize);
                    let parts = rows.chunks(rect.width as usize).map(|row| row[column..to].iter().sum::<f32>());
                    let count = (to - column) * (rows.len() / rect.width as usize);
                    window.grey[at] = parts.sum::<f32>() / count as f32;
                    at += 1;
                }
            }
        }
    }

    /// The approximate means of cells.
    fn sampled(&self, rect: PixelRect, reduction: u32, window: &mut GreyWindow) {
        let content = match &self.image {
            Image::Rendered(rendering) => rendering(rect, reduction).grey,
            Image::Texture(_) => Vec::new(),
        };
        for zone in
            tiles(PixelRect { x: 0, y: 0, width: window.width as u32, height: window.height as u32 }, ZONE_CELLS)
        {
            let [x, y] = [rect.x + zone.x * reduction, rect.y + zone.y * reduction];
            let in_pixels = PixelRect { x, y, width: zone.width * reduction, height: zone.height * reduction };
            let sheet = self.near(in_pixels, BLOCK_CELLS * reduction);
            for block in tiles(zone, BLOCK_CELLS) {
                self.cell_block(block, &sheet, &content, window);
            }
        }
    }

    /// The cells of a block, which counts in cells of the window.
    fn cell_block(&self, block: PixelRect, sheet: &Sheet, content: &[f32], window: &mut GreyWindow) {
        let reduction = window.reduction;
        let cell_px = f64::from(reduction);
        let half = 0.5 * f64::from(BLOCK_CELLS);
        let centre = |first: u32, origin: u32| f64::from(origin) + (f64::from(first) + half) * cell_px;
        let centre_mm = self.plate_at(centre(block.x, window.origin_px[0]), centre(block.y, window.origin_px[1]));
        let pixel_mm = self.layout.pixel_mm();
        let spot_px = cell_px / f64::from(SPOTS);
        let sigma_mm = (self.tone.blur_px.powi(2) + spot_px * spot_px / 12.0).sqrt() * pixel_mm;
        let radius_mm = half * cell_px * pixel_mm * DIAGONAL;
        let painter = Painter::new(sheet, self.truth.negative, centre_mm, radius_mm, sigma_mm);
        for row in block.y..block.y + block.height {
            for column in block.x..block.x + block.width {
                let (x, y) = (window.origin_px[0] + column * reduction, window.origin_px[1] + row * reduction);
                let index = row as usize * window.width + column as usize;
                let grey = self.cell([x, y], reduction, content.get(index).copied(), &painter);
                window.grey[index] = (grey + self.tone.cell_grain([x, y], reduction)).clamp(0.0, 255.0);
            }
        }
    }

    fn cell(&self, [x, y]: [u32; 2], reduction: u32, given: Option<f32>, painter: &Painter) -> f32 {
        let (x, y, cell_px) = (f64::from(x), f64::from(y), f64::from(reduction));
        let uneven = self.light_at((x + 0.5 * cell_px) as f32, (y + 0.5 * cell_px) as f32);
        let spots = |along: u32| {
            let spot_px = cell_px / f64::from(along);
            (0..along * along).map(move |k| {
                let [i, j] = [k % along, k / along].map(|k| (f64::from(k) + 0.5) * spot_px);
                self.plate_at(x + i, y + j)
            })
        };
        let content = match &self.image {
            Image::Texture(texture) if painter.shows_content() => {
                let cell_mm = cell_px * self.layout.pixel_mm();
                let land = texture.land(self.plate_at(x + 0.5 * cell_px, y + 0.5 * cell_px), cell_mm);
                let spot_mm = cell_mm / f64::from(CONTENT_SPOTS);
                let sum: f32 = spots(CONTENT_SPOTS).map(|place_mm| texture.grey(place_mm, &land, spot_mm)).sum();
                sum / (CONTENT_SPOTS * CONTENT_SPOTS) as f32
            }
            Image::Texture(_) => 0.0,
            Image::Rendered(_) => given.map_or(0.0, |grey| grey / 255.0),
        };
        let grey = |place_mm| self.tone.grey(painter.light(content, place_mm) * uneven);
        if painter.is_plain() {
            return grey(self.plate_at(x, y));
        }
        spots(SPOTS).map(grey).sum::<f32>() / (SPOTS * SPOTS) as f32
    }
}

impl Picture for SimulatedScan<'_> {
    fn size_px(&self) -> [u32; 2] {
        self.layout.size_px
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let (rect, reduction) = (self.clipped(rect), reduction.max(1));
        let [width, height] = [rect.width, rect.height].map(|side| side.div_ceil(reduction) as usize);
        let grey = vec![0.0; width * height];
        let mut window = GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey };
        if window.grey.is_empty() {
            return Ok(window);
        }
        if reduction <= EXACT_REDUCTION {
            self.averaged(rect, reduction, &mut window);
        } else {
            self.sampled(rect, reduction, &mut window);
        }
        Ok(window)
    }
}

/// As a scanner stores it in 8 bits.
pub(super) fn rounded(grey: f32) -> f32 {
    // the conversion cuts off at both ends
    f32::from((grey + 0.5) as u8)
}

/// The parts of a rectangle in a raster of squares.
fn tiles(rect: PixelRect, side: u32) -> impl Iterator<Item = PixelRect> {
    let cuts = move |from: u32, length: u32| {
        (from / side..(from + length).div_ceil(side)).map(move |k| {
            let (low, high) = ((k * side).max(from), ((k + 1) * side).min(from + length));
            (low, high - low)
        })
    };
    cuts(rect.y, rect.height)
        .flat_map(move |(y, height)| cuts(rect.x, rect.width).map(move |(x, width)| PixelRect { x, y, width, height }))
}

/// What changes slowly, along a row of a block.
fn between(lands: &Lands, row: u32) -> [Land; LANDS] {
    let (above, share) = ((row / LAND_PX) as usize, (row % LAND_PX) as f32 / LAND_PX as f32);
    std::array::from_fn(|column| lands[above][column].towards(&lands[above + 1][column], share))
}

/// What changes slowly, at a pixel of a row of a block.
fn along(lands: &[Land; LANDS], column: u32) -> Land {
    let (left, share) = ((column / LAND_PX) as usize, (column % LAND_PX) as f32 / LAND_PX as f32);
    lands[left].towards(&lands[left + 1], share)
}

fn texture(seed: u64) -> Texture {
    let mut draws = Draws::new(seed, Purpose::FilmContent);
    Texture::new(draws.below(u32::MAX), &mut draws)
}

fn truth(settings: &ScanSettings, plate: &TruePlate, sheet: &Sheet, layout: &Layout) -> ScanTruth {
    let marks = plate.known.fiducials.iter().zip(&sheet.marks).map(|(fiducial, mark)| TrueMark {
        name: fiducial.name.clone(),
        position_px: layout.pixel(mark.place_mm),
        drawn_px: layout.pixel(mark.drawn_mm),
        state: mark.state,
    });
    ScanTruth {
        pixel_from_plate: layout.pixel_from_plate,
        marks: marks.collect(),
        asymmetric_px: plate.asymmetric_mm.map(|place_mm| layout.pixel(place_mm)),
        turns: settings.laying.turns % 4,
        mirrored: settings.laying.mirrored,
        negative: settings.negative,
        pixel_um: layout.pixel_um,
    }
}
