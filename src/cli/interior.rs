//! `gable interior`.

mod summary;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::imagery::Limits;
use crate::interior::FilmCamera;
use crate::jobs::camera_model::camera_model;
use crate::jobs::interior::{self, InteriorError, InteriorRequest, PreparedInterior};
use crate::jobs::request::{CameraModel, ScanRequest};
use crate::report::InteriorResult;
use crate::report::interior::residual_plot;
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;

use super::orient::camera_of_file;
use super::scan::ScanFlags;
use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable interior scan.tif --camera rc30.json --residuals residuals.svg --close-ups marks
      How the film lies in one scan, without any service, with a drawing of the residuals and a picture of each mark. On \
      a terminal the answer is a summary; elsewhere, and with --json, it is the API's JSON.

  gable simulate --film --seed 9 && cd scenes/seed-9 && gable interior photograph.tif --camera camera.json
      The same of a simulated scan.

  gable interior scan.tif --camera rc30 --data /srv/gable --pixel-size-um 14
      With a camera of a data folder, and pixels of 14 micrometres whatever the file says of its resolution.

  gable interior diapositive.tif --camera rmk.json --reading wrong --quarter-turns 1 --json | jq .result.transformation
      Of a scan that is known to be mirrored and turned, where nothing on the film tells.

The camera is a JSON file as for `POST /cameras`, with principal_distance_mm and fiducials.";

/// Find the interior orientation of a scanned film
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Interior {
    /// The scan: TIFF, JPEG or PNG.
    #[arg(value_name = "SCAN")]
    scan_file: PathBuf,
    /// The film camera: a JSON file as for `POST /cameras`; with --data also its id or name there.
    #[arg(long, value_name = "FILE|NAME")]
    camera: String,
    /// Draw the residuals of the marks to this SVG file.
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
    /// Put a picture of each mark into this folder: blue cross where it was found, orange where it should be.
    #[arg(long, value_name = "FOLDER")]
    close_ups: Option<PathBuf>,
    /// Print the API's JSON, also on a terminal.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    scan: ScanFlags,
}

impl Interior {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "warn".to_owned());
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let limits = configuration.image_limits();
        // a data folder is only made use of, never made
        let store = match configuration.database_url.is_some() || configuration.data.join("gable.db").exists() {
            true => Some(Store::connect(&configuration.place()).await?),
            false => None,
        };
        let camera = film_camera(&self.camera, store.as_ref()).await?;
        tokio::task::spawn_blocking(move || self.work(&camera, &limits)).await?
    }

    fn work(&self, camera: &FilmCamera, limits: &Limits) -> anyhow::Result<()> {
        let named = |error: InteriorError| match error {
            InteriorError::Request(_) => anyhow::Error::from(error),
            error => anyhow::Error::from(error).context(self.scan_file.display().to_string()),
        };
        let (prepared, result) = interior::oriented(&self.scan_file, limits, camera, &self.request()).map_err(named)?;
        if let Some(file) = &self.residuals {
            let drawing = residual_plot(&result);
            std::fs::write(file, drawing).with_context(|| format!("cannot write {}", file.display()))?;
        }
        if let Some(folder) = &self.close_ups {
            self.close_ups(folder, limits, &result)
                .map_err(|error| error.context(self.scan_file.display().to_string()))?;
        }
        self.show(&prepared, &result)
    }

    fn request(&self) -> InteriorRequest {
        let ScanRequest { pixel_size_um, transformation, reading, quarter_turns } =
            self.scan.request().unwrap_or_default();
        let (image, camera) = (self.scan_file.display().to_string(), self.camera.clone());
        InteriorRequest { image, camera, pixel_size_um, transformation, reading, quarter_turns }
    }

    /// A file for each mark of which is known where it is.
    fn close_ups(&self, folder: &Path, limits: &Limits, result: &InteriorResult) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        for (mark, number) in result.marks.iter().zip(1..) {
            let Some(picture) = interior::close_up(&self.scan_file, limits, result, mark)? else { continue };
            let file = folder.join(file_name(&mark.name, number));
            std::fs::write(&file, picture).with_context(|| format!("cannot write {}", file.display()))?;
        }
        Ok(())
    }

    fn show(&self, prepared: &PreparedInterior, result: &InteriorResult) -> anyhow::Result<()> {
        if self.json || !std::io::stdout().is_terminal() {
            let answer = serde_json::json!({
                "request": prepared, "verdict": result.diagnosis.verdict, "result": result,
            });
            return print(&serde_json::to_string_pretty(&answer)?);
        }
        let colours = std::env::var_os("NO_COLOR").is_none();
        print(&summary::summary(prepared, result, colours))
    }
}

/// Names of marks come from calibration reports: one that is no plain name is replaced by the mark's number.
fn file_name(name: &str, number: usize) -> String {
    let plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if plain { format!("{name}.png") } else { format!("mark-{number}.png") }
}

async fn film_camera(camera: &str, store: Option<&Store>) -> anyhow::Result<Arc<FilmCamera>> {
    let file = Path::new(camera);
    let model = match store {
        _ if file.is_file() => Some(camera_of_file(file, store).await?),
        Some(store) => camera_model(store, camera).await?,
        None => None,
    };
    match model {
        Some(CameraModel::Film(camera)) => Ok(camera),
        Some(CameraModel::Digital(_)) => bail!(
            "--camera {camera}: this is a digital camera, whose interior orientation is known; a scan needs a film camera, \
             with principal_distance_mm and fiducials"
        ),
        None => bail!("--camera {camera}: there is no such file, and no such camera in the data folder"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_s_name_never_leads_out_of_the_folder() {
        assert_eq!(file_name("FID-1", 1), "FID-1.png");
        for odd in ["", "../x", "a/b", "Ä", "."] {
            assert_eq!(file_name(odd, 3), "mark-3.png");
        }
    }
}
