//! The picture of an orientation: the image in grey with the projected control edges, the line segments matched to
//! them, and how far each reference point was from where it had been predicted.
//!
//! Rows and columns are those of the file, an EXIF orientation tag is not obeyed: so are all pixel coordinates.

pub(super) mod canvas;
mod lettering;

use image::{ImageEncoder as _, RgbImage};
use nalgebra::Vector2;

use super::drawing::{Drawing, DrawnPoint};
use crate::features::{Picture, PictureError, PixelRect};
use canvas::{Canvas, Colour};

// Okabe and Ito's palette, which the colour-blind tell apart as well
const USED: Colour = Colour([86, 180, 233]);
const REJECTED: Colour = Colour([213, 94, 0]);
const UNUSED: Colour = Colour([204, 121, 167]);
const MATCHED: Colour = Colour([240, 228, 66]);
const LETTERS: Colour = Colour([255, 255, 255]);

impl DrawnPoint {
    fn colour(&self) -> Colour {
        match self.state() {
            "matched" => USED,
            "rejected" => REJECTED,
            _ => UNUSED,
        }
    }
}

/// The file formats of an overlay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Lossless, large.
    Png,
    /// Small.
    Jpeg,
}

/// The overlay, at most `widest_px` columns wide, as a file.
///
/// # Errors
/// [`PictureError`] if the image cannot be read.
pub fn overlay(
    picture: &dyn Picture,
    drawing: &Drawing,
    widest_px: u32,
    format: Format,
) -> Result<Vec<u8>, PictureError> {
    encode(&draw(picture, drawing, widest_px)?, format)
}

fn draw(picture: &dyn Picture, drawing: &Drawing, widest_px: u32) -> Result<RgbImage, PictureError> {
    let [width, height] = picture.size_px();
    let reduction = width.div_ceil(widest_px.max(1)).max(1);
    let window = picture.window(PixelRect { x: 0, y: 0, width, height }, reduction)?;
    let mut canvas = Canvas::from_grey(&window);
    let at = |[x, y]: [f64; 2]| Vector2::new(x, y) / f64::from(reduction);
    for edge in &drawing.edges {
        let colour = drawing.points.get(edge.point).map_or(UNUSED, DrawnPoint::colour);
        canvas.line(at(edge.projected_px[0]), at(edge.projected_px[1]), 2.0, colour);
    }
    for [start, end] in drawing.edges.iter().flat_map(|edge| &edge.matched_px) {
        canvas.line(at(*start), at(*end), 1.0, MATCHED);
    }
    for (index, point) in drawing.points.iter().enumerate() {
        if let (Some(predicted), Some(located)) = (point.predicted_px, point.located_px) {
            canvas.arrow(at(predicted), at(located), point.colour());
        }
        if let Some(place) = drawing.place_of_name(index) {
            canvas.letters(at(place) + Vector2::new(6.0, 6.0), &point.name, LETTERS);
        }
    }
    Ok(canvas.into_image())
}

pub(super) fn encode(image: &RgbImage, format: Format) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Vec::new();
    let (width, height) = image.dimensions();
    let colour = image::ExtendedColorType::Rgb8;
    match format {
        Format::Png => image::codecs::png::PngEncoder::new(&mut bytes).write_image(image, width, height, colour),
        Format::Jpeg => {
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 85).write_image(image, width, height, colour)
        }
    }
    .map_err(|e| PictureError { detail: format!("the drawing cannot be written: {e}") })?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::GreyWindow;
    use crate::report::drawing::DrawnEdge;

    struct Grey;

    impl Picture for Grey {
        fn size_px(&self) -> [u32; 2] {
            [200, 100]
        }

        fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
            let (width, height) = (rect.width.div_ceil(reduction) as usize, rect.height.div_ceil(reduction) as usize);
            Ok(GreyWindow { origin_px: [0, 0], reduction, width, height, grey: vec![100.0; width * height] })
        }
    }

    fn drawing(used: bool, located_px: Option<[f64; 2]>) -> Drawing {
        Drawing {
            points: vec![DrawnPoint {
                name: "W1".into(),
                predicted_px: Some([20.0, 80.0]),
                located_px,
                used,
                ..DrawnPoint::default()
            }],
            edges: vec![DrawnEdge {
                point: 0,
                projected_px: [[100.0, 10.0], [180.0, 10.0]],
                matched_px: vec![[[100.0, 30.0], [180.0, 30.0]]],
            }],
            ..Drawing::default()
        }
    }

    #[test]
    fn edges_have_the_colour_of_what_became_of_their_control_point() {
        for (used, located, colour) in
            [(true, Some([25.0, 80.0]), USED), (false, Some([25.0, 80.0]), REJECTED), (false, None, UNUSED)]
        {
            let image = draw(&Grey, &drawing(used, located), 200).unwrap();
            assert_eq!(image.get_pixel(140, 10).0, colour.0);
            assert_eq!(image.get_pixel(140, 50).0, [100; 3]);
        }
    }

    #[test]
    fn a_name_stands_at_its_control_point() {
        assert_eq!(drawing(true, Some([25.0, 80.0])).place_of_name(0), Some([25.0, 80.0]));
        assert_eq!(drawing(false, None).place_of_name(0), Some([140.0, 10.0]));
        let without_edges = Drawing { edges: Vec::new(), ..drawing(false, None) };
        assert_eq!(without_edges.place_of_name(0), Some([20.0, 80.0]));
    }

    #[test]
    fn a_narrower_overlay_is_drawn_at_the_same_places() {
        let image = draw(&Grey, &drawing(true, None), 100).unwrap();
        assert_eq!(image.dimensions(), (100, 50));
        assert_eq!(image.get_pixel(70, 5).0, USED.0);
        assert_ne!(image.get_pixel(70, 15).0, [100; 3]);
    }

    #[test]
    fn lines_that_lead_nowhere_do_no_harm() {
        let mut wild = drawing(true, Some([f64::NAN, 1e300]));
        wild.edges[0].projected_px = [[-1e12, 1e12], [f64::INFINITY, 3.0]];
        wild.edges[0].matched_px = vec![[[-1e9, 50.0], [1e9, 50.0]]];
        let image = draw(&Grey, &wild, 200).unwrap();
        assert_ne!(image.get_pixel(100, 50).0, [100; 3]);
    }

    #[test]
    fn both_formats_decode_to_the_same_size() {
        for format in [Format::Png, Format::Jpeg] {
            let bytes = overlay(&Grey, &drawing(true, None), 200, format).unwrap();
            let read = image::load_from_memory(&bytes).unwrap();
            assert_eq!((read.width(), read.height()), (200, 100));
        }
    }
}
