//! `gable import`.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::buildings;
use crate::configuration::Configuration;
use crate::control::geojson::Defaults;
use crate::control::points::{self, FileIdentity, Import as Plan, Step};
use crate::control::sets::NewSet;
use crate::control::{FileFormat, ImportReport, Mode, Reading, Rejection, Use, Validity};
use crate::database::Database;
use crate::geometry::Crs;
use crate::store::Store;
use anyhow::{Context as _, bail};
use chrono::NaiveDate;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};

use super::scenes::{self, Bounds, SceneList};
use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable import buildings.geojson --crs EPSG:25832 --data /srv/gable
      Adds the control points in the file, and updates those that are known by name. A service on the same folder may \
      be running: it uses them from the next image on.

  gable import koeln.city.jsonl --set nrw-2024 --year 2024 --refused refused.csv
      Adds the roof edges of a building model to a set that requests can choose, and says why of each building that it \
      cannot use. Called again after an interruption, it goes on where it was.

  gable import roofs.gpkg
      Adds the lines, or the edges of the roof surfaces, of a GeoPackage. Rows with the same cp_id or building_id are one \
      building.

  gable import buildings.geojson --crs EPSG:25832 --geoid-undulation-m 46.2
      The same where heights are above the geoid: height + 46.2 m = ellipsoidal height.

  gable import checks.geojson --crs EPSG:25832 --set checks --use check
      Adds buildings that are never used, and tell how right every orientation is.

  gable import all.geojson --crs EPSG:2180 --mode replace
      Makes the file all there is in its set: control points that are not in it are removed.

  gable import --scenes scenes.json --data /srv/gable
      Adds control scenes, small georeferenced pictures of the ground, and replaces those that are known by name. The \
      pictures are in the folder scenes beside the list, or right beside it.

Each feature of GeoJSON is one building, a MultiLineString of segments with two 3D positions each:
  {\"type\": \"FeatureCollection\", \"features\": [
    {\"type\": \"Feature\", \"properties\": {\"name\": \"church-7\", \"sigma_m\": 0.1},
     \"geometry\": {\"type\": \"MultiLineString\", \"coordinates\": [[[565012.1, 5934410.4, 78.2], [565021.9, 5934412.0, 78.2]]]}}]}

Each entry of a list of scenes is what `POST /control-scenes` takes, with the file of its picture:
  [{\"name\": \"church-square\", \"file\": \"church-square.jpg\", \"gsd_m\": 0.02, \"azimuth_of_image_up_deg\": 0,
    \"sigma_azimuth_deg\": 5, \"reference_px\": [212.5, 198.0], \"sigma_m\": 0.05,
    \"reference\": {\"crs\": \"EPSG:25832\", \"coordinates\": [565012.1, 5934410.4, 71.3]}}]";

/// Import control points, or control scenes, into the data folder
#[derive(Debug, Args)]
#[command(
    after_help = EXAMPLES,
    override_usage = "gable import [OPTIONS] [--crs <CRS>] <FILE>\n       gable import [OPTIONS] --scenes <FILE>",
)]
pub(crate) struct Import {
    /// File with the control points: GeoJSON, CityJSON, CityJSONSeq, CityGML or GeoPackage.
    #[arg(required_unless_present = "scenes")]
    file: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingFlags,
    /// The set that they belong to; it is made if there is none. [default: default]
    #[arg(long, value_name = "NAME", requires = "file")]
    set: Option<String>,
    /// Year of the survey of that set.
    #[arg(long, value_name = "YEAR", requires = "file")]
    year: Option<i64>,
    /// What is in that set.
    #[arg(long, value_name = "TEXT", requires = "file")]
    description: Option<String>,
    /// What they are there for: `check` is never used, and reported with every orientation.
    #[arg(long = "use", value_enum, default_value_t, requires = "file")]
    purpose: Use,
    /// First day on which the buildings stand like this, where the file does not say.
    #[arg(long, value_name = "YYYY-MM-DD", requires = "file")]
    valid_from: Option<NaiveDate>,
    /// Last day on which they do.
    #[arg(long, value_name = "YYYY-MM-DD", requires = "file")]
    valid_to: Option<NaiveDate>,
    /// Standard deviation of the coordinates in metres, where the file does not say. [default: 0.15 of building models]
    #[arg(long, value_name = "METRES", requires = "file", allow_negative_numbers = true)]
    sigma_m: Option<f64>,
    /// Begin anew even if an import of this file was interrupted.
    #[arg(long, requires = "file")]
    anew: bool,
    /// Write all that was refused to this file (CSV: index, name, detail) in place of what it has. An import that goes on
    /// after an interruption goes on in it.
    #[arg(long, value_name = "FILE", requires = "file")]
    refused: Option<PathBuf>,
    /// JSON file with a list of control scenes, instead.
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    scenes: Option<PathBuf>,
    /// What becomes of control points, or scenes, whose name is known.
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    settings: Settings,
}

/// How a file of control points is read.
#[derive(Debug, Clone, Args)]
struct ReadingFlags {
    /// CRS of its coordinates: EPSG:<code> or a PROJ string. A building model or a GeoPackage may say so itself.
    #[arg(long, requires = "file")]
    crs: Option<Crs>,
    /// Its format. [default: by its content and name]
    #[arg(long, value_enum, requires = "file")]
    format: Option<NamedFormat>,
    /// What makes its heights ellipsoidal, if they are above the geoid.
    #[arg(long, value_name = "N", requires = "file", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
}

/// Formats by their names on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum NamedFormat {
    Geojson,
    Cityjson,
    Cityjsonseq,
    Citygml,
    Geopackage,
}

impl From<NamedFormat> for FileFormat {
    fn from(format: NamedFormat) -> Self {
        match format {
            NamedFormat::Geojson => Self::GeoJson,
            NamedFormat::Cityjson => Self::Model(buildings::Format::CityJson),
            NamedFormat::Cityjsonseq => Self::Model(buildings::Format::CityJsonSeq),
            NamedFormat::Citygml => Self::Model(buildings::Format::CityGml),
            NamedFormat::Geopackage => Self::GeoPackage,
        }
    }
}

impl Import {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "warn".to_owned());
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let (thing, report) = match (&self.scenes, &self.file) {
            (Some(list), _) => ("scene", self.scenes(list, &configuration).await?),
            (None, Some(file)) => ("feature", self.buildings(file, &configuration).await?),
            _ => bail!("give a file of control points, or --scenes FILE"),
        };
        if self.json {
            return print(&serde_json::to_string_pretty(&report)?);
        }
        self.tell(thing, &report)
    }

    fn tell(&self, thing: &str, report: &ImportReport) -> anyhow::Result<()> {
        let ImportReport { imported, updated, rejected, rejected_count, rejected_by_reason, resumed_at, .. } = report;
        if let Some(item) = resumed_at {
            print(&format!("went on at {thing} {item}, where it was interrupted; --anew begins again"))?;
        }
        for rejection in rejected {
            let name = rejection.name.as_deref().unwrap_or("without a name");
            print(&format!("rejected: {thing} {} ({name}): {}", rejection.index, rejection.detail))?;
        }
        if *rejected_count > rejected.len() {
            for reason in rejected_by_reason {
                print(&format!("{} times: {}", reason.count, reason.reason))?;
            }
        }
        print(&format!("{imported} imported, {updated} updated, {rejected_count} rejected"))?;
        if imported + updated == 0 && *rejected_count > 0 {
            bail!("nothing was imported");
        }
        Ok(())
    }

    async fn buildings(&self, file: &Path, configuration: &Configuration) -> anyhow::Result<ImportReport> {
        let name = || file.display().to_string();
        let set = NewSet {
            name: self.set.clone().unwrap_or(NewSet::default().name),
            survey_year: self.year,
            description: self.description.clone(),
        };
        set.check().map_err(|detail| anyhow::anyhow!("--set, --year, --description: {detail}"))?;
        let validity = Validity { from: self.valid_from, to: self.valid_to };
        let defaults = Defaults { sigma_m: self.sigma_m, purpose: self.purpose, validity };
        defaults.check().map_err(|detail| anyhow::anyhow!("--sigma-m: {detail}"))?;
        let reading = self.reading.reading(file, defaults)?;
        let identity = FileIdentity::of(file).with_context(name)?;
        let plan = Plan { set, mode: self.mode, file: Some(identity), anew: self.anew };
        let mut refusals = self.refused.as_deref().map(Refusals::open).transpose()?;
        let store = Store::connect(&configuration.place()).await?;
        let imported = import_file(store.database(), file, &plan, reading, |step| match &mut refusals {
            Some(refusals) => refusals.write(step),
            None => Ok(()),
        })
        .await;
        store.close().await;
        imported
    }

    async fn scenes(&self, file: &Path, configuration: &Configuration) -> anyhow::Result<ImportReport> {
        let list = SceneList::read(file)?;
        let store = Store::connect(&configuration.place()).await?;
        let bar = bar(list.len() as u64, "{msg} {wide_bar} {pos}/{len} {eta}");
        let progress = |done| bar.set_position(done as u64);
        let imported = scenes::import(store.database(), &list, &Bounds::of(configuration), self.mode, progress).await;
        bar.finish_and_clear();
        store.close().await;
        imported
    }
}

impl ReadingFlags {
    fn reading(&self, file: &Path, defaults: Defaults) -> anyhow::Result<Reading> {
        let format = match self.format {
            Some(format) => format.into(),
            None => recognised(file)?,
        };
        let (crs, geoid_undulation_m) = (self.crs.clone(), self.geoid_undulation_m);
        Ok(Reading { format, crs, geoid_undulation_m, defaults, heights_assumed: Arc::default() })
    }
}

fn recognised(file: &Path) -> anyhow::Result<FileFormat> {
    let name = file.display().to_string();
    let mut first = Vec::new();
    let opened = File::open(file).with_context(|| format!("cannot read {name}"))?;
    opened.take(FileFormat::FIRST_BYTES).read_to_end(&mut first).with_context(|| format!("cannot read {name}"))?;
    let by_name = file.file_name().and_then(|name| name.to_str());
    FileFormat::recognise(&first, by_name)
        .with_context(|| format!("{name} is no file of control points that is known; --format may say what it is"))
}

/// Imports a file, with a bar that tells how far it is, how fast it goes and how long it takes still. `told` is told of
/// each step.
async fn import_file(
    database: &Database,
    file: &Path,
    plan: &Plan,
    reading: Reading,
    mut told: impl FnMut(&Step<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<ImportReport> {
    let name = file.display().to_string();
    let opened = File::open(file).with_context(|| format!("cannot read {name}"))?;
    let size_bytes = opened.metadata()?.len();
    let bar = bar(size_bytes, "{msg} {wide_bar} {binary_bytes}/{binary_total_bytes} {eta}");
    let (done, mut trouble) = (Arc::new(AtomicU64::new(0)), None);
    let (counted, share, path) = (Counted { inner: opened, done: done.clone() }, done.clone(), file.to_owned());
    let (began, mut first, heights_assumed) = (Instant::now(), None, reading.heights_assumed.clone());
    let read = points::import(
        database,
        plan,
        reading,
        move |reading, each| match reading.format {
            FileFormat::GeoPackage => {
                let mut tell = |read| share.store((read * size_bytes as f64) as u64, Ordering::Relaxed);
                reading.read_geopackage(&path, &mut tell, each)
            }
            _ => reading.read(&mut BufReader::with_capacity(1 << 20, counted), each),
        },
        |step: Step<'_>| {
            let first = *first.get_or_insert(step.report.resumed_at.unwrap_or(0));
            let a_second = (step.items_done - first) as f64 / began.elapsed().as_secs_f64();
            let refused_count = step.report.rejected_count;
            bar.set_message(format!("{} buildings, {a_second:.0}/s, {refused_count} refused", step.items_done));
            bar.set_position(done.load(Ordering::Relaxed));
            if let Err(error) = told(&step) {
                trouble.get_or_insert(error);
            }
        },
    );
    let imported = read.await;
    bar.finish_and_clear();
    if let Some(crs) = heights_assumed.get() {
        tracing::warn!(
            "{crs} says nothing about heights: they are taken as ellipsoidal; --geoid-undulation-m makes them so"
        );
    }
    let report = imported.with_context(|| name)?;
    trouble.map_or(Ok(report), Err)
}

/// Imports a file into a database that is made for one image.
pub(super) async fn import_for_one(
    database: &Database,
    file: &Path,
    crs: Option<Crs>,
    geoid_undulation_m: Option<f64>,
) -> anyhow::Result<ImportReport> {
    let (format, heights_assumed) = (recognised(file)?, Arc::default());
    let reading = Reading { format, crs, geoid_undulation_m, defaults: Defaults::default(), heights_assumed };
    import_file(database, file, &Plan::default(), reading, |_| Ok(())).await
}

/// A file that tells how much of it was read.
struct Counted {
    inner: File,
    done: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.done.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}

/// A table of what was refused.
struct Refusals {
    writer: csv::Writer<File>,
    /// Whether it is known what becomes of what the file had before.
    begun: bool,
}

impl Refusals {
    fn open(path: &Path) -> anyhow::Result<Self> {
        let file = File::options().create(true).append(true).open(path);
        let file = file.with_context(|| format!("--refused {}", path.display()))?;
        Ok(Self { writer: csv::Writer::from_writer(file), begun: false })
    }

    /// Leaves what an import that goes on has written before; what another one has written goes.
    fn begin(&mut self, resumed: bool) -> anyhow::Result<()> {
        let file = self.writer.get_ref();
        if !resumed {
            file.set_len(0)?;
        }
        if file.metadata()?.len() == 0 {
            self.writer.write_record(["index", "name", "detail"])?;
        }
        self.begun = true;
        Ok(())
    }

    fn write(&mut self, step: &Step<'_>) -> anyhow::Result<()> {
        if !self.begun {
            self.begin(step.report.resumed_at.is_some())?;
        }
        for Rejection { index, name, detail } in step.rejected {
            self.writer.write_record([&index.to_string(), name.as_deref().unwrap_or_default(), detail])?;
        }
        Ok(self.writer.flush()?)
    }
}

fn bar(length: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template);
    let bar = ProgressBar::new(length).with_message("importing");
    bar.enable_steady_tick(Duration::from_millis(200));
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_refusals_begins_anew_unless_the_import_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("refused.csv");
        let import = |resumed_at, details: &[&str]| {
            let report = ImportReport { resumed_at, ..ImportReport::default() };
            let mut refusals = Refusals::open(&path).unwrap();
            for (index, detail) in details.iter().enumerate() {
                let rejected = [Rejection::new(index, None, (*detail).to_owned())];
                refusals.write(&Step { items_done: index + 1, report: &report, rejected: &rejected }).unwrap();
            }
            std::fs::read_to_string(&path).unwrap()
        };
        assert_eq!(import(None, &["a", "b"]), "index,name,detail\n0,,a\n1,,b\n");
        assert_eq!(import(Some(2), &["c"]), "index,name,detail\n0,,a\n1,,b\n0,,c\n");
        assert_eq!(import(None, &["d"]), "index,name,detail\n0,,d\n");
    }
}
