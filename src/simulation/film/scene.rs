//! A town photographed on film, and the film scanned.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use nalgebra::{Matrix3, Vector2};
use serde_json::{Value, json};

use super::camera::Make;
use super::scan::{Content, SimulatedScan};
use super::settings::{Laying, ScanSettings};
use super::tiff::{TiffSettings, write_tiff};
use crate::features::{GreyWindow, Picture, PixelRect};
use crate::geometry::{Camera, Film, PixelFromPlate, Smac};
use crate::interior::{self, FilmCamera, Mark, Side};
use crate::simulation::scene::{Scene, SceneSettings, SimulationError};

/// The scan's name in a scene's folder.
pub const SCAN_FILE: &str = "photograph.tif";

/// Pixels of the scan: about as many as a digital photograph of the simulator has.
const PIXEL_UM: f64 = 60.0;

/// A scene whose photograph is a scan of film. Its camera is that of the true interior orientation; the true exterior one
/// is of the plate's axes, whichever way the film lies in the scanner.
#[derive(Debug, Clone)]
pub struct FilmScene {
    /// The town, the flight and the control.
    pub scene: Scene,
    /// What the calibration report says.
    pub camera: FilmCamera,
    scan: ScanSettings,
}

impl FilmScene {
    /// The scene of a seed.
    ///
    /// # Errors
    /// [`SimulationError`] names the setting that makes no sense.
    pub fn draw(seed: u64, settings: &SceneSettings, scan: &ScanSettings) -> Result<Self, SimulationError> {
        let simulated = SimulatedScan::draw(seed, scan);
        let (plate, truth) = (simulated.plate().clone(), simulated.truth());
        let distortion = Smac { k: [1e-5, -4e-9, 2e-13, 0.0, 0.0], p: [2e-8, -3e-8, 0.0, 0.0] };
        let film =
            Film::new(153.284, Vector2::new(0.012, -0.008), Vector2::new(0.021, 0.004), distortion, plate.format_mm)?;
        let mut matrix = Matrix3::identity();
        matrix.fixed_rows_mut::<2>(0).copy_from(&truth.pixel_from_plate);
        let pixel_from_plate = PixelFromPlate::new(&matrix).ok_or(SimulationError::Scan)?;
        let camera = Camera::of_scan(simulated.size_px(), &film, &pixel_from_plate)?;
        let scene = Scene::photographed_with(camera, seed, settings)?;
        Ok(Self { scene, camera: FilmCamera { film, plate }, scan: scan.clone() })
    }

    /// What a scene on film is drawn from if nobody says otherwise: a film of good contrast with an asymmetric feature,
    /// coarsely scanned, of another make, lying in another way, and negative or not by seed.
    #[must_use]
    pub fn default_scan(seed: u64) -> ScanSettings {
        let [make, laying] = [seed, seed / 8].map(|n| (n % 8) as usize);
        let mut scan = ScanSettings::good(Make::ALL[make], Laying::all()[laying]);
        scan.negative = (seed / 64) % 2 == 1;
        scan.scanner.pixel_um = [PIXEL_UM; 2];
        scan
    }

    /// The scan, rendered only where it is looked at.
    #[must_use]
    pub fn picture(&self) -> SimulatedScan<'_> {
        let photograph = self.scene.picture();
        let content = move |rect: PixelRect, reduction: u32| {
            let nothing = GreyWindow { origin_px: [rect.x, rect.y], reduction, width: 0, height: 0, grey: Vec::new() };
            photograph.window(rect, reduction).unwrap_or(nothing)
        };
        SimulatedScan::draw(self.scene.seed, &self.scan).with_content(Content::Rendered(Box::new(content)))
    }

    /// The body of `POST /cameras`.
    #[must_use]
    pub fn camera_body(&self) -> Value {
        camera_body(&format!("simulated-film-{}", self.scene.seed), &self.camera)
    }

    /// The true orientations.
    #[must_use]
    pub fn truth(&self) -> Value {
        let mut truth = self.scene.truth();
        truth["scan"] = scan_body(&SimulatedScan::draw(self.scene.seed, &self.scan));
        truth
    }

    /// Scans the film and writes the scene into a folder that exists: `photograph.tif`, `camera.json`,
    /// `control_points.geojson`, `approximation.json` and `truth.json`.
    ///
    /// # Errors
    /// [`SimulationError::Write`] names the file that could not be written.
    pub fn write(&self, folder: &Path) -> Result<(), SimulationError> {
        self.scene.write_bodies(folder, &self.camera_body(), &self.truth())?;
        let path = folder.join(SCAN_FILE);
        let failed = |source| SimulationError::Write { path: path.clone(), source };
        let mut file = BufWriter::new(File::create(&path).map_err(failed)?);
        write_tiff(&self.picture(), &TiffSettings::default(), &mut file).map_err(failed)
    }
}

/// The body of `POST /cameras` for a film camera whose marks are all of the library.
fn camera_body(name: &str, camera: &FilmCamera) -> Value {
    let FilmCamera { film, plate } = camera;
    let fiducials: Vec<Value> = plate
        .fiducials
        .iter()
        .map(|fiducial| {
            json!({
                "name": fiducial.name,
                "position_mm": [fiducial.position_mm.x, fiducial.position_mm.y],
                "sigma_mm": fiducial.sigma_mm,
                "template": template(&fiducial.mark),
                "rotation_deg": fiducial.rotation_rad.to_degrees(),
            })
        })
        .collect();
    let [k0, k1, k2, k3, k4] = film.distortion.k;
    let [p1, p2, p3, p4] = film.distortion.p;
    let mut body = json!({
        "name": name,
        "principal_distance_mm": film.principal_distance_mm,
        "principal_point_mm": [film.principal_point_mm.x, film.principal_point_mm.y],
        "symmetry_point_mm": [film.symmetry_point_mm.x, film.symmetry_point_mm.y],
        "format_mm": film.format_mm,
        "distortion": {
            "model": "smac", "k0": k0, "k1": k1, "k2": k2, "k3": k3, "k4": k4, "p1": p1, "p2": p2, "p3": p3, "p4": p4
        },
        "fiducials": fiducials,
    });
    if let Some(feature) = &plate.asymmetric {
        body["asymmetric_feature"] = json!({
            "position_mm": [feature.position_mm.x, feature.position_mm.y],
            "sigma_mm": feature.sigma_mm,
            "template": template(&feature.mark),
            "rotation_deg": feature.rotation_rad.to_degrees(),
        });
    }
    if let Some(side) = plate.data_strip {
        body["data_strip"] = json!(match side {
            Side::Left => "left",
            Side::Right => "right",
            Side::Top => "top",
            Side::Bottom => "bottom",
        });
    }
    body
}

/// What is true of a scan.
fn scan_body(scan: &SimulatedScan) -> Value {
    let laid = scan.truth();
    let marks =
        laid.marks.iter().map(|mark| json!({ "name": mark.name, "px": [mark.position_px.x, mark.position_px.y] }));
    let lies = interior::Laying::nearest(&laid.pixel_from_plate.fixed_view::<2, 2>(0, 0).into_owned());
    let rows = [0, 1].map(|row| [0, 1, 2].map(|column| laid.pixel_from_plate[(row, column)]));
    json!({
        "pixel_from_plate": rows,
        "quarter_turns": lies.quarter_turns,
        "reading": if lies.mirrored { "wrong" } else { "right" },
        "polarity": if laid.negative { "negative" } else { "positive" },
        "marks": marks.collect::<Vec<_>>(),
    })
}

/// Writes a scan of no place into a folder that exists: `scan.tif`, `camera.json` and `truth.json`.
///
/// # Errors
/// [`SimulationError::Write`] names the file that could not be written.
pub fn write_scan(seed: u64, scan: &SimulatedScan, tiff: &TiffSettings, folder: &Path) -> Result<(), SimulationError> {
    let plate = scan.plate().clone();
    let film = Film::new(153.0, Vector2::zeros(), Vector2::zeros(), Smac::default(), plate.format_mm)?;
    let camera = camera_body(&format!("simulated-scan-{seed}"), &FilmCamera { film, plate });
    for (name, body) in [("camera.json", camera), ("truth.json", scan_body(scan))] {
        let path = folder.join(name);
        std::fs::write(&path, format!("{body:#}\n")).map_err(|source| SimulationError::Write { path, source })?;
    }
    let path = folder.join("scan.tif");
    let failed = |source| SimulationError::Write { path: path.clone(), source };
    let mut file = BufWriter::new(File::create(&path).map_err(failed)?);
    write_tiff(scan, tiff, &mut file).map_err(failed)
}

/// The marks of simulated cameras are all of the library.
fn template(mark: &Mark) -> &'static str {
    match mark {
        Mark::Library(library) => library.name(),
        Mark::Cut(_) => "",
    }
}
