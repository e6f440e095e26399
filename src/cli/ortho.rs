//! `gable ortho`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::control::{Source, geojson};
use crate::geometry::Crs;
use crate::imagery::georeference::{Georeference, world_file_beside};
use crate::imagery::{ImageFile, Limits};
use crate::orthos::{OrthoError, OrthoPhoto, Shift, against_edges, against_ortho_photo};
use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use nalgebra::Vector2;
use serde_json::json;

use super::export::Export;
use super::{Settings, geoids_of_environment, install_geoids, print};

const EXAMPLES: &str = "\
Examples:
  gable orient DJI_0042.JPG --camera camera.json --control roofs.geojson --crs EPSG:25832 --json > DJI_0042.json
  gable ortho make DJI_0042.JPG --result DJI_0042.json --camera camera.json --dem dem.tif --crs EPSG:25832 --out ortho
      Drives orthority (`pip install orthority`): ortho/DJI_0042_ORTHO.tif, beside the parameters that it was given.

  gable ortho check ortho/DJI_0042_ORTHO.tif --against dop20.tif
      How far it is off an ortho-photo that exists: the common shift, and what is left at single places.

  gable ortho check ortho/DJI_0042_ORTHO.tif --edges kerbs.geojson --crs EPSG:25832
      How far it is off lines that are known, as MultiLineStrings of control points. Only lines that lie on the surface
      of the elevation model may be taken: a roof that it does not have leans away from the camera.

The elevation model has the heights that --crs and --geoid-undulation-m say: above the ellipsoid, if they say nothing.";

/// Make an ortho-photo from an orientation, and measure how far it is off
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Ortho {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Make(Box<Make>),
    Check(Box<Check>),
}

/// Make an ortho-photo with orthority
#[derive(Debug, Args)]
struct Make {
    /// The image that was oriented.
    image: PathBuf,
    /// Its result, by `gable orient --json` or the API.
    #[arg(long, value_name = "FILE")]
    result: PathBuf,
    /// The camera: a JSON file as for `POST /cameras`; with --data also its id or name there.
    #[arg(long, value_name = "FILE|NAME")]
    camera: String,
    /// Elevation model of the ground in view, any raster that GDAL reads.
    #[arg(long, value_name = "FILE")]
    dem: PathBuf,
    /// CRS of the ortho-photo. [default: that of the result, or the UTM zone where that has degrees]
    #[arg(long)]
    crs: Option<Crs>,
    /// What its heights are above: ellipsoidal height - N.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// Side of a pixel of the ortho-photo. [default: the ground sample distance]
    #[arg(long, value_name = "M")]
    resolution_m: Option<f64>,
    /// Folder for the ortho-photo; it is made.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// orthority's command.
    #[arg(long, value_name = "COMMAND", default_value = "oty")]
    oty: PathBuf,
    #[command(flatten)]
    settings: Settings,
}

/// Measure how far an ortho-photo is off
#[derive(Debug, Args)]
struct Check {
    /// The ortho-photo: a GeoTIFF, or a picture with a world file.
    ortho: PathBuf,
    /// An ortho-photo of the same ground in the same CRS.
    #[arg(long, value_name = "FILE", required_unless_present = "edges")]
    against: Option<PathBuf>,
    /// GeoJSON file with lines on the ground, as control points.
    #[arg(long, value_name = "FILE", requires = "crs", conflicts_with = "against")]
    edges: Option<PathBuf>,
    /// CRS of these lines.
    #[arg(long, requires = "edges")]
    crs: Option<Crs>,
    /// CRS of the ortho-photo, if the file does not say.
    #[arg(long, requires = "edges")]
    ortho_crs: Option<Crs>,
    /// Only lines both ends of which are between these ellipsoidal heights.
    #[arg(long, value_name = "LEAST,MOST", requires = "edges", value_parser = heights, allow_hyphen_values = true)]
    heights_m: Option<[f64; 2]>,
    /// Displacements up to this are found. [default: 15 pixels]
    #[arg(long, value_name = "M")]
    search_m: Option<f64>,
    /// Status 1 if the common shift is larger than this.
    #[arg(long, value_name = "M")]
    tolerance_m: Option<f64>,
    /// Print every offset, as JSON.
    #[arg(long)]
    json: bool,
}

const SEARCH_PX: f64 = 15.0;

fn heights(text: &str) -> Result<[f64; 2], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let numbers = numbers.map_err(|error| format!("{text:?}: {error}; give two heights like 41,42.5"))?;
    numbers.try_into().map_err(|_| format!("{text:?} is not two heights like 41,42.5"))
}

impl Ortho {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        match self.action {
            Action::Make(make) => make.run().await,
            Action::Check(check) => tokio::task::spawn_blocking(move || check.run()).await?,
        }
    }
}

impl Make {
    async fn run(self) -> anyhow::Result<()> {
        let name = self.image.file_name().context("the image has no name")?.to_string_lossy().into_owned();
        Export::orthority(
            (self.result, name),
            self.camera,
            (self.crs.clone(), self.geoid_undulation_m),
            self.out.clone(),
            self.settings,
        )
        .run()
        .await?;
        let mut command = Command::new(&self.oty);
        command.arg("frame").arg("--dem").arg(&self.dem);
        command.arg("--int-param").arg(self.out.join("interior.yaml"));
        command.arg("--ext-param").arg(self.out.join("exterior.geojson"));
        command.arg("--out-dir").arg(&self.out).arg("--overwrite");
        if let Some(resolution_m) = self.resolution_m {
            command.arg("--res").arg(resolution_m.to_string());
        }
        command.arg(&self.image);
        let status = tokio::task::spawn_blocking(move || command.status()).await?;
        let status = status.with_context(|| {
            format!(
                "{} does not start; install it by `pip install orthority`, or name it with --oty",
                self.oty.display()
            )
        })?;
        if !status.success() {
            bail!("orthority has failed ({status}); what it said stands above");
        }
        Ok(())
    }
}

impl Check {
    fn run(self) -> anyhow::Result<()> {
        let limits = Limits::default();
        let place = georeference(&self.ortho, &limits)?;
        let picture = ImageFile::open(&self.ortho, &limits).with_context(|| self.ortho.display().to_string())?;
        let ortho = OrthoPhoto { picture: &picture, ground_from_pixel: place.ground_from_pixel };
        let search_m = self.search_m.unwrap_or(SEARCH_PX * ortho.gsd_m());
        let shift = match (&self.against, &self.edges) {
            (Some(file), _) => {
                let old_place = georeference(file, &limits)?;
                if let (Some(new), Some(old)) = (&place.crs, &old_place.crs)
                    && new != old
                {
                    bail!(
                        "the ortho-photos are in {new} and in {old}; bring them into one CRS, for instance by gdalwarp"
                    );
                }
                let old = ImageFile::open(file, &limits).with_context(|| file.display().to_string())?;
                let old = OrthoPhoto { picture: &old, ground_from_pixel: old_place.ground_from_pixel };
                against_ortho_photo(ortho, old, search_m)
            }
            (None, Some(file)) => {
                install_geoids(geoids_of_environment()?);
                let edges = self.edges_m(file, place.crs.as_deref())?;
                against_edges(ortho, &edges, search_m)
            }
            (None, None) => bail!("give --against FILE or --edges FILE"),
        };
        match shift {
            Ok(shift) => self.show(&shift),
            Err(error @ (OrthoError::Few { .. } | OrthoError::Scattered { .. })) => bail!("{error}; raise --search-m"),
            Err(error) => Err(error.into()),
        }
    }

    /// The lines in the CRS of the ortho-photo.
    fn edges_m(&self, file: &Path, named: Option<&str>) -> anyhow::Result<Vec<[Vector2<f64>; 2]>> {
        let crs = self.crs.clone().context("--edges needs --crs, the CRS of its coordinates")?;
        let of_ortho = match (&self.ortho_crs, named) {
            (Some(crs), _) => crs.clone(),
            (None, Some(name)) => Crs::parse(name).context("the CRS of the ortho-photo")?,
            (None, None) => bail!("the ortho-photo does not say its CRS; give --ortho-crs"),
        }
        .horizontal();
        let geodetic = Crs::parse("EPSG:4979")?;
        let name = || file.display().to_string();
        let body = std::fs::read(file).with_context(name)?;
        let parsed = geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: None }).with_context(name)?;
        if let [first, ..] = parsed.rejected.as_slice() {
            let (count, all) = (parsed.rejected.len(), parsed.rejected.len() + parsed.control_points.len());
            let told =
                format!("{count} of {all} features are no control points; feature {}: {}", first.index, first.detail);
            if count == all {
                bail!("{}: {told}", name());
            }
            eprintln!("{}: {told}", name());
        }
        let mut edges = Vec::new();
        for (_, point) in &parsed.control_points {
            for edge in &point.edges {
                let ends = [edge.geocentric_m.start, edge.geocentric_m.end];
                if let Some([least, most]) = self.heights_m {
                    let mut within = true;
                    for end in ends {
                        let height_m = geodetic.position_from_geocentric(end, None)?[2];
                        within &= (least..=most).contains(&height_m);
                    }
                    if !within {
                        continue;
                    }
                }
                let mut places = [Vector2::zeros(); 2];
                for (place, end) in places.iter_mut().zip(ends) {
                    let [x, y, _] = of_ortho.position_from_geocentric(end, None)?;
                    *place = Vector2::new(x, y);
                }
                edges.push(places);
            }
        }
        Ok(edges)
    }

    fn show(&self, shift: &Shift) -> anyhow::Result<()> {
        let common_m = shift.common_m.norm();
        if self.json {
            let offsets: Vec<_> = shift
                .offsets
                .iter()
                .map(|offset| json!({"at_m": offset.at_m.as_slice(), "shift_m": offset.shift_m.as_slice()}))
                .collect();
            print(&format!(
                "{:#}",
                json!({
                    "tried": shift.tried, "found": shift.offsets.len(), "common_m": shift.common_m.as_slice(),
                    "rms_m": shift.rms_m, "p95_m": shift.p95_m, "gsd_m": shift.gsd_m, "offsets": offsets,
                })
            ))?;
        } else {
            let (gsd_m, [east, north]) = (shift.gsd_m, [shift.common_m.x, shift.common_m.y]);
            print(&format!(
                "{} of {} places were found\ncommon shift  east {east:+.3} m, north {north:+.3} m ({:.2} pixels of {gsd_m:.3} m)\n\
                 offsets       rms {:.3} m ({:.2} pixels), 95 % below {:.3} m ({:.2} pixels)",
                shift.offsets.len(),
                shift.tried,
                common_m / gsd_m,
                shift.rms_m,
                shift.rms_m / gsd_m,
                shift.p95_m,
                shift.p95_m / gsd_m
            ))?;
        }
        match self.tolerance_m {
            Some(most_m) if common_m > most_m => bail!("the common shift is {common_m:.3} m, more than {most_m} m"),
            _ => Ok(()),
        }
    }
}

/// Where an ortho-photo lies, by its tags or the world file beside it.
fn georeference(file: &Path, limits: &Limits) -> anyhow::Result<Georeference> {
    let name = || file.display().to_string();
    if let Some(place) = Georeference::of_geotiff(file, limits).with_context(name)? {
        return Ok(place);
    }
    let world = world_file_beside(file)
        .with_context(|| format!("{}: neither the tags of a GeoTIFF nor a world file say where it lies", name()))?;
    let text = std::fs::read_to_string(&world).with_context(|| world.display().to_string())?;
    Georeference::from_world_file(&text).with_context(|| world.display().to_string())
}
