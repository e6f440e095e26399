//! What is near a block of the scan, made ready to be painted place by place.

use nalgebra::Vector2;

use super::shape::{Blot, Brush};
use super::sheet::Sheet;
use crate::simulation::draws::value_noise;

/// The fog of all films is the same: nobody looks for it.
const FOG_SEED: u32 = 0xF06;

/// Where a block lies with respect to the opening of the frame.
#[derive(Debug)]
enum Exposure {
    Whole,
    None,
    Partly(Vec<Brush>),
}

/// The figures that reach into a block.
#[derive(Debug)]
pub(super) struct Painter {
    exposure: Exposure,
    dark: f32,
    figures: Vec<Brush>,
    cover: Vec<Brush>,
    /// What hides all of the film here.
    hidden: Option<f32>,
    negative: bool,
}

impl Painter {
    /// For places within a distance of the block's centre, seen with a blur.
    pub(super) fn new(sheet: &Sheet, negative: bool, centre_mm: Vector2<f64>, radius_mm: f64, sigma_mm: f64) -> Self {
        let near = |blot: &Blot| blot.is_near(centre_mm, radius_mm, sigma_mm);
        let fills = |blot: &Blot| blot.fills(centre_mm, radius_mm, sigma_mm);
        let brush = |blot: &Blot| Brush::new(blot, sigma_mm);
        let exposure = if sheet.openings.iter().any(fills) {
            Exposure::Whole
        } else {
            let openings: Vec<Brush> = sheet.openings.iter().filter(|blot| near(blot)).map(brush).collect();
            if openings.is_empty() { Exposure::None } else { Exposure::Partly(openings) }
        };
        let figures = sheet.figures.iter().filter(|blot| near(blot)).map(brush).collect();
        let mut hidden = None;
        let mut cover = Vec::new();
        for blot in sheet.cover.iter().filter(|blot| near(blot)) {
            if blot.opacity >= 1.0 && fills(blot) {
                hidden = Some(blot.tone);
                cover.clear();
            } else {
                cover.push(brush(blot));
            }
        }
        cover.extend(sheet.dust.near(centre_mm, radius_mm).iter().filter(|blot| near(blot)).map(brush));
        Self { exposure, dark: sheet.dark, figures, cover, hidden, negative }
    }

    /// Whether the image content is seen anywhere in the block.
    pub(super) fn shows_content(&self) -> bool {
        self.hidden.is_none() && !matches!(self.exposure, Exposure::None)
    }

    /// Whether there is nothing but image content, or nothing but one grey.
    pub(super) fn is_plain(&self) -> bool {
        self.cover.is_empty()
            && (self.hidden.is_some() || self.figures.is_empty() && !matches!(self.exposure, Exposure::Partly(_)))
    }

    /// Light, 0 to 1, at a place where the image content is so bright.
    pub(super) fn light(&self, content: f32, place_mm: Vector2<f64>) -> f32 {
        let film = match self.hidden {
            Some(tone) => tone,
            None => self.film(content, place_mm),
        };
        self.cover.iter().fold(film, |light, brush| brush.over(light, place_mm))
    }

    /// Film that saw no light is not quite even.
    fn unexposed(&self, place_mm: Vector2<f64>) -> f32 {
        self.dark + 0.01 * value_noise(place_mm.x * 0.25, place_mm.y * 0.25, FOG_SEED)
    }

    fn film(&self, content: f32, place_mm: Vector2<f64>) -> f32 {
        let exposed = match &self.exposure {
            Exposure::Whole => content,
            Exposure::None => self.unexposed(place_mm),
            Exposure::Partly(openings) => {
                let shut = openings.iter().fold(1.0, |shut, opening| shut * (1.0 - opening.coverage(place_mm)));
                content + shut * (self.unexposed(place_mm) - content)
            }
        };
        let light = self.figures.iter().fold(exposed, |light, brush| brush.over(light, place_mm));
        if self.negative { 1.0 - light } else { light }
    }
}
