//! Where an ortho-photo lies on the ground: world files, and the tags of a GeoTIFF.
//!
//! All give an affine map of pixels to the coordinates of a grid. Here it is always one of pixels counted from the
//! corner of the top-left pixel, whatever the source counts from.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix2x3, Vector2};

use super::{Format, ImageryError, Limits, probe, tiff};

/// The affine map of an ortho-photo's pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Georeference {
    /// Grid coordinates of pixels (x right, y down, 1).
    pub ground_from_pixel: Matrix2x3<f64>,
    /// The system as `EPSG:<code>`, where the file names it.
    pub crs: Option<String>,
}

/// Why a world file is not one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a world file has six numbers, one a line: {detail}")]
pub struct WorldFileError {
    detail: String,
}

impl Georeference {
    /// The map of a world file, whose six numbers are the steps in x and y to the right, those downwards, and the
    /// *centre* of the top-left pixel.
    ///
    /// # Errors
    /// [`WorldFileError`] unless the text is six finite numbers.
    pub fn from_world_file(text: &str) -> Result<Self, WorldFileError> {
        let number = |word: &str| word.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| word.to_owned());
        let numbers = text.split_whitespace().map(number).collect::<Result<Vec<_>, _>>();
        let numbers = numbers.map_err(|word| WorldFileError { detail: format!("{word:?} is none") })?;
        let &[x_right, y_right, x_down, y_down, x, y] = numbers.as_slice() else {
            return Err(WorldFileError { detail: format!("there are {}", numbers.len()) });
        };
        Ok(Self::from_centre([x_right, y_right], [x_down, y_down], [x, y]))
    }

    /// From the steps to the right and downwards, and the centre of the top-left pixel.
    fn from_centre(right: [f64; 2], down: [f64; 2], centre: [f64; 2]) -> Self {
        let (right, down) = (Vector2::from(right), Vector2::from(down));
        let corner = Vector2::from(centre) - (right + down) / 2.0;
        Self { ground_from_pixel: Matrix2x3::from_columns(&[right, down, corner]), crs: None }
    }

    /// What the tags of a GeoTIFF say; `None` if the file is another one or has no such tags.
    ///
    /// # Errors
    /// [`ImageryError`] if the file cannot be read.
    pub fn of_geotiff(path: &Path, limits: &Limits) -> Result<Option<Self>, ImageryError> {
        let mut file = probe::open(path)?;
        if probe::format(&mut file)? != Format::Tiff {
            return Ok(None);
        }
        let tags = tiff::geo_tags(file, limits)?;
        Ok(tags.georeference())
    }
}

/// The tags of a GeoTIFF (OGC 19-008r4), as they stand in the file; empty where there are none.
#[derive(Debug, Default)]
pub(super) struct GeoTags {
    pub(super) pixel_scale: Vec<f64>,
    pub(super) tie_points: Vec<f64>,
    pub(super) transformation: Vec<f64>,
    pub(super) keys: Vec<u16>,
}

const RASTER_TYPE: u16 = 1025;
const PIXEL_IS_POINT: u16 = 2;
const PROJECTED_SYSTEM: u16 = 3072;
const GEODETIC_SYSTEM: u16 = 2048;
/// Stands for a system that is described by other keys.
const USER_DEFINED: u16 = 32767;

impl GeoTags {
    fn georeference(&self) -> Option<Georeference> {
        let (right, down, corner) = match (self.transformation.as_slice(), self.pixel_scale.as_slice()) {
            (&[a, b, _, x, d, e, _, y, ..], _) => ([a, d], [b, e], Vector2::new(x, y)),
            (_, &[across, along, ..]) => {
                let &[column, row, _, x, y, ..] = self.tie_points.as_slice() else { return None };
                ([across, 0.0], [0.0, -along], Vector2::new(x - column * across, y + row * along))
            }
            _ => return None,
        };
        let finite = right.iter().chain(&down).chain(corner.iter()).all(|v| v.is_finite());
        let mut georeference = if self.key(RASTER_TYPE) == Some(PIXEL_IS_POINT) {
            Georeference::from_centre(right, down, corner.into())
        } else {
            let ground_from_pixel = Matrix2x3::from_columns(&[right.into(), down.into(), corner]);
            Georeference { ground_from_pixel, crs: None }
        };
        let system = self.key(PROJECTED_SYSTEM).or_else(|| self.key(GEODETIC_SYSTEM));
        georeference.crs = system.filter(|code| *code != USER_DEFINED).map(|code| format!("EPSG:{code}"));
        finite.then_some(georeference)
    }

    /// A key whose value stands in the directory itself.
    fn key(&self, wanted: u16) -> Option<u16> {
        let entries = self.keys.as_chunks::<4>().0.iter().skip(1);
        entries.copied().find_map(|[key, place, _, value]| (key == wanted && place == 0).then_some(value))
    }
}

/// The world file beside a picture: `.tfw` beside `.tif`, likewise for the others, or `.wld`.
#[must_use]
pub fn world_file_beside(picture: &Path) -> Option<PathBuf> {
    let extension = picture.extension()?.to_str()?;
    let (first, last) = (extension.chars().next()?, extension.chars().last()?);
    let names = [format!("{first}{last}w"), format!("{extension}w"), "wld".to_owned()];
    let in_both_cases = names.into_iter().flat_map(|name| [name.to_lowercase(), name.to_uppercase(), name]);
    in_both_cases.map(|name| picture.with_extension(name)).find(|file| file.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::tiff::encoder::{TiffEncoder, colortype::Gray8};
    use ::tiff::tags::Tag;

    #[test]
    fn a_world_file_is_about_centres_of_pixels() {
        let georeference = Georeference::from_world_file("0.2\n0\n0\r\n-0.2\n565000.1\n 5934499.9\n").unwrap();
        let corner = georeference.ground_from_pixel * Vector2::new(0.0, 0.0).push(1.0);
        assert!((corner - Vector2::new(565_000.0, 5_934_500.0)).norm() < 1e-9);
        let turned = Georeference::from_world_file("0 -0.5 -0.5 0 10 20").unwrap().ground_from_pixel;
        assert!((turned * Vector2::new(2.5, 0.5).push(1.0) - Vector2::new(10.0, 19.0)).norm() < 1e-12);
        for (text, named) in [("1 2 3", "there are 3"), ("1 2 3 4 5 six", "six"), ("1 2 3 4 5 inf", "inf")] {
            let error = Georeference::from_world_file(text).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn a_world_file_is_found_by_the_name_of_its_picture() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a.tfw", "b.JGW", "c.pngw", "d.wld"] {
            std::fs::write(at(name), "").unwrap();
        }
        for (picture, world) in [("a.tif", "a.tfw"), ("b.jpg", "b.JGW"), ("c.png", "c.pngw"), ("d.tiff", "d.wld")] {
            assert_eq!(world_file_beside(&at(picture)), Some(at(world)));
        }
        assert_eq!(world_file_beside(&at("e.tif")), None);
    }

    fn geotiff(tags: &[(Tag, &[f64])], keys: &[u16]) -> Option<Georeference> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ortho.tif");
        let mut encoder = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
        let mut image = encoder.new_image::<Gray8>(4, 3).unwrap();
        for (tag, values) in tags {
            image.encoder().write_tag(*tag, *values).unwrap();
        }
        if !keys.is_empty() {
            image.encoder().write_tag(Tag::GeoKeyDirectoryTag, keys).unwrap();
        }
        image.write_data(&[7; 12]).unwrap();
        Georeference::of_geotiff(&path, &Limits::default()).unwrap()
    }

    #[test]
    fn tags_of_a_geotiff_are_understood() {
        let scale: (Tag, &[f64]) = (Tag::ModelPixelScaleTag, &[0.1, 0.2, 0.0]);
        let tie: (Tag, &[f64]) = (Tag::ModelTiepointTag, &[1.0, 2.0, 0.0, 500.0, 700.0, 0.0]);
        let area = geotiff(&[scale, tie], &[1, 1, 0, 2, 1025, 0, 1, 1, 3072, 0, 1, 25832]).unwrap();
        assert_eq!(area.crs.as_deref(), Some("EPSG:25832"));
        let at = |g: &Georeference, x: f64, y: f64| g.ground_from_pixel * Vector2::new(x, y).push(1.0);
        assert!((at(&area, 1.0, 2.0) - Vector2::new(500.0, 700.0)).norm() < 1e-9);
        assert!((at(&area, 2.0, 4.0) - Vector2::new(500.1, 699.6)).norm() < 1e-9);
        let point = geotiff(&[scale, tie], &[1, 1, 0, 2, 1025, 0, 1, 2, 2048, 0, 1, 4258]).unwrap();
        assert!((at(&point, 1.5, 2.5) - Vector2::new(500.0, 700.0)).norm() < 1e-9);
        assert_eq!(point.crs.as_deref(), Some("EPSG:4258"));
        let matrix = [0.0, 0.5, 0.0, 30.0, 0.5, 0.0, 0.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let turned = geotiff(&[(Tag::ModelTransformationTag, &matrix)], &[]).unwrap();
        assert!((at(&turned, 2.0, 4.0) - Vector2::new(32.0, 41.0)).norm() < 1e-9);
        assert_eq!((turned.crs, geotiff(&[scale], &[]), geotiff(&[], &[])), (None, None, None));
    }
}
