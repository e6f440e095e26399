//! `gable simulate`.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;
use gable::simulation::{PHOTOGRAPH_FILE, Scene, SceneSettings};
use indicatif::{ProgressBar, ProgressStyle};

use super::orient::read_json;
use super::print;

const EXAMPLES: &str = "\
Examples:
  gable simulate
      Writes the scene that `gable demo` shows to ./scenes/seed-1, and prints the command that orients it.

  gable simulate --seed 100 --images 50 --out /tmp/towns
      Writes 50 scenes to /tmp/towns/seed-100, seed-101, …

  echo '{\"flight\": {\"height_m\": 400}, \"control\": {\"share\": 0.2}}' > high.json
  gable simulate --settings high.json
      What the file leaves out is as in the demonstration. All settings of a scene are in its truth.json.

In each folder, the same for the same seed and settings on every machine:
  photograph.png           the picture
  camera.json              as for POST /cameras
  control_points.geojson   as for POST /control-points
  approximation.json       as in POST /orientations
  truth.json               the true orientation, and which control points are out of date";

/// Write simulated scenes: photograph, control points, approximate and true orientation
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Simulate {
    /// Seed of the first scene; the others have those that follow.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Scenes to write; each is one photograph of a town of its own.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    images: u64,
    /// Folder for the folders of the scenes.
    #[arg(long, value_name = "FOLDER", default_value = "scenes")]
    out: PathBuf,
    /// JSON file with what the scenes are drawn from, where it differs from the default.
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
}

impl Simulate {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        tokio::task::spawn_blocking(move || self.write()).await?
    }

    fn write(&self) -> anyhow::Result<()> {
        let settings: SceneSettings = match &self.settings {
            Some(file) => read_json(file)?,
            None => SceneSettings::default(),
        };
        let bar = bar(self.images);
        for offset in 0..self.images {
            let seed = self.seed.wrapping_add(offset);
            bar.set_message(format!("seed {seed}"));
            let folder = self.folder(seed);
            let scene = Scene::draw(seed, &settings)?;
            std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
            scene.write(&folder)?;
            bar.inc(1);
            let in_view = scene.in_view().count();
            let line = format!("{}: {in_view} of {} control points in view", folder.display(), scene.control.len());
            bar.suspend(|| print(&line))?;
            if offset + 1 == self.images {
                bar.finish_and_clear();
                print(&format!("\nOrient it with\n  {}", orient_command(&folder, &scene.crs())))?;
            }
        }
        Ok(())
    }

    fn folder(&self, seed: u64) -> PathBuf {
        self.out.join(format!("seed-{seed}"))
    }
}

fn bar(scenes: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    let bar = ProgressBar::new(scenes);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

/// The command that orients a scene, for a shell.
fn orient_command(folder: &Path, crs: &str) -> String {
    let file = |name: &str| quoted(&folder.join(name).to_string_lossy());
    format!(
        "gable orient {} --camera {} --control {} --crs {} --approximation {} --overlay {}",
        file(PHOTOGRAPH_FILE),
        file("camera.json"),
        file("control_points.geojson"),
        quoted(crs),
        file("approximation.json"),
        file("overlay.png"),
    )
}

/// One word for a shell, in quotes only where it needs them.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:".contains(c);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_every_word_as_it_is() {
        for word in ["plain/file-1.png", "a b", "it's", "$HOME", "+proj=x +y=1", "\"`\\"] {
            let output = std::process::Command::new("sh").args(["-c", &format!("printf %s {}", quoted(word))]).output();
            assert_eq!(String::from_utf8(output.unwrap().stdout).unwrap(), word);
        }
        assert_eq!(quoted("plain/file-1.png"), "plain/file-1.png");
    }
}
