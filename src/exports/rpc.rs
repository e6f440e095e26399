//! Rational polynomials as files: `_RPC.TXT`, and GDAL's metadata beside the image.

use std::fmt::Write as _;

use super::local::escaped;
use super::names::{beside, file_name};
use super::{ExportError, File, Photograph, Rational};

const NAMES: [(&str, &str); 5] =
    [("LINE", "pixels"), ("SAMP", "pixels"), ("LAT", "degrees"), ("LONG", "degrees"), ("HEIGHT", "meters")];
const DIGITS: usize = 15;

/// Two files for each photograph; heights are ellipsoidal.
pub(super) fn write(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let mut files = Vec::with_capacity(2 * photographs.len());
    for photograph in photographs {
        let rational = Rational::fitted(photograph)?;
        files.push(File {
            name: beside(&photograph.name, "_RPC.TXT"),
            media_type: "text/plain; charset=utf-8",
            text: text(&rational),
        });
        files.push(File {
            name: format!("{}.aux.xml", file_name(&photograph.name)),
            media_type: "application/xml",
            text: metadata(&rational),
        });
    }
    Ok(files)
}

fn coefficients(rational: &Rational) -> [(&'static str, &[f64; 20]); 4] {
    let Rational { line: [line, line_by], sample: [sample, sample_by], .. } = rational;
    [("LINE_NUM", line), ("LINE_DEN", line_by), ("SAMP_NUM", sample), ("SAMP_DEN", sample_by)]
}

fn text(rational: &Rational) -> String {
    let mut text = String::new();
    for (part, values) in [("OFF", &rational.offset), ("SCALE", &rational.scale)] {
        for ((name, unit), value) in NAMES.iter().zip(values) {
            let _ = writeln!(text, "{name}_{part}: {value:.12} {unit}");
        }
    }
    for (name, values) in coefficients(rational) {
        for (index, value) in values.iter().enumerate() {
            let _ = writeln!(text, "{name}_COEFF_{}: {value:.DIGITS$e}", index + 1);
        }
    }
    text
}

fn metadata(rational: &Rational) -> String {
    let mut text = String::from("<PAMDataset>\n  <Metadata domain=\"RPC\">\n");
    let mut item = |key: &str, value: &str| {
        let _ = writeln!(text, "    <MDI key=\"{key}\">{}</MDI>", escaped(value));
    };
    for (part, values) in [("OFF", &rational.offset), ("SCALE", &rational.scale)] {
        for ((name, _), value) in NAMES.iter().zip(values) {
            item(&format!("{name}_{part}"), &format!("{value:.12}"));
        }
    }
    for (name, values) in coefficients(rational) {
        let values: Vec<String> = values.iter().map(|value| format!("{value:.DIGITS$e}")).collect();
        item(&format!("{name}_COEFF"), &values.join(" "));
    }
    item("ERR_RAND", &format!("{:.6}", rational.residual_rms_px));
    text.push_str("  </Metadata>\n</PAMDataset>\n");
    text
}
