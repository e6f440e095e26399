//! `gable scene rectify`.

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::features::{Picture as _, PixelRect};
use crate::geometry::{Crs, Ellipsoid, Fisheye};
use crate::imagery::{ImageFile, Limits};
use crate::scenes::declination::declination;
use crate::scenes::rectify::{Layout, Rectified, rectify};
use crate::scenes::resect::{NadirResection, Target, resect};
use anyhow::{Context as _, bail};
use chrono::{Datelike as _, NaiveDate};
use clap::{Args, ValueEnum};
use nalgebra::Vector2;

use super::files::{self, Reference, not_negative, pair, positive, scene_name, sending, triple};
use crate::cli::print;

const EXAMPLES: &str = "\
How it is done in the field (Berveglieri and Tommaselli):
  1. Measure a point that can be told on the ground by GNSS; its ellipsoidal height too.
  2. Raise a calibrated fish-eye camera about 4 m above it, looking straight down.
  3. Lay a levelled right-angle template with targets on the ground, its corner on the point and its y arm along the \
     compass needle. Take the first picture.
  4. Take the template away without touching the camera. Take the second picture: that is PICTURE.
  5. Measure the targets' pixels in the first picture, and write them to the file for --target.
Targets that spread wide about the point below the camera are worth more than many: the tilt is known from them alone.

Files:
  fisheye.json  {\"image_size_px\": [4256, 2848], \"projection\": \"equidistant\", \"principal_distance_px\": 1480,
                 \"principal_point_px\": [2117, 1431], \"distortion\": {\"k1\": -0.024, \"k2\": 0.0018}}
      The projection is equidistant (r = c theta), equisolid (r = 2 c sin(theta/2)) or brown (r = c tan(theta)). The
      distortion is applied to the projected coordinates divided by c.
  target.json   {\"points\": [{\"name\": \"corner\", \"xy_m\": [0, 0], \"px\": [2210.4, 1511.9]}, ...]}
      x along one arm, y along the other, 90° counter-clockwise from x as seen from above; xyz_m for a point that is not
      in the plane. Pixels are counted from the corner of the top-left pixel, y down.

Examples:
  gable scene rectify pole.jpg --camera fisheye.json --target target.json --crs EPSG:25832 \\
        --reference 565012.31,5934410.72,45.1 --magnetic --date 2026-05-01 --name church-square --out scenes
      The y arm pointed to magnetic north: the declination of the day is applied.

  gable scene rectify pole.jpg --camera fisheye.json --target target.json --crs EPSG:4979 \\
        --reference 9.98137,53.55455,45.1 --bearing-deg 37.5 --sigma-bearing-deg 0.3 --arm x --name gate
      The true bearing of the x arm was measured otherwise.";

/// Which arm of the template the bearing is of.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Arm {
    X,
    Y,
}

/// Rectify a terrestrial picture that looks straight down
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Rectify {
    /// The picture without the template: JPEG, PNG or TIFF.
    picture: PathBuf,
    /// The fish-eye camera: a JSON file.
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// The template's targets and their pixels: a JSON file.
    #[arg(long, value_name = "FILE")]
    target: PathBuf,
    /// Coordinates of the reference point in --crs: east or longitude, north or latitude, height.
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    reference: [f64; 3],
    /// Where the reference point is in the template's frame, in metres: by default its corner.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true, default_value = "0,0")]
    reference_at_m: Vector2<f64>,
    /// CRS of the reference: EPSG:<code> or a PROJ string.
    #[arg(long)]
    crs: Crs,
    /// What makes its height ellipsoidal, if it is above the geoid.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// Name of the scene.
    #[arg(long, value_parser = scene_name)]
    name: String,
    /// Standard deviation of the reference's coordinates.
    #[arg(long, value_name = "M", default_value_t = 0.03, value_parser = positive)]
    sigma_m: f64,
    /// Standard deviation of the measured pixels.
    #[arg(long, value_name = "PX", default_value_t = 0.5, value_parser = positive)]
    sigma_px: f64,
    /// Ground sample distance of the scene; about that of the aerial images or less.
    #[arg(long, value_name = "M", default_value_t = 0.02, value_parser = positive)]
    gsd_m: f64,
    /// Bearing of the template's arm, clockwise from true north, or from magnetic north with --magnetic.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    bearing_deg: f64,
    /// The arm that the bearing is of.
    #[arg(long, value_enum, default_value_t = Arm::Y)]
    arm: Arm,
    /// The bearing is a compass's: the declination by the World Magnetic Model is added.
    #[arg(long, requires = "date")]
    magnetic: bool,
    /// The day on which the compass was read.
    #[arg(long, value_name = "YYYY-MM-DD", requires = "magnetic")]
    date: Option<NaiveDate>,
    /// Standard deviation of the bearing: some 2 degrees of a hand compass.
    #[arg(long, value_name = "DEG", default_value_t = 2.0, value_parser = not_negative)]
    sigma_bearing_deg: f64,
    /// How high the targets were above the ground.
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true)]
    plate_height_m: f64,
    /// Ground that is seen at a larger angle from the vertical is left out.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = positive)]
    max_incidence_deg: f64,
    /// Largest side of the scene; by default all that is seen.
    #[arg(long, value_name = "M", value_parser = positive)]
    size_m: Option<f64>,
    /// Folder for NAME.png and NAME.json.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
}

/// A direction, its standard deviation, and how it came about.
struct Bearing {
    azimuth_of_y_rad: f64,
    sigma_rad: f64,
    said: String,
}

impl Rectify {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        files::note_on_heights(&self.crs, self.geoid_undulation_m)?;
        let coordinates =
            files::ellipsoidal(&self.crs, self.reference, self.geoid_undulation_m).context("--reference")?;
        let camera = files::camera(&self.camera)?;
        let targets = files::targets(&self.target)?;
        let bearing = self.bearing(coordinates)?;
        let measured: Vec<Target> = targets.iter().map(|(_, target)| *target).collect();
        let resection = resect(&measured, &camera, self.sigma_px).with_context(|| self.target.display().to_string())?;
        let name = || self.picture.display().to_string();
        let picture = ImageFile::open(&self.picture, &Limits::default()).with_context(name)?;
        let [width, height] = picture.size_px();
        if [width, height] != camera.size_px() {
            let [columns, rows] = camera.size_px();
            bail!("{} has {width} x {height} px, but --camera is of {columns} x {rows} px", name());
        }
        let window = picture.window(PixelRect { x: 0, y: 0, width, height }, 1).with_context(name)?;
        let layout = Layout {
            gsd_m: self.gsd_m,
            plane_height_m: -self.plate_height_m,
            largest_incidence_rad: self.max_incidence_deg.to_radians(),
            largest_side_m: self.size_m.unwrap_or(f64::INFINITY),
            azimuth_of_y_rad: bearing.azimuth_of_y_rad,
            sigma_bearing_rad: bearing.sigma_rad,
            reference_m: self.reference_at_m,
        };
        let rectified = rectify(&window, &camera, &resection, &layout).with_context(name)?;
        // where the scene is found also errs by its shift against the reference
        let sigma_m = self.sigma_m.hypot(rectified.sigma_shift_m);
        let reference = Reference { crs: &self.crs, coordinates, sigma_m };
        let written = files::write(&self.out, &self.name, &rectified.scene, &reference)?;
        let mut text = self.summary(&targets, &camera, &resection, &rectified, &bearing)?;
        writeln!(text, "wrote      {} and {}; sigma_m {sigma_m:.3}", written[0].display(), written[1].display())?;
        write!(text, "next       {}", sending(&written))?;
        print(&text)
    }

    fn bearing(&self, coordinates: [f64; 3]) -> anyhow::Result<Bearing> {
        let quarter_deg = match self.arm {
            Arm::X => -90.0,
            Arm::Y => 0.0,
        };
        let given_deg = self.bearing_deg + quarter_deg;
        let sigma_rad = self.sigma_bearing_deg.to_radians();
        let Some(date) = self.date.filter(|_| self.magnetic) else {
            let said = format!("true bearing {}°", self.bearing_deg);
            return Ok(Bearing { azimuth_of_y_rad: given_deg.to_radians(), sigma_rad, said });
        };
        let place = Ellipsoid::WGS84.geodetic(self.crs.geocentric_from_position(coordinates, None)?);
        let (longitude_deg, latitude_deg) = (place.longitude_rad.to_degrees(), place.latitude_rad.to_degrees());
        let year =
            u16::try_from(date.year()).with_context(|| format!("--date {date}: the year is out of all models"))?;
        let day = [year, date.month() as u16, date.day() as u16];
        let magnetic = declination(longitude_deg, latitude_deg, place.height_m, day)
            .with_context(|| format!("--magnetic --date {date}"))?;
        if magnetic.near_pole {
            bail!("--magnetic: so near to a magnetic pole no compass is to be relied on; give the true bearing");
        }
        let declination_deg = magnetic.declination_rad.to_degrees();
        let said = format!("magnetic bearing {}° + declination {declination_deg:.2}° on {date}", self.bearing_deg);
        let azimuth_of_y_rad = given_deg.to_radians() + magnetic.declination_rad;
        Ok(Bearing { azimuth_of_y_rad, sigma_rad: sigma_rad.hypot(magnetic.sigma_rad), said })
    }

    fn summary(
        &self,
        targets: &[(String, Target)],
        camera: &Fisheye,
        resection: &NadirResection,
        rectified: &Rectified,
        bearing: &Bearing,
    ) -> anyhow::Result<String> {
        let mut text = String::from("residuals  ");
        for ((name, _), residual) in targets.iter().zip(&resection.residuals_px) {
            write!(text, "{name} ({:.2}, {:.2})  ", residual.x, residual.y)?;
        }
        writeln!(text, "px\nsigma0     {:.2} with {} redundant", resection.sigma0, resection.redundancy)?;
        if resection.redundancy > 0 && resection.sigma0 > DOUBTFUL_SIGMA0 {
            let worst = targets
                .iter()
                .zip(&resection.residuals_px)
                .max_by(|(_, a), (_, b)| a.norm().total_cmp(&b.norm()))
                .map(|((name, _), _)| name.as_str());
            writeln!(
                text,
                "           this is much more than --sigma-px {} allows: look at the target {} first",
                self.sigma_px,
                worst.unwrap_or_default()
            )?;
        }
        let raw_m = resection.gsd_at_nadir_m(camera, -self.plate_height_m);
        let height_m = resection.orientation.projection_centre_m.z + self.plate_height_m;
        let tilt_deg = resection.tilt_rad().to_degrees();
        writeln!(text, "camera     {height_m:.3} m above the ground, tilted by {tilt_deg:.2}°")?;
        let scene = &rectified.scene;
        let (width, height) = (scene.width, scene.height);
        let (across_m, up_m) = (scene.gsd_m * width as f64, scene.gsd_m * height as f64);
        writeln!(
            text,
            "scene      {width} x {height} px of {:.1} mm: {across_m:.2} x {up_m:.2} m; below the camera a pixel of \
             the picture was {:.1} mm",
            1e3 * scene.gsd_m,
            1e3 * raw_m
        )?;
        if raw_m > scene.gsd_m {
            writeln!(
                text,
                "           the picture shows less detail than so small pixels promise: make --gsd-m larger"
            )?;
        }
        writeln!(
            text,
            "ground     shifted by {:.1} mm as a whole, {:.1} mm at the worst corner (standard deviations)",
            1e3 * rectified.sigma_shift_m,
            1e3 * rectified.sigma_corner_m
        )?;
        if rectified.sigma_corner_m > scene.gsd_m {
            writeln!(
                text,
                "           a pixel or more at the corner: spread the targets wider, or make --size-m smaller"
            )?;
        }
        let sigma_deg = scene.sigma_azimuth_rad.to_degrees();
        writeln!(text, "azimuth    north is up; {}; sigma {sigma_deg:.2}°", bearing.said)?;
        Ok(text)
    }
}

/// Measured targets rarely fit worse than this unless one is wrong.
const DOUBTFUL_SIGMA0: f64 = 2.5;
