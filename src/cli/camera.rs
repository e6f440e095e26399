//! `gable camera`.

use std::path::PathBuf;

use crate::cameras::conversion::WARN_PX;
use crate::cameras::{CameraFileError, Conversion, Converted, FORMATS, Format, Given, Residual, USGS, usgs};
use crate::geometry::Brown;
use crate::jobs::film_camera::FilmCameraRequest;
use anyhow::Context as _;
use clap::{Args, Subcommand};
use serde_json::json;

use super::print;

const EXAMPLES: &str = "\
Examples:
  gable camera convert calibration.yaml --name canon-sx260 > camera.json
      OpenCV's calibration as the JSON that `POST /cameras` and `gable orient --camera` take.

  gable camera convert cameras.txt --camera 2 --report
      One of COLMAP's cameras, and after it how far the two models are apart over the image.

  gable camera convert survey_pix4d_calibrated_internal_camera_parameters.cam --image-size-px 4608,3456
      Where the file does not tell the size of the images.";

/// Convert calibrations of other programs
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CameraCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Convert(Convert),
}

/// Convert a calibration of another program to a camera as `POST /cameras` takes it
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
struct Convert {
    /// The calibration.
    file: PathBuf,
    /// The program that wrote it: opencv, colmap, opensfm, metashape, pix4d, australis, inpho; or usgs, the text of a report of a
    /// film camera. [default: as it looks]
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    format: Option<Wanted>,
    /// Name of the camera. [default: as the file calls it, else the name of the file]
    #[arg(long)]
    name: Option<String>,
    /// Which of the cameras in the file.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Columns and rows of the images, where the file does not tell.
    #[arg(long, value_name = "W,H", value_parser = size)]
    image_size_px: Option<[u32; 2]>,
    /// Side of a pixel, where the file does not tell.
    #[arg(long, value_name = "MM")]
    pixel_size_mm: Option<f64>,
    /// With --format usgs: what the fiducial marks look like, such as leica_rc30.
    #[arg(long, value_name = "NAME")]
    template: Option<String>,
    /// Print after the camera what is left between the two models over the image.
    #[arg(long)]
    report: bool,
}

impl CameraCommand {
    pub(crate) fn run(self) -> anyhow::Result<()> {
        let Action::Convert(command) = self.action;
        command.run()
    }
}

impl Convert {
    fn run(self) -> anyhow::Result<()> {
        let called = self.file.display().to_string();
        let text = std::fs::read(&self.file).with_context(|| format!("cannot read {called}"))?;
        let text = String::from_utf8_lossy(&text);
        let format = match self.format.or_else(|| Format::detect(&text).map(Wanted::Digital)) {
            Some(Wanted::Digital(format)) => format,
            Some(Wanted::Film) => return self.film(&text).context(called),
            None => return Err(CameraFileError::UnknownFormat).context(called),
        };
        let given = Given {
            text: &text,
            camera: self.camera.as_deref(),
            image_size_px: self.image_size_px,
            pixel_size_mm: self.pixel_size_mm,
        };
        let Converted { name, conversion, warnings } = format.read(&given).with_context(|| called.clone())?;
        for warning in warnings {
            eprintln!("warning: {warning}");
        }
        if conversion.max_px > WARN_PX {
            eprintln!("warning: the camera is up to {:.2} px from the calibration", conversion.max_px);
        }
        let of_file = self.file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name = self.name.or(name).or(of_file).unwrap_or_default();
        print(&described(&name, &conversion)?)?;
        if self.report { report(format, &conversion) } else { Ok(()) }
    }
}

/// A format of digital cameras, or the reports of film cameras.
#[derive(Debug, Clone, Copy)]
enum Wanted {
    Digital(Format),
    Film,
}

impl Convert {
    fn film(self, text: &str) -> anyhow::Result<()> {
        let report = usgs::read(text)?;
        let template = self.template.context("the report does not tell what its marks look like: give --template")?;
        let name =
            self.name.or_else(|| report.name.clone()).context("the report does not name its camera: give --name")?;
        let request = FilmCameraRequest::of_report(name, &report, &template);
        print(&serde_json::to_string_pretty(&request)?)
    }
}

/// The camera as `POST /cameras` takes it.
fn described(name: &str, conversion: &Conversion) -> anyhow::Result<String> {
    let camera = &conversion.camera;
    let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = camera.distortion().copied().unwrap_or_default();
    let principal_point = camera.principal_point_px();
    let body = json!({
        "name": name,
        "image_size_px": [camera.width_px, camera.height_px],
        "principal_distance_px": camera.principal_distance_px,
        "principal_point_px": [principal_point.x, principal_point.y],
        "distortion": {"model": "brown", "k1": k1, "k2": k2, "k3": k3, "p1": p1, "p2": p2, "b1_px": b1_px, "b2_px": b2_px},
    });
    Ok(serde_json::to_string_pretty(&body)?)
}

fn report(format: Format, conversion: &Conversion) -> anyhow::Result<()> {
    let how = if conversion.exact { "the same model" } else { "fitted over the image" };
    print(&format!("\n{format}: {how}; residuals up to {:.4} px, rms {:.4} px", conversion.max_px, conversion.rms_px))?;
    print(&format!("{:>10} {:>10} {:>9} {:>9}", "x px", "y px", "dx px", "dy px"))?;
    for Residual { position_px: [x, y], residual_px: [dx, dy] } in &conversion.residuals {
        print(&format!("{x:>10.1} {y:>10.1} {dx:>9.4} {dy:>9.4}"))?;
    }
    Ok(())
}

fn format(text: &str) -> Result<Wanted, String> {
    if text.eq_ignore_ascii_case(USGS) {
        return Ok(Wanted::Film);
    }
    let names = || format!("it must be one of {}, {USGS}", FORMATS.map(|(name, _)| name).join(", "));
    text.parse().map(Wanted::Digital).map_err(|_| names())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once([',', 'x']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    sides.ok_or_else(|| "it must be two numbers, as 4000,3000".to_owned())
}
