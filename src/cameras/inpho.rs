//! Inpho (Match-AT, ApplicationsMaster): the cameras of a project, `.prj`, as `$CAMERA_DEFINITION` or, in older ones, as
//! `$CAMERA`.
//!
//! `$CCD_INTERIOR_ORIENTATION` is an affine transformation of millimetres, x to the right, y up, to pixels that count from
//! the centre of the top-left one (`CenterTopLeft`). The principal points PPA, of autocollimation, and PPS, of symmetry, are
//! in those millimetres. `$RADIAL_COEFFS` lists K0, K1, K2, …, `$DECENTRE_COEFFS` P1, P2 and, as in the reports of the
//! U.S. Geological Survey, P3 and P4.
//!
//! What the sign of the coefficients means no description says that was at hand. They are taken as distortion, which is
//! subtracted from what was measured, with x, y from PPS: x - x (K0 + K1 r² + K2 r⁴ + …) - P1 (r² + 2 x²) - 2 P2 x y;
//! `exports` writes the same. For that speaks a public project of a Phase One iXU-RS1000 (c = 51.68 mm, K1 -1.46e-5, K2
//! 4.1e-9): added, they would make a pincushion of 79 px in the corners, and the calibration of much the same lens for OSSIM
//! (c = 51.59 mm, K1 -1.40e-5, K2 3.8e-9), which subtracts it, makes the barrel that is usual. A warning says so, and by how
//! many pixels which way, which is how to see whether it is true of a lens.

use nalgebra::{Matrix2, Vector2};

use super::conversion::{Axis, Lens, convert};
use super::text::{number, numbers, pixels};
use super::{CameraFileError, Converted, Given, USGS, field};
use crate::geometry::Brown;

/// Whether a text is such a project.
pub(super) fn is_one(text: &str) -> bool {
    text.lines().filter_map(Line::of).any(|line| line.opens_camera())
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let project = Project::read(given.text);
    let named = project.cameras.into_iter().map(|section| (section.name(), section)).collect();
    let (name, section) = given.choose(named)?;
    section.refuse_others()?;
    let mut warnings = Vec::new();
    match section.value(&["PIXEL_REFERENCE"])?.or(project.pixel_reference) {
        Some(reference) if plain(reference) == "centertopleft" => {}
        Some(other) => return Err(field("$PIXEL_REFERENCE", format!("of the references CenterTopLeft is read, not {other}"))),
        None => warnings.push(
            "there is no $PIXEL_REFERENCE: pixels are taken to count from the centre of the top-left one (CenterTopLeft)"
                .to_owned(),
        ),
    }
    let size_px = given.size_px(section.size_px()?)?;
    let plate = section.plate()?;
    plate.check_pixel_size(given)?;
    if plate.turn_deg().abs() > LEAST_TURN_DEG {
        warnings.push(format!(
            "$CCD_INTERIOR_ORIENTATION turns the plate by {:.2}° in the image; the camera that is made from it is not turned, \
             so that its kappa is another one than in the project",
            plate.turn_deg()
        ));
    }
    let distortion = section.distortion()?;
    let lens = match &distortion {
        None => Lens::Brown(Brown::default()),
        Some(distortion) => {
            warnings.push(plate.warning(distortion, size_px));
            let distortion = distortion.clone();
            Lens::Corrected(Box::new(move |pixel| plate.ideal(&distortion, pixel)))
        }
    };
    let conversion = convert(size_px, &plate.axis(), &lens)?;
    Ok(Converted { name: Some(name).filter(|name| !name.is_empty()), conversion, warnings })
}

/// Less is the adjustment of the sensor, and no matter of kappa.
const LEAST_TURN_DEG: f64 = 0.01;

/// What is read of a project.
#[derive(Default)]
struct Project<'a> {
    cameras: Vec<Section<'a>>,
    /// Where the cameras do not tell.
    pixel_reference: Option<&'a str>,
}

/// A camera: keys with what stands behind each, also in the lines below.
#[derive(Default)]
struct Section<'a> {
    values: Values<'a>,
    /// Newer projects have several calibrations of a camera.
    sets: Vec<Values<'a>>,
}

type Values<'a> = Vec<(&'a str, Vec<&'a str>)>;

/// A line that begins with a key.
struct Line<'a> {
    indent: usize,
    key: &'a str,
    rest: &'a str,
}

impl<'a> Line<'a> {
    fn of(line: &'a str) -> Option<Self> {
        let text = line.trim_start().strip_prefix('$')?;
        let end = text.find(|c: char| c == ':' || c.is_whitespace()).unwrap_or(text.len());
        let (key, rest) = text.split_at(end);
        let rest = rest.trim_start();
        let indent = line.len() - line.trim_start().len();
        Some(Self { indent, key, rest: rest.strip_prefix(':').unwrap_or(rest).trim() })
    }

    fn opens_camera(&self) -> bool {
        matches!(self.key, "CAMERA" | "CAMERA_DEFINITION") && self.rest.is_empty()
    }
}

impl<'a> Project<'a> {
    fn read(text: &'a str) -> Self {
        let mut project = Self::default();
        // how far the open camera is indented, and the calibration that is open in it: within, there are ends of others
        let (mut open, mut open_set): (Option<usize>, Option<usize>) = (None, None);
        for text in text.lines() {
            let Some(line) = Line::of(text) else {
                if let (Some(_), Some(camera)) = (open, project.cameras.last_mut()) {
                    camera.add(open_set.is_some(), text.trim());
                }
                continue;
            };
            if line.opens_camera() {
                project.cameras.push(Section::default());
                (open, open_set) = (Some(line.indent), None);
                continue;
            }
            let (Some(indent), Some(camera)) = (open, project.cameras.last_mut()) else {
                if line.key == "PIXEL_REFERENCE" {
                    project.pixel_reference = Some(line.rest);
                }
                continue;
            };
            match line.key {
                "END" if line.indent <= indent => open = None,
                "END" if open_set.is_some_and(|set| line.indent <= set) => open_set = None,
                "CALIBRATION_SET" => {
                    camera.sets.push(Values::new());
                    open_set = Some(line.indent);
                }
                key if key.starts_with("END_CAMERA") => open = None,
                key if key.starts_with("END_CALIBRATION") => open_set = None,
                key if key.starts_with("END") => {}
                key => camera.at(open_set.is_some()).push((key, vec![line.rest])),
            }
        }
        project
    }
}

impl<'a> Section<'a> {
    fn at(&mut self, in_set: bool) -> &mut Values<'a> {
        match self.sets.last_mut() {
            Some(set) if in_set => set,
            _ => &mut self.values,
        }
    }

    fn add(&mut self, in_set: bool, text: &'a str) {
        if let Some((_, lines)) = self.at(in_set).last_mut() {
            lines.push(text);
        }
    }

    fn name(&self) -> String {
        let told = ["ID", "NAME", "TYPE"].iter().find_map(|key| first(&self.values, key));
        told.unwrap_or_default().to_owned()
    }

    /// The calibration that counts.
    fn active(&self) -> Result<Option<&Values<'a>>, CameraFileError> {
        let Some(active) = first(&self.values, "ACTIVE_CALIBRATION") else {
            return match self.sets.as_slice() {
                [] => Ok(None),
                [one] => Ok(Some(one)),
                several => {
                    Err(field("$ACTIVE_CALIBRATION", format!("it is missing, of {} calibrations", several.len())))
                }
            };
        };
        match self.sets.iter().find(|set| first(set, "ID") == Some(active)) {
            None if self.sets.is_empty() => Ok(None),
            None => Err(field("$ACTIVE_CALIBRATION", format!("there is no calibration {active}"))),
            found => Ok(found),
        }
    }

    /// The first line behind the first of these keys that there is.
    fn value(&self, keys: &[&str]) -> Result<Option<&'a str>, CameraFileError> {
        let active = self.active()?;
        Ok(keys
            .iter()
            .find_map(|key| active.and_then(|values| first(values, key)).or_else(|| first(&self.values, key))))
    }

    /// The numbers behind a key, in its line and those below.
    fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>, CameraFileError> {
        let here =
            |values: &Values<'a>| values.iter().find(|(known, _)| *known == key).map(|(_, lines)| lines.join(" "));
        let text = self.active()?.and_then(here).or_else(|| here(&self.values));
        let name = format!("${key}");
        text.map(|text| numbers(&name, &text)).transpose()
    }

    /// Refuses film, and sensors that are no frame.
    fn refuse_others(&self) -> Result<(), CameraFileError> {
        let fiducials = self.values.iter().chain(self.sets.iter().flatten()).any(|(key, _)| key.contains("FIDUCIAL"));
        let kind = ["KIND", "TYPE"].iter().find_map(|key| first(&self.values, key)).unwrap_or_default();
        let is_film = |kind: &str| ["film", "analog", "scanned"].iter().any(|word| kind.contains(word));
        let refused = |detail: String| Err(CameraFileError::Model { model: kind.to_owned(), detail });
        if fiducials || is_film(&plain(kind)) {
            return refused(format!(
                "it is a film camera, with fiducial marks; the text of its calibration report is read as format {USGS}"
            ));
        }
        // $TYPE is free text where there is a $KIND
        match first(&self.values, "KIND").map(plain) {
            Some(kind) if !kind.contains("frame") => refused("of Inpho's kinds of cameras CCDFrame is read".into()),
            _ => Ok(()),
        }
    }

    fn size_px(&self) -> Result<Option<[u32; 2]>, CameraFileError> {
        let side = |key: &str| {
            let text = self.value(&[key])?;
            text.map(|text| number(&format!("${key}"), text).and_then(|value| pixels(key, value))).transpose()
        };
        if let Some((columns, rows)) = side("CCD_COLUMNS")?.zip(side("CCD_ROWS")?) {
            return Ok(Some([columns, rows]));
        }
        match self.numbers("CCD_COLUMNS_ROWS")?.as_deref() {
            None => Ok(None),
            Some(&[columns, rows]) => {
                Ok(Some([pixels("$CCD_COLUMNS_ROWS", columns)?, pixels("$CCD_COLUMNS_ROWS", rows)?]))
            }
            Some(others) => Err(field("$CCD_COLUMNS_ROWS", format!("it has {} numbers, not 2", others.len()))),
        }
    }

    fn plate(&self) -> Result<Plate, CameraFileError> {
        const ORIENTATION: &str = "$CCD_INTERIOR_ORIENTATION";
        let affine = self.numbers(&ORIENTATION[1..])?;
        let affine = affine.ok_or_else(|| field(ORIENTATION, "it is missing; only film cameras do without"))?;
        let &[xx, xy, x0, yx, yy, y0] = affine.as_slice() else {
            return Err(field(ORIENTATION, format!("it has {} numbers, not 2 rows of 3", affine.len())));
        };
        let px_from_mm = Matrix2::new(xx, xy, yx, yy);
        let Some(mm_from_px) = px_from_mm.try_inverse().filter(|_| px_from_mm.determinant() < 0.0) else {
            let detail = "it mirrors the image or has no area; x of the plate is to the right, y up, rows run down";
            return Err(field(ORIENTATION, detail));
        };
        let distance = self.value(&["PRINCIPAL_DISTANCE", "FOCAL_LENGTH"])?;
        let distance =
            distance.ok_or_else(|| field("$PRINCIPAL_DISTANCE", "it is missing, and so is $FOCAL_LENGTH"))?;
        let principal_distance_mm = number("$PRINCIPAL_DISTANCE", distance)?;
        if principal_distance_mm <= 0.0 {
            return Err(field("$PRINCIPAL_DISTANCE", format!("{principal_distance_mm} is not positive")));
        }
        let point = |key: &str| match self.numbers(key)?.as_deref() {
            None => Ok(None),
            Some(&[x, y]) => Ok(Some(Vector2::new(x, y))),
            Some(others) => Err(field(format!("${key}"), format!("it has {} numbers, not 2", others.len()))),
        };
        let ppa_mm = point("PRINCIPAL_POINT_PPA")?.unwrap_or_default();
        let pps_mm = point("PRINCIPAL_POINT_PPS")?.unwrap_or(ppa_mm);
        let upright = upright(&px_from_mm);
        // to pixels from the corner of the first one
        let origin_px = Vector2::new(x0, y0) + Vector2::repeat(0.5);
        Ok(Plate { px_from_mm, mm_from_px, origin_px, principal_distance_mm, ppa_mm, pps_mm, upright })
    }

    /// `None` if there is no distortion.
    fn distortion(&self) -> Result<Option<Distortion>, CameraFileError> {
        let radial = self.numbers("RADIAL_COEFFS")?;
        let decentring = self.numbers("DECENTRE_COEFFS")?;
        match self.value(&["DISTORTION_TYPE"])?.map(plain).as_deref() {
            Some("none" | "no" | "nodistortion") => return Ok(None),
            Some("polynomial") if radial.is_none() => return Err(field("$RADIAL_COEFFS", "it is missing")),
            None | Some("polynomial" | "") => {}
            Some(other) => {
                let detail = "of Inpho's distortions Polynomial is read".to_owned();
                return Err(CameraFileError::Model { model: other.to_owned(), detail });
            }
        }
        let mut p = [0.0; 4];
        for (at, value) in decentring.unwrap_or_default().into_iter().enumerate() {
            *p.get_mut(at).ok_or_else(|| field("$DECENTRE_COEFFS", "it has more than 4 numbers"))? = value;
        }
        let k = radial.unwrap_or_default();
        let any = k.iter().chain(&p).any(|value| *value != 0.0);
        Ok(any.then_some(Distortion { k, p }))
    }
}

fn first<'a>(values: &Values<'a>, key: &str) -> Option<&'a str> {
    let (_, lines) = values.iter().find(|(known, _)| *known == key)?;
    lines.iter().copied().find(|line| !line.is_empty())
}

/// A word in small letters alone.
fn plain(text: &str) -> String {
    text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The polynomial of a lens, in millimetres.
#[derive(Clone)]
struct Distortion {
    /// K0, K1, ….
    k: Vec<f64>,
    p: [f64; 4],
}

impl Distortion {
    /// What is subtracted from a place that was measured, from the point of symmetry.
    fn at(&self, measured: Vector2<f64>) -> Vector2<f64> {
        let (x, y, r2) = (measured.x, measured.y, measured.norm_squared());
        let [p1, p2, p3, p4] = self.p;
        let radial = self.k.iter().rev().fold(0.0, |sum, k| sum * r2 + k);
        let decentring =
            Vector2::new(p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y, p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y);
        measured * radial + decentring * (1.0 + r2 * (p3 + r2 * p4))
    }
}

/// How the plate, in millimetres, lies in the image.
#[derive(Clone, Copy)]
struct Plate {
    px_from_mm: Matrix2<f64>,
    mm_from_px: Matrix2<f64>,
    /// Where the plate has 0, 0.
    origin_px: Vector2<f64>,
    principal_distance_mm: f64,
    ppa_mm: Vector2<f64>,
    pps_mm: Vector2<f64>,
    /// From axes that lie along the image, x to the right and y up, to those of the plate.
    upright: Matrix2<f64>,
}

/// The rotation after which a plate is no longer turned in the image: y then runs along the columns.
fn upright(px_from_mm: &Matrix2<f64>) -> Matrix2<f64> {
    let up = -px_from_mm.row(1).transpose().normalize();
    Matrix2::from_columns(&[Vector2::new(up.y, -up.x), up])
}

impl Plate {
    fn axis(&self) -> Axis {
        let c = self.principal_distance_mm;
        let turned = self.px_from_mm * self.upright;
        Axis {
            principal_distance_px: -c * turned.m22,
            principal_point_px: self.origin_px + self.px_from_mm * self.ppa_mm,
            b1_px: c * (turned.m11 + turned.m22),
            b2_px: -c * turned.m12,
        }
    }

    /// How far the plate is turned clockwise.
    fn turn_deg(&self) -> f64 {
        self.upright.m21.atan2(self.upright.m11).to_degrees()
    }

    fn ideal(&self, distortion: &Distortion, pixel: Vector2<f64>) -> Vector2<f64> {
        let measured_mm = self.mm_from_px * (pixel - self.origin_px);
        let corrected_mm = measured_mm - distortion.at(measured_mm - self.pps_mm);
        let upright = self.upright.transpose() * (corrected_mm - self.ppa_mm);
        Vector2::new(upright.x, -upright.y) / self.principal_distance_mm
    }

    fn check_pixel_size(&self, given: &Given<'_>) -> Result<(), CameraFileError> {
        let size_mm = 1.0 / self.px_from_mm.determinant().abs().sqrt();
        match given.pixel_size_mm {
            Some(given) if (size_mm / given - 1.0).abs() > 1e-3 => Err(CameraFileError::Contradiction {
                parameter: "pixel_size_mm",
                detail: format!("the sensor has pixels of {size_mm:.6} mm"),
            }),
            _ => Ok(()),
        }
    }

    /// What the sign was taken for, and how to see whether that is right.
    fn warning(&self, distortion: &Distortion, [width, height]: [u32; 2]) -> String {
        let [width, height] = [width, height].map(f64::from);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].map(Vector2::from);
        let from_symmetry = corners.map(|pixel| self.mm_from_px * (pixel - self.origin_px) - self.pps_mm);
        let farthest = from_symmetry.into_iter().fold(Vector2::zeros(), |a, b| if b.norm() > a.norm() { b } else { a });
        let outwards_mm = -distortion.at(farthest).dot(&farthest) / farthest.norm();
        let outwards_px = outwards_mm * self.px_from_mm.determinant().abs().sqrt();
        let (seen, lens) = if outwards_px > 0.0 { ("nearer to", "barrel") } else { ("farther from", "pincushion") };
        format!(
            "$RADIAL_COEFFS and $DECENTRE_COEFFS are taken as distortion, which is subtracted from measured coordinates; Inpho does not say \
             whether they are to be added. As they are taken, the farthest corner is seen {:.1} px {seen} the middle \
             than without distortion ({lens}): look whether straight edges at the rim of a photograph bend so, or \
             hold it against the calibration report; if it is the other way, change the sign of all of them in the file",
            outwards_px.abs()
        )
    }
}
