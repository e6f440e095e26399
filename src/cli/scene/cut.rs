//! `gable scene cut`.

use std::path::PathBuf;

use crate::geometry::Crs;
use crate::imagery::georeference::{Georeference, world_file_beside};
use crate::imagery::{ImageFile, Limits};
use crate::scenes::cut::{Ortho, cut};
use anyhow::{Context as _, bail};
use clap::Args;
use nalgebra::Vector2;
use serde::Deserialize;

use super::files::{self, Reference, not_negative, pair, positive, scene_name, sending};
use crate::cli::print;

const EXAMPLES: &str = "\
Examples:
  gable scene cut ortho.tif --at 565012.3,5934410.7 --height-m 45.1 --name crossing-4 --out scenes
      15 m about a point, out of a GeoTIFF that says where it lies and in which system. The height above the ellipsoid
      comes from a terrain model: the ortho-photo has none.

  gable scene cut ortho.jpg --crs EPSG:25832 --at 565012.3,5934410.7 --height-m 0.9 --geoid-undulation-m 44.2 \\
        --name crossing-4 --size-m 25
      With ortho.jgw beside it (else --world FILE), and a height above the geoid.

  gable scene cut ortho.tif --points points.csv --sigma-m 0.2 --out scenes
      Many at once: points.csv has the columns name,e,n,h.

Good scenes have contrast in all directions, lie on flat ground, and last: crossings, markings, paving, drains; no
shadows, no cars, no roofs (an ortho-photo of the ground displaces them). North of the grid is not true north: the
azimuth that is written has the convergence of the meridians in it.";

/// Cut control scenes out of an ortho-photo
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Cut {
    /// The ortho-photo: TIFF, JPEG or PNG.
    ortho: PathBuf,
    /// Its world file; by default the tags of a GeoTIFF, else the world file beside it (.tfw, .jgw, .pgw, .wld).
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// CRS of the ortho-photo: EPSG:<code> or a PROJ string; by default what a GeoTIFF names.
    #[arg(long)]
    crs: Option<Crs>,
    /// The reference point: east or longitude, north or latitude.
    #[arg(long, value_name = "E,N", value_parser = pair, allow_hyphen_values = true)]
    #[arg(requires_all = ["height_m", "name"])]
    at: Option<Vector2<f64>>,
    /// Its height above the ellipsoid.
    #[arg(long, value_name = "H", allow_negative_numbers = true, requires = "at")]
    height_m: Option<f64>,
    /// What makes heights ellipsoidal, if they are above the geoid.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// Name of the scene.
    #[arg(long, value_parser = scene_name, requires = "at")]
    name: Option<String>,
    /// CSV file with the columns name,e,n,h in place of --name, --at and --height-m.
    #[arg(long, value_name = "FILE", conflicts_with = "at", required_unless_present = "at")]
    points: Option<PathBuf>,
    /// Side of a scene on the ground.
    #[arg(long, value_name = "M", default_value_t = 15.0, value_parser = positive)]
    size_m: f64,
    /// Standard deviation of places in the ortho-photo and of their heights; by default two pixels.
    #[arg(long, value_name = "M", value_parser = positive)]
    sigma_m: Option<f64>,
    /// Standard deviation of the ortho-photo's own direction.
    #[arg(long, value_name = "DEG", default_value_t = 0.2, value_parser = not_negative)]
    sigma_azimuth_deg: f64,
    /// Folder for NAME.png and NAME.json.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
}

#[derive(Debug, Deserialize)]
struct Point {
    name: String,
    e: f64,
    n: f64,
    h: f64,
}

impl Cut {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let points = self.points()?;
        let georeference = self.georeference()?;
        let crs = match (&self.crs, &georeference.crs) {
            (Some(crs), _) => crs.clone(),
            (None, Some(named)) => named.parse().with_context(|| format!("{} names its CRS", self.ortho.display()))?,
            (None, None) => bail!("{} does not name its CRS: give --crs", self.ortho.display()),
        };
        files::note_on_heights(&crs, self.geoid_undulation_m)?;
        let file =
            ImageFile::open(&self.ortho, &Limits::default()).with_context(|| self.ortho.display().to_string())?;
        let ortho = Ortho { picture: &file, ground_from_pixel: georeference.ground_from_pixel, crs: &crs };
        // one bad point never loses the others
        let mut failed = 0;
        for point in &points {
            match self.one(&ortho, point) {
                Ok(text) => print(&text)?,
                Err(error) if self.points.is_some() => {
                    failed += 1;
                    print(&format!("{}: left out: {error:#}", point.name))?;
                }
                Err(error) => return Err(error),
            }
        }
        if failed == points.len() {
            bail!("no scene was cut");
        }
        Ok(())
    }

    fn points(&self) -> anyhow::Result<Vec<Point>> {
        let Some(file) = &self.points else {
            let (Some(at), Some(h), Some(name)) = (self.at, self.height_m, self.name.clone()) else {
                bail!("give --name, --at and --height-m, or --points");
            };
            return Ok(vec![Point { name, e: at.x, n: at.y, h }]);
        };
        let name = || file.display().to_string();
        let reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file);
        let points = reader.with_context(name)?.into_deserialize().collect::<Result<Vec<Point>, _>>();
        let points = points.with_context(|| format!("{} (columns name,e,n,h)", name()))?;
        if points.is_empty() {
            bail!("{} has no points", name());
        }
        Ok(points)
    }

    fn georeference(&self) -> anyhow::Result<Georeference> {
        let of_world = |file: &PathBuf| -> anyhow::Result<Georeference> {
            let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
            Georeference::from_world_file(&text).with_context(|| file.display().to_string())
        };
        let name = || self.ortho.display().to_string();
        let tags = Georeference::of_geotiff(&self.ortho, &Limits::default()).with_context(name)?;
        match (&self.world, tags, world_file_beside(&self.ortho)) {
            (Some(file), tags, _) => Ok(Georeference { crs: tags.and_then(|tags| tags.crs), ..of_world(file)? }),
            (None, Some(tags), _) => Ok(tags),
            (None, None, Some(file)) => of_world(&file),
            (None, None, None) => {
                bail!("{}: there is no world file beside it, and no tag of a GeoTIFF: give --world", name())
            }
        }
    }

    fn one(&self, ortho: &Ortho<'_, ImageFile>, point: &Point) -> anyhow::Result<String> {
        let coordinates = files::ellipsoidal(ortho.crs, [point.e, point.n, point.h], self.geoid_undulation_m)?;
        let scene = cut(ortho, coordinates, self.size_m, self.sigma_azimuth_deg.to_radians())?;
        let sigma_m = self.sigma_m.unwrap_or(2.0 * scene.gsd_m);
        let reference = Reference { crs: ortho.crs, coordinates, sigma_m };
        let written = files::write(&self.out, &point.name, &scene, &reference)?;
        Ok(format!(
            "{}: {} x {} px of {:.4} m, up is {:.3}° from true north, sigma_m {sigma_m:.3}\n  {}",
            point.name,
            scene.width,
            scene.height,
            scene.gsd_m,
            scene.azimuth_of_image_up_rad.to_degrees(),
            sending(&written)
        ))
    }
}
