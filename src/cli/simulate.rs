//! `gable simulate`: scenes as files, or the study of thousands that are never written.

mod film;
mod likeness;
mod lines;
mod pole;
mod rows;
mod study;

use std::path::{Path, PathBuf};

use crate::simulation::film::{FilmScene, SCAN_FILE};
use crate::simulation::{PHOTOGRAPH_FILE, Scene, SceneSettings};
use crate::study::Mixture;
use anyhow::{Context as _, bail};
use clap::Args;
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

  gable simulate --mixture good --images 17000 --out study-good
      Orients 17000 images that are drawn from the mixture `good` and rendered only where they are read, on all cores.
      Leaves rows.csv (a row an image), table.md and errors.svg in the folder. Stopped and called again, it goes on.

  gable simulate --mixture poor --images 40 --likeness bench/boruszyn_wire
      Measures what real photographs and those of the mixture have in common, side by side.

  gable simulate --mixture hostile --images 10000 --out study-hostile
      Tries to get a wrong orientation accepted: control on a line, in a corner, just enough or false, repeated houses.

  gable simulate --film --seed 9
      Writes a scene that was photographed on film: the photograph is a scan with fiducial marks (photograph.tif), turned or
      mirrored or a negative by seed, and camera.json that of a film camera.

  gable simulate --pole
      Writes a fish-eye picture from a pole with its camera and the measured targets of a template (pole.png, fisheye.json,
      target.json), and prints the command that makes a control scene of it.

  gable simulate --mixture film --images 10000 --out study-film
      Brings 10000 scans of film to their plates and counts what came out. Leaves scans.csv and table.md in the folder.
      With --corrupt one of four marks of each scan is covered, scratched, missing or moved.

  gable simulate --mixture film --seed 4 --write
      Writes the study's scan 4 as a tiled TIFF of some hundred megapixels with its camera, for `gable interior`.

  gable simulate --mixture poor --seed 17 --write
      Writes the scene of the study's image 17, to look at.

In each folder of a scene, the same for the same seed and settings on every machine:
  photograph.png           the picture
  camera.json              as for POST /cameras
  control_points.geojson   as for POST /control-points
  approximation.json       as in POST /orientations
  truth.json               the true orientation, and which control points are out of date";

/// Write simulated scenes, or study how thousands of them are oriented
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Simulate {
    /// Seed of the first scene; the others have those that follow.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=u64::MAX / 2))]
    seed: u64,
    /// Scenes to write or to study; each is one photograph of a town of its own.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    images: u64,
    /// Folder for the folders of the scenes, or for the study. [default: scenes, or study-MIXTURE]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// JSON file with what the scenes are drawn from, where it differs from the default.
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Draw the scenes from this mixture, orient them, and count what came out instead of writing them.
    #[arg(long, value_enum, conflicts_with = "settings")]
    mixture: Option<MixtureName>,
    /// Instead measure how like the mixture is to a dataset of real photographs.
    #[arg(long, value_name = "FOLDER", requires = "mixture", conflicts_with = "out")]
    likeness: Option<PathBuf>,
    /// Write scenes that were photographed on film, and the film scanned.
    #[arg(long, conflicts_with_all = ["mixture", "settings"])]
    film: bool,
    /// Write pictures of a yard that were taken from a pole by a fish-eye lens, for `gable scene rectify`.
    #[arg(long, conflicts_with_all = ["mixture", "settings", "film"])]
    pole: bool,
    /// With the mixture `film`: spoil one of the marks of each scan, of cameras with four.
    #[arg(long, requires = "mixture", conflicts_with_all = ["likeness", "write"])]
    corrupt: bool,
    /// With the mixture `film` and --write: compress the scans by Deflate.
    #[arg(long, requires = "write")]
    deflate: bool,
    /// Instead write the scenes of the mixture.
    #[arg(long, requires = "mixture", conflicts_with = "likeness")]
    write: bool,
}

/// The mixtures of `crate::study`, for the command line.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum MixtureName {
    /// Good images with enough control, not free of errors: the paper's area I.
    Good,
    /// Bad images with little and bad control: its area II.
    Poor,
    /// From the best to the hopeless, to train classifiers with.
    Wide,
    /// Control that invites a wrong answer: nothing wrong may be accepted.
    Hostile,
    /// Scans of film, for their interior orientation alone.
    Film,
}

impl MixtureName {
    /// The mixture of images with control; `None` for scans of film.
    fn of_images(self) -> Option<Mixture> {
        match self {
            Self::Good => Some(Mixture::Good),
            Self::Poor => Some(Mixture::Poor),
            Self::Wide => Some(Mixture::Wide),
            Self::Hostile => Some(Mixture::Hostile),
            Self::Film => None,
        }
    }
}

impl Simulate {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        tokio::task::spawn_blocking(move || self.obey()).await?
    }

    fn obey(&self) -> anyhow::Result<()> {
        let mut seeds = self.seed..self.seed + self.images;
        if self.pole {
            return seeds.try_for_each(|seed| pole::write(seed, &self.folder(seed)));
        }
        if matches!(self.mixture, Some(MixtureName::Film)) {
            if self.likeness.is_some() {
                bail!("the mixture `film` has no likeness to photographs of digital cameras");
            }
            if self.write {
                return seeds.into_iter().try_for_each(|seed| film::write(seed, self.deflate, &self.folder(seed)));
            }
            let folder = self.out.clone().unwrap_or_else(|| "study-film".into());
            return film::study(seeds, self.corrupt, &folder);
        }
        match (self.mixture.and_then(MixtureName::of_images), &self.likeness) {
            (Some(mixture), Some(dataset)) => likeness::compare(mixture, seeds, dataset),
            (Some(mixture), None) if !self.write => {
                let folder = self.out.clone().unwrap_or_else(|| format!("study-{}", mixture.name()).into());
                study::study(mixture, seeds, &folder)
            }
            _ => self.write(seeds),
        }
    }

    fn write(&self, seeds: std::ops::Range<u64>) -> anyhow::Result<()> {
        let given: SceneSettings = match &self.settings {
            Some(file) => read_json(file)?,
            None => SceneSettings::default(),
        };
        let bar = bar(self.images);
        for seed in seeds.clone() {
            bar.set_message(format!("seed {seed}"));
            let folder = self.folder(seed);
            // nothing is made before the settings have proved to make sense
            let drawn = match self.mixture.and_then(MixtureName::of_images) {
                Some(mixture) => Drawn::Digital(Box::new(mixture.scene(seed)?)),
                None if self.film => {
                    Drawn::Film(Box::new(FilmScene::draw(seed, &given, &FilmScene::default_scan(seed))?))
                }
                None => Drawn::Digital(Box::new(Scene::draw(seed, &given)?)),
            };
            std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
            let (scene, photograph) = drawn.written(&folder)?;
            bar.inc(1);
            let in_view = scene.in_view().count();
            let line = format!("{}: {in_view} of {} control points in view", folder.display(), scene.control.len());
            bar.suspend(|| print(&line))?;
            if seed + 1 == seeds.end {
                bar.finish_and_clear();
                print(&format!("\nOrient it with\n  {}", orient_command(&folder, photograph, &scene.crs())))?;
            }
        }
        Ok(())
    }

    fn folder(&self, seed: u64) -> PathBuf {
        self.out.as_deref().unwrap_or(Path::new("scenes")).join(format!("seed-{seed}"))
    }
}

/// A scene with its camera.
enum Drawn {
    Digital(Box<Scene>),
    Film(Box<FilmScene>),
}

impl Drawn {
    /// Writes it; the scene, and the name of its photograph.
    fn written(self, folder: &Path) -> anyhow::Result<(Scene, &'static str)> {
        match self {
            Self::Digital(scene) => scene.write(folder).map(|()| (*scene, PHOTOGRAPH_FILE)),
            Self::Film(film) => film.write(folder).map(|()| (film.scene, SCAN_FILE)),
        }
        .map_err(anyhow::Error::from)
    }
}

fn bar(scenes: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    let bar = ProgressBar::new(scenes);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

/// The command that orients a scene, for a shell.
fn orient_command(folder: &Path, photograph: &str, crs: &str) -> String {
    let file = |name: &str| quoted(&folder.join(name).to_string_lossy());
    format!(
        "gable orient {} --camera {} --control {} --crs {} --approximation {} --overlay {}",
        file(photograph),
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
