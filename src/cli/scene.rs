//! `gable scene`.

mod cut;
mod files;
mod rectify;

use clap::{Args, Subcommand};

use super::{geoids_of_environment, install_geoids};

const EXAMPLES: &str = "\
Examples:
  gable scene rectify pole.jpg --camera fisheye.json --target target.json --crs EPSG:25832 \\
        --reference 565012.31,5934410.72,45.1 --magnetic --date 2026-05-01 --name church-square --out scenes
      From a picture taken straight down from a pole, with a template whose y arm pointed to magnetic north.

  gable scene cut ortho.tif --at 565012.3,5934410.7 --height-m 45.1 --name crossing-4 --out scenes
      Out of an ortho-photo.

Both leave NAME.png and NAME.json, and print the line that sends them to the service.";

/// Make control scenes: small georeferenced pictures of the ground
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SceneCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Rectify(Box<rectify::Rectify>),
    Cut(Box<cut::Cut>),
}

impl SceneCommand {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        install_geoids(geoids_of_environment()?);
        let work = move || match self.action {
            Action::Rectify(command) => command.run(),
            Action::Cut(command) => command.run(),
        };
        tokio::task::spawn_blocking(work).await?
    }
}
