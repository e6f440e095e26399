//! `gable export`.

use std::path::{Path, PathBuf};

use crate::exports::{self, ExportError, File, Format, Photograph, Target};
use crate::geometry::Crs;
use crate::jobs::camera_model::camera_model;
use crate::jobs::exports::{ExportWanted, Exportable};
use crate::jobs::request::CameraModel;
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;

use super::orient::camera_of_file;
use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable orient DJI_0042.JPG --camera camera.json --control roofs.geojson --crs EPSG:25832 --json > DJI_0042.json
  gable export DJI_0042.json --camera camera.json --image DJI_0042.JPG --format orthority --crs EPSG:25832 --out ortho
      Writes what orthority needs to make an ortho-photo: ortho/exterior.geojson and ortho/interior.yaml.

  gable export *.json --camera camera.json --format all --crs EPSG:25832 --out exported
      Every format in a folder of its own, with the manifest, whose five check points tell whether the software that
      reads it has understood. A photograph is called after its result where nothing else is said.

A service does the same: GET /api/v1/orientations/{id}/export?format=orthority, and /api/v1/blocks/{id}/export.";

/// Write an orientation as the files that other software reads
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Export {
    /// Results of `gable orient --json`, or answers of the API.
    #[arg(required = true, value_name = "RESULT")]
    results: Vec<PathBuf>,
    /// The camera: a JSON file as for `POST /cameras`; with --data also its id or name there.
    #[arg(long, value_name = "FILE|NAME")]
    camera: String,
    /// What the image file is called, by which other software finds it. [default: as the answer says, or as the result]
    #[arg(long, value_name = "NAME")]
    image: Option<String>,
    /// What is written.
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    format: Wanted,
    /// Folder for the files; it is made.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// CRS of formats in a map grid. [default: that of the result, or where that has degrees the UTM zone with the same
    /// heights]
    #[arg(long)]
    crs: Option<Crs>,
    /// Gives heights above the geoid: ellipsoidal height - N.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    geoid_undulation_m: Option<f64>,
    /// Mean height of the ground above the ellipsoid. [default: that of the control that was used]
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    ground_height_m: Option<f64>,
    /// How far the ground reaches above and below that. [default: 5 % of the flying height]
    #[arg(long, value_name = "H")]
    relief_m: Option<f64>,
    /// Side of a pixel of a digital camera, for formats in millimetres. [default: 4]
    #[arg(long, value_name = "UM")]
    pixel_size_um: Option<f64>,
    /// Also what is red, or was rejected by staff.
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    settings: Settings,
}

/// One format, or all.
#[derive(Debug, Clone, Copy)]
enum Wanted {
    One(Format),
    All,
}

fn format(text: &str) -> Result<Wanted, String> {
    if text == "all" {
        return Ok(Wanted::All);
    }
    let known = || format!("give one of {}, all", Format::ALL.map(Format::name).join(", "));
    Format::from_name(text).map(Wanted::One).ok_or_else(known)
}

impl Export {
    /// What orthority needs for one photograph: its result and its name, the camera, where, and into which folder.
    pub(super) fn orthority(
        (result, name): (PathBuf, String),
        camera: String,
        (crs, geoid_undulation_m): (Option<Crs>, Option<f64>),
        out: PathBuf,
        settings: Settings,
    ) -> Self {
        Self {
            results: vec![result],
            camera,
            image: Some(name),
            format: Wanted::One(Format::Orthority),
            out,
            crs,
            geoid_undulation_m,
            ground_height_m: None,
            relief_m: None,
            pixel_size_um: None,
            // an ortho-photo shows whether a doubtful orientation is right
            all: true,
            settings,
        }
    }

    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "warn".to_owned());
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let store = match configuration.database_url.is_some() || configuration.data.join("gable.db").exists() {
            true => Some(Store::connect(&configuration.place()).await?),
            false => None,
        };
        let (camera_name, camera) = self.camera(store.as_ref()).await?;
        let (photographs, target) = self.photographs(&camera_name, &camera)?;
        let formats: Vec<(Format, PathBuf)> = match self.format {
            Wanted::One(format) => vec![(format, self.out.clone())],
            Wanted::All => Format::ALL.map(|format| (format, self.out.join(format.name()))).into(),
        };
        for (format, folder) in formats {
            match exports::write(format, &photographs, &target) {
                Ok(files) => {
                    save(&files, &folder)?;
                    if let Some(residual_px) = exports::residual_max_px(format, &photographs, &target)? {
                        eprintln!("{}: the fit leaves up to {residual_px:.3} px", format.name());
                    }
                }
                // of all formats some may have no place for the camera, or want a better grid
                Err(error @ (ExportError::Camera { .. } | ExportError::PoorFit { .. }))
                    if matches!(self.format, Wanted::All) =>
                {
                    tracing::warn!("{error}");
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    fn photographs(&self, camera_name: &str, camera: &CameraModel) -> anyhow::Result<(Vec<Photograph>, Target)> {
        if self.image.is_some() && self.results.len() > 1 {
            bail!("--image names one photograph, but there are {} results", self.results.len());
        }
        let wanted = ExportWanted {
            crs: self.crs.clone(),
            geoid_undulation_m: self.geoid_undulation_m,
            ground_height_m: self.ground_height_m,
            relief_m: self.relief_m,
            pixel_size_um: self.pixel_size_um,
            all: self.all,
        };
        let (mut photographs, mut target) = (Vec::new(), None);
        for file in &self.results {
            let in_file = || file.display().to_string();
            let text = std::fs::read_to_string(file).with_context(in_file)?;
            let exportable = Exportable::read(&text).with_context(in_file)?;
            let name = self.image.clone().or_else(|| named(&text)).unwrap_or_else(|| stem(file));
            photographs.push(exportable.photograph((&name, camera_name), camera, &wanted).with_context(in_file)?);
            if target.is_none() {
                target = Some(exportable.target(&wanted).with_context(in_file)?);
            }
        }
        Ok((photographs, target.context("there is no result")?))
    }

    async fn camera(&self, store: Option<&Store>) -> anyhow::Result<(String, CameraModel)> {
        let file = Path::new(&self.camera);
        if file.is_file() {
            let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
            let name = serde_json::from_str::<serde_json::Value>(&text)
                .ok()
                .and_then(|camera| camera.get("name")?.as_str().map(str::to_owned));
            return Ok((name.unwrap_or_else(|| stem(file)), camera_of_file(file, store).await?));
        }
        let known = match store {
            Some(store) => camera_model(store, &self.camera).await?,
            None => None,
        };
        let model = known.with_context(|| {
            format!("--camera {}: there is no such file, and no such camera in the data folder", self.camera)
        })?;
        Ok((self.camera.clone(), model))
    }
}

/// What the API's answer says that the image is called.
fn named(text: &str) -> Option<String> {
    serde_json::from_str::<serde_json::Value>(text).ok()?.get("image_name")?.as_str().map(str::to_owned)
}

fn stem(file: &Path) -> String {
    file.file_stem().map_or_else(|| "image".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

fn save(files: &[File], folder: &Path) -> anyhow::Result<()> {
    for file in files {
        let path = folder.join(&file.name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
        }
        std::fs::write(&path, &file.text).with_context(|| format!("cannot write {}", path.display()))?;
        print(&path.display().to_string())?;
    }
    Ok(())
}
