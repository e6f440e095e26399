//! `gable orient`.

pub(super) mod summary;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::control::Mode;
use crate::control::geojson::Rejection;
use crate::control::near::Reach;
use crate::database::Database;
use crate::geometry::Crs;
use crate::http::cameras::CameraRequest;
use crate::http::extract::parse_json;
use crate::http::problem::Problem;
use crate::imagery::{self, ImageFile, Limits};
use crate::jobs::active::{ActiveClassifier, shipped_classifier};
use crate::jobs::camera_model::{camera_model, uploaded_templates};
use crate::jobs::film_camera::Templates;
use crate::jobs::request::{
    ApproximationRequest, CameraModel, ControlChoice, CostsRequest, ImageFacts, OrientationRequest,
};
use crate::jobs::scenes::ControlNear;
use crate::jobs::{self, Orient as Pipeline};
use crate::learning::Costs;
use crate::pipeline::{self, Observer, Stage};
use crate::report::drawing::Drawing;
use crate::report::overlay::{self, Format};
use crate::report::{OrientationResult, Position, Vertical};
use crate::store::Store;
use anyhow::{Context as _, bail};
use chrono::NaiveDate;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::evaluate::costs;
use super::scan::ScanFlags;
use super::scenes::{self, Bounds, SceneList};
use super::{Settings, import, print};

const EXAMPLES: &str = "\
Examples:
  gable orient DSC01.jpg --camera camera.json --control buildings.geojson --crs EPSG:25832 \\
      --position 565480,5934120,410 --position-crs EPSG:25832 --kappa 12 --overlay seen.png
      Orients one image without any service, and draws what it has seen. On a terminal the answer is a summary; \
      elsewhere, and with --json, it is the API's JSON.

  gable orient DSC01.jpg --camera canon-sx260 --data /srv/gable
      With the cameras and control points of a data folder; position and heading from the image's EXIF.

  gable orient DSC01.jpg --camera camera.json --control buildings.geojson --crs EPSG:4979 \\
      --approximation approximation.json --json | jq .result.diagnosis
      With the approximation as the API has it: {\"position\": {\"crs\": …, \"coordinates\": […]}, \"omega_deg\": …}.

  gable orient DSC01.jpg --camera camera.json --scenes scenes.json --position 565480,5934120,410 --position-crs EPSG:25832
      With control scenes, small georeferenced pictures of the ground, instead of buildings or, together with --control, \
      beside them.

  gable orient DSC01.jpg --camera canon-sx260 --data /srv/gable --use scenes
      With the control scenes of a data folder only.

What is not given is taken from the image's EXIF and XMP, else: omega = phi = 0 with sigma 5 degrees, kappa unknown (the \
whole circle is searched), position sigma 15, 15, 30 m. Angles are in degrees about the axes of a local east, north, up \
frame at the position.";

/// Orient one image
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Orient {
    /// The image: JPEG, PNG or TIFF.
    image: PathBuf,
    /// The camera: a JSON file as for `POST /cameras`; with --data also its id or name there.
    #[arg(long, value_name = "FILE|NAME")]
    camera: String,
    /// GeoJSON file with the control points; without it and --scenes, the control of the data folder is used.
    #[arg(long, value_name = "FILE", requires = "crs")]
    control: Option<PathBuf>,
    /// CRS of the control points in the file.
    #[arg(long, requires = "control")]
    crs: Option<Crs>,
    /// What makes the heights in the file ellipsoidal, if they are above the geoid.
    #[arg(long, value_name = "N", requires = "control", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// JSON file with a list of control scenes, as for `gable import --scenes`.
    #[arg(long, value_name = "FILE")]
    scenes: Option<PathBuf>,
    /// Which control is used. [default: whatever there is]
    #[arg(long = "use", value_name = "KIND", value_enum)]
    control_choice: Option<ControlChoice>,
    /// Sets of control points that may be used, with commas between. [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    control_sets: Vec<String>,
    /// When the image was taken: buildings that did not stand then are not used. [default: as EXIF says, else today]
    #[arg(long, value_name = "YYYY-MM-DD")]
    date: Option<NaiveDate>,
    /// The largest error on the ground that is acceptable, in ground sample distances. [default: 10]
    #[arg(long, value_name = "N", conflicts_with = "tolerance_m")]
    tolerance_gsd: Option<f64>,
    /// The same in metres.
    #[arg(long, value_name = "N")]
    tolerance_m: Option<f64>,
    /// What decisions cost: accepted and right, accepted though wrong, rejected though right, rejected and wrong.
    /// [default: 0,40,5,10, or as configured]
    #[arg(long, value_name = "CC,CW,WC,WW", value_parser = costs)]
    costs: Option<Costs>,
    /// So many times larger than the classifier says may the odds of being wrong be. [default: the classifier's]
    #[arg(long, value_name = "N")]
    caution: Option<f64>,
    /// T_d: green where the score exceeds it, whatever costs and caution.
    #[arg(long, value_name = "SCORE", allow_negative_numbers = true)]
    threshold: Option<f64>,
    /// CRS of the result. [default: that of the position]
    #[arg(long, value_name = "CRS")]
    output_crs: Option<String>,
    /// Draw the image with what was found in it to this file (.png or .jpg): the projected edges in blue if their
    /// control point was used, vermilion if all that was matched to it was rejected, purple if it took no part; matched
    /// line segments in yellow; arrows from predicted to found.
    #[arg(long, value_name = "FILE")]
    overlay: Option<PathBuf>,
    /// At most so many columns of the overlay.
    #[arg(long, value_name = "PX", default_value_t = 2000)]
    overlay_width: u32,
    /// Print the API's JSON, also on a terminal.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    approximation: ApproximationFlags,
    #[command(flatten)]
    scan: ScanFlags,
}

/// The approximation, flag by flag.
#[derive(Debug, Args)]
#[command(next_help_heading = "Approximate orientation")]
struct ApproximationFlags {
    /// JSON file with the approximation as the API has it; single flags overrule it.
    #[arg(long, value_name = "FILE")]
    approximation: Option<PathBuf>,
    /// The projection centre: longitude or east, latitude or north, height.
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    position: Option<[f64; 3]>,
    /// CRS of the position.
    #[arg(long, value_name = "CRS", default_value = "EPSG:4979")]
    position_crs: String,
    /// What makes the height of the position, or of the EXIF, ellipsoidal.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    position_undulation_m: Option<f64>,
    /// Standard deviations of the position, east, north, up.
    #[arg(long, value_name = "E,N,U", value_parser = triple)]
    sigma_position_m: Option<[f64; 3]>,
    /// Angle about the east axis.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    omega: Option<f64>,
    /// Angle about the north axis.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    phi: Option<f64>,
    /// Angle about the up axis, counter-clockwise: minus the heading.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    kappa: Option<f64>,
    /// Standard deviation of omega and of phi.
    #[arg(long, value_name = "DEG")]
    sigma_tilt: Option<f64>,
    /// Standard deviation of kappa.
    #[arg(long, value_name = "DEG")]
    sigma_kappa: Option<f64>,
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|error| format!("{text:?}: {error}; give three numbers like 16.63,52.77,150"))?;
    numbers.try_into().map_err(|_| format!("{text:?} is not three numbers like 16.63,52.77,150"))
}

impl ApproximationFlags {
    fn request(&self) -> anyhow::Result<ApproximationRequest> {
        let mut request = match &self.approximation {
            Some(file) => read_json(file)?,
            None => ApproximationRequest::default(),
        };
        let vertical = self.position_undulation_m.map(|geoid_undulation_m| Vertical { geoid_undulation_m });
        if let Some(coordinates) = self.position {
            request.position = Some(Position { crs: self.position_crs.clone(), coordinates, vertical });
        } else if request.position.is_none() {
            request.vertical = vertical.or(request.vertical);
        }
        request.sigma_position_m = self.sigma_position_m.or(request.sigma_position_m);
        request.omega_deg = self.omega.or(request.omega_deg);
        request.phi_deg = self.phi.or(request.phi_deg);
        request.kappa_deg = self.kappa.or(request.kappa_deg);
        request.sigma_tilt_deg = self.sigma_tilt.or(request.sigma_tilt_deg);
        request.sigma_kappa_deg = self.sigma_kappa.or(request.sigma_kappa_deg);
        Ok(request)
    }
}

/// Reads JSON as strictly as the API does.
pub(super) fn read_json<T: serde::de::DeserializeOwned>(file: &Path) -> anyhow::Result<T> {
    let name = || file.display().to_string();
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
    parse_json(&text).with_context(name)
}

/// The camera of a JSON file; the uploaded templates that it refers to come from the data folder.
pub(super) async fn camera_of_file(file: &Path, store: Option<&Store>) -> anyhow::Result<CameraModel> {
    let name = || file.display().to_string();
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
    let request = match CameraRequest::parse(&text).with_context(name)? {
        CameraRequest::Digital(request) => return Ok(CameraModel::Digital(request.camera().with_context(name)?)),
        CameraRequest::Film(request) => request,
    };
    let templates = match store {
        Some(store) => uploaded_templates(store, &request.uploaded_templates()).await?.marks,
        None => Templates::new(),
    };
    let definition = request.definition(&templates).map_err(|faults| Problem::of_faults(&faults)).with_context(name)?;
    Ok(CameraModel::Film(Arc::new(definition.camera(&templates)?)))
}

impl Orient {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "warn".to_owned());
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let limits = configuration.image_limits();
        // a data folder is only made use of, never made
        let with_files = self.control.is_some() || self.scenes.is_some();
        let store = match with_files {
            false => Some(open_existing(&configuration.data).await?),
            true if configuration.database_url.is_some() || configuration.data.join("gable.db").exists() => {
                Some(Store::connect(&configuration.place()).await?)
            }
            true => None,
        };
        let camera = self.camera(store.as_ref()).await?;
        let camera_size_px = camera.image_size_px();
        let probe = imagery::probe(&self.image, &limits).with_context(|| self.image.display().to_string())?;
        let mut prepared = self.request()?.prepare(camera_size_px, &ImageFacts::from(&probe)).map_err(|faults| {
            let lines: Vec<_> = faults.iter().map(|fault| format!("{}: {}", fault.pointer, fault.detail)).collect();
            anyhow::anyhow!(lines.join("\n       "))
        })?;
        prepared.policy = prepared.policy.or(&configuration.policy());
        let decides = match &store {
            Some(store) => ActiveClassifier::default().get(store).await?,
            None => shipped_classifier()?,
        };
        let mut work = prepared.work(camera, &decides)?;
        let pool = match &store {
            Some(store) if !with_files => store.database().clone(),
            _ => self.control_of_files(&Bounds::of(&configuration)).await?,
        };
        let near = ControlNear::find(&pool, &work, Reach::default(), &prepared.wanted()).await?;
        work.check = near.check();
        let (path, bar) = (self.image.clone(), Bar::new());
        let oriented = tokio::task::spawn_blocking(move || {
            let orient: Pipeline = Arc::new(pipeline::orient);
            let near = near.read(&work.frame, &std::env::temp_dir(), &limits);
            let oriented = jobs::oriented(&orient, &path, &limits, &near, (&prepared, &work), &bar);
            bar.0.finish_and_clear();
            oriented.map(|oriented| (oriented.result, oriented.drawing, limits))
        });
        let (result, drawing, limits) = oriented.await?.with_context(|| self.image.display().to_string())?;
        if let Some(file) = &self.overlay {
            draw(&self.image, &limits, &drawing, self.overlay_width, file)?;
        }
        self.show(&result)
    }

    fn request(&self) -> anyhow::Result<OrientationRequest> {
        Ok(OrientationRequest {
            image: self.image.display().to_string(),
            camera: self.camera.clone(),
            approximation: self.approximation.request()?,
            tolerance_gsd: self.tolerance_gsd,
            tolerance_m: self.tolerance_m,
            costs: self.costs.map(CostsRequest::from),
            caution: self.caution,
            threshold: self.threshold,
            control: self.control_choice,
            control_sets: (!self.control_sets.is_empty()).then(|| self.control_sets.clone()),
            date: self.date,
            interior_orientation: self.scan.request(),
            output_crs: self.output_crs.clone(),
            priority: None,
            webhook: None,
        })
    }

    async fn camera(&self, store: Option<&Store>) -> anyhow::Result<CameraModel> {
        let file = Path::new(&self.camera);
        if file.is_file() {
            return camera_of_file(file, store).await;
        }
        let known = match store {
            Some(store) => camera_model(store, &self.camera).await?,
            None => None,
        };
        known.with_context(|| {
            format!("--camera {}: there is no such file, and no such camera in the data folder", self.camera)
        })
    }

    async fn control_of_files(&self, bounds: &Bounds) -> anyhow::Result<Database> {
        let pool = Database::in_memory().await?;
        if let Some(file) = &self.control {
            self.add_buildings(&pool, file).await?;
        }
        if let Some(file) = &self.scenes {
            let list = SceneList::read(file)?;
            let report = scenes::import(&pool, &list, bounds, Mode::Upsert, |_| {}).await?;
            warn_of_rejections(file, "scene", &report.rejected);
        }
        Ok(pool)
    }

    async fn add_buildings(&self, pool: &Database, file: &Path) -> anyhow::Result<()> {
        let report = import::import_for_one(pool, file, self.crs.clone(), self.geoid_undulation_m).await?;
        warn_of_rejections(file, "feature", &report.rejected);
        Ok(())
    }

    fn show(&self, result: &OrientationResult) -> anyhow::Result<()> {
        if self.json || !std::io::stdout().is_terminal() {
            let answer = serde_json::json!({"status": "succeeded", "error": null, "result": result});
            return print(&serde_json::to_string_pretty(&answer)?);
        }
        let colours = std::env::var_os("NO_COLOR").is_none();
        print(&summary::summary(result, colours))
    }
}

fn warn_of_rejections(file: &Path, thing: &str, rejected: &[Rejection]) {
    for Rejection { index, name, detail } in rejected {
        let name = name.as_deref().unwrap_or("without a name");
        tracing::warn!("{}: {thing} {index} ({name}) is left out: {detail}", file.display());
    }
}

async fn open_existing(folder: &Path) -> anyhow::Result<Store> {
    if !folder.join("gable.db").exists() {
        bail!("there is no data folder {}; give --data FOLDER, --control FILE or --scenes FILE", folder.display());
    }
    Ok(Store::open(folder).await?)
}

fn draw(image: &Path, limits: &Limits, drawing: &Drawing, widest_px: u32, file: &Path) -> anyhow::Result<()> {
    let extension = file.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    let format = match extension.as_str() {
        "png" => Format::Png,
        "jpg" | "jpeg" => Format::Jpeg,
        _ => bail!("--overlay {}: the name must end with .png or .jpg", file.display()),
    };
    let picture = ImageFile::open(image, limits)?;
    let bytes = overlay::overlay(&picture, drawing, widest_px.max(16), format)?;
    std::fs::write(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// The progress of the pipeline, on the terminal's error output.
struct Bar(ProgressBar);

const STEPS: u64 = 1000;

impl Bar {
    fn new() -> Self {
        let bar = ProgressBar::new(STEPS);
        let style = ProgressStyle::with_template("{msg:10} {wide_bar} {elapsed}");
        Self(style.map_or(bar.clone(), |style| bar.with_style(style)))
    }
}

impl Observer for Bar {
    fn progress(&self, stage: Stage, fraction: f64) {
        self.0.set_message(stage.name());
        self.0.set_position((fraction * STEPS as f64) as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_are_three_numbers() {
        assert_eq!(triple("-98.09, 30.16,317.3"), Ok([-98.09, 30.16, 317.3]));
        assert!(triple("1,2").is_err());
        assert!(triple("1,2,three").is_err());
    }
}
