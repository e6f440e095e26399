//! `gable import`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use clap::Args;
use gable::configuration::Configuration;
use gable::control::{ImportReport, Mode, Source, geojson, points};
use gable::geometry::Crs;
use gable::store::Store;
use indicatif::{ProgressBar, ProgressStyle};

use super::scenes::{self, Bounds, SceneList};
use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable import buildings.geojson --crs EPSG:25832 --data /srv/gable
      Adds the control points in the file, and updates those that are known by name. A service on the same folder may \
      be running: it uses them from the next image on.

  gable import buildings.geojson --crs EPSG:25832 --geoid-undulation-m 46.2
      The same where heights are above the geoid: height + 46.2 m = ellipsoidal height.

  gable import all.geojson --crs EPSG:2180 --mode replace
      Makes the file all there is: control points that are not in it are removed.

  gable import --scenes scenes.json --data /srv/gable
      Adds control scenes, small georeferenced pictures of the ground, and replaces those that are known by name. The \
      pictures are in the folder scenes beside the list, or right beside it.

Each feature is one building, a MultiLineString of segments with two 3D positions each:
  {\"type\": \"FeatureCollection\", \"features\": [
    {\"type\": \"Feature\", \"properties\": {\"name\": \"church-7\", \"sigma_m\": 0.1},
     \"geometry\": {\"type\": \"MultiLineString\", \"coordinates\": [[[565012.1, 5934410.4, 78.2], [565021.9, 5934412.0, 78.2]]]}}]}

Each entry of a list of scenes is what `POST /control-scenes` takes, with the file of its picture:
  [{\"name\": \"church-square\", \"file\": \"church-square.jpg\", \"gsd_m\": 0.02, \"azimuth_of_image_up_deg\": 0,
    \"sigma_azimuth_deg\": 5, \"reference_px\": [212.5, 198.0], \"sigma_m\": 0.05,
    \"reference\": {\"crs\": \"EPSG:25832\", \"coordinates\": [565012.1, 5934410.4, 71.3]}}]";

/// Import control points from a GeoJSON file, or control scenes, into the data folder
#[derive(Debug, Args)]
#[command(
    after_help = EXAMPLES,
    override_usage = "gable import [OPTIONS] --crs <CRS> <FILE>\n       gable import [OPTIONS] --scenes <FILE>",
)]
pub(crate) struct Import {
    /// GeoJSON file with the control points.
    #[arg(required_unless_present = "scenes", requires = "crs")]
    file: Option<PathBuf>,
    /// CRS of its coordinates: EPSG:<code> or a PROJ string.
    #[arg(long, requires = "file")]
    crs: Option<Crs>,
    /// JSON file with a list of control scenes, instead.
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    scenes: Option<PathBuf>,
    /// What makes its heights ellipsoidal, if they are above the geoid.
    #[arg(long, value_name = "N", requires = "file", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// What becomes of control points, or scenes, whose name is known.
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    settings: Settings,
}

impl Import {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "warn".to_owned());
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let (thing, report) = match (&self.scenes, &self.file, &self.crs) {
            (Some(list), ..) => ("scene", self.scenes(list, &configuration).await?),
            (None, Some(file), Some(crs)) => ("feature", self.buildings(file, crs, &configuration).await?),
            _ => bail!("give a GeoJSON file and --crs, or --scenes FILE"),
        };
        if self.json {
            return print(&serde_json::to_string_pretty(&report)?);
        }
        for rejection in &report.rejected {
            let name = rejection.name.as_deref().unwrap_or("without a name");
            print(&format!("rejected: {thing} {} ({name}): {}", rejection.index, rejection.detail))?;
        }
        let ImportReport { imported, updated, rejected } = &report;
        print(&format!("{imported} imported, {updated} updated, {} rejected", rejected.len()))?;
        if imported + updated == 0 && !rejected.is_empty() {
            bail!("nothing was imported");
        }
        Ok(())
    }

    async fn buildings(&self, file: &Path, crs: &Crs, configuration: &Configuration) -> anyhow::Result<ImportReport> {
        warn_of_heights(crs, self.geoid_undulation_m);
        let parsed = parse(file, crs.clone(), self.geoid_undulation_m).await?;
        let store = Store::connect(&configuration.place()).await?;
        let bar = bar(parsed.control_points.len());
        let imported = points::import(store.database(), parsed, self.mode, |done| bar.set_position(done as u64)).await;
        bar.finish_and_clear();
        store.close().await;
        Ok(imported?)
    }

    async fn scenes(&self, file: &Path, configuration: &Configuration) -> anyhow::Result<ImportReport> {
        let list = SceneList::read(file)?;
        let store = Store::connect(&configuration.place()).await?;
        let bar = bar(list.len());
        let progress = |done| bar.set_position(done as u64);
        let imported = scenes::import(store.database(), &list, &Bounds::of(configuration), self.mode, progress).await;
        bar.finish_and_clear();
        store.close().await;
        imported
    }
}

/// Says so where heights are taken as ellipsoidal for want of better knowledge.
pub(super) fn warn_of_heights(crs: &Crs, geoid_undulation_m: Option<f64>) {
    if crs.assumes_ellipsoidal_heights() && geoid_undulation_m.is_none() {
        tracing::warn!(
            "{crs} says nothing about heights: they are taken as ellipsoidal; --geoid-undulation-m makes them so"
        );
    }
}

/// Reads a file of control points, away from the threads that wait for others.
pub(super) async fn parse(
    file: &std::path::Path,
    crs: Crs,
    geoid_undulation_m: Option<f64>,
) -> anyhow::Result<geojson::Parsed> {
    let name = file.display().to_string();
    let body = tokio::fs::read(file).await.with_context(|| format!("cannot read {name}"))?;
    let parse = move || geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m });
    tokio::task::spawn_blocking(parse).await?.with_context(|| name)
}

fn bar(length: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    let bar = ProgressBar::new(length as u64).with_message("importing");
    bar.enable_steady_tick(Duration::from_millis(200));
    style.map_or(bar.clone(), |style| bar.with_style(style))
}
