//! `gable demo`.

mod client;
mod comparison;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::http::serve::stop_on_signals;
use crate::service::{Service, Work};
use crate::simulation::{Scene, SceneSettings};
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;
use indicatif::ProgressBar;

use super::{Settings, print};
use client::{Answer, Client};
use comparison::Comparison;

const EXAMPLES: &str = "\
Examples:
  gable demo
      Simulates a town and its aerial photograph, orients it, compares with the truth, and serves on \
      http://127.0.0.1:8080 until Ctrl-C, so that you can look around.

  gable demo --seed 7 --listen 127.0.0.1:9000 --data /tmp/town-7
      Another town at another address. The folder is kept: `gable serve --data /tmp/town-7` goes on from there.

  gable demo --exit && echo works
      Ends when it has told everything. The status is 0 only if the orientation is right and its verdict is green.";

/// Orient a simulated photograph whose true orientation is known
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Demo {
    /// What town, photograph and errors are drawn from; the same seed always gives the same.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// End when all is told; with status 0 if the orientation is right and green, else 1.
    #[arg(long)]
    exit: bool,
    /// Address and port of the service. [default: 127.0.0.1:8080; with --exit a free port]
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: Option<SocketAddr>,
    /// New data folder, to be kept. [default: a temporary one]
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
}

impl Demo {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let temporary = tempfile::Builder::new().prefix("gable-demo-").tempdir().context("no temporary folder")?;
        let folder = self.data.clone().unwrap_or_else(|| temporary.path().to_owned());
        if folder.join("gable.db").exists() {
            bail!("--data {}: there is a database already; the demonstration begins with a new one", folder.display());
        }
        // what the log says is told here in another way
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "error".to_owned());
        let free_port = self.exit.then(|| SocketAddr::from(([127, 0, 0, 1], 0)));
        let listen = self.listen.or(free_port).map(|address| address.to_string());
        let settings = Settings { data: Some(folder.clone()), ..Settings::default() };
        let configuration = settings.gather(&[("log", quiet), ("listen", listen)])?;
        let stop = stop_on_signals().context("signals cannot be caught")?;
        let told = tokio::select! {
            told = self.photograph() => told,
            () = stop.cancelled() => bail!("interrupted"),
        };
        let (scene, photograph) = told?;

        let step = Step::begin("beginning a service");
        let service = Service::begin(Store::open(&folder).await?, configuration).await?;
        let address = format!("http://{}", service.address());
        step.end(&format!("began a service on {address} with a new database in {}", folder.display()))?;
        let client = Client::of(&service)?;
        let serving = tokio::spawn(service.run(Work::Here, stop.clone()));
        let told = tokio::select! {
            told = self.orient(&scene, photograph, &client) => told,
            () = stop.cancelled() => Err(anyhow::anyhow!("interrupted")),
        };
        if let (Ok((_, id)), false) = (&told, self.exit) {
            print(&format!(
                "\nServing until Ctrl-C. Look at\n  {address}/orientations/{id}\n  \
                 {address}/api/v1/orientations/{id}\n  {address}/docs/"
            ))?;
            stop.cancelled().await;
        }
        stop.cancel();
        serving.await.context("the service has failed")?;
        let (comparison, _) = told?;
        if self.exit { comparison.accepted() } else { Ok(()) }
    }

    async fn photograph(&self) -> anyhow::Result<(Scene, Vec<u8>)> {
        let (step, seed) = (Step::begin("drawing a town"), self.seed);
        let scene = Scene::draw(seed, &SceneSettings::default())?;
        let outdated = scene.control.iter().filter(|point| point.fault.is_some()).count();
        step.end(&format!(
            "drew a town from the seed {seed}; {} of its {} buildings are control points, {outdated} of them out of date",
            scene.control.len(),
            scene.town.buildings.len(),
        ))?;
        let step = Step::begin("taking its photograph");
        let taken = tokio::task::spawn_blocking(move || scene.render().png().map(|file| (scene, file))).await??;
        let [width_px, height_px] = [taken.0.camera.width_px, taken.0.camera.height_px];
        let gsd_m = taken.0.ground_sample_distance_m();
        step.end(&format!("took its photograph: {width_px} x {height_px} px, {gsd_m:.3} m each on the ground"))?;
        Ok(taken)
    }

    /// Orients the photograph as any client of the service would; the comparison and the orientation's id.
    async fn orient(
        &self,
        scene: &Scene,
        photograph: Vec<u8>,
        client: &Client,
    ) -> anyhow::Result<(Comparison, uuid::Uuid)> {
        let step = Step::begin("POST /cameras");
        let camera = client.add_camera(scene).await?;
        step.end(&format!("POST /cameras: {camera}"))?;
        let step = Step::begin("POST /control-points");
        let imported = client.import_control_points(scene).await?;
        step.end(&format!("POST /control-points: {imported} imported"))?;
        let (step, megabytes) = (Step::begin("POST /images"), photograph.len() as f64 / 1e6);
        let image = client.upload(photograph).await?;
        step.end(&format!("POST /images: {megabytes:.1} MB"))?;
        let step = Step::begin("POST /orientations");
        let Answer { id, result, .. } = client.orient(scene, &camera, &image).await?;
        step.end("POST /orientations, with an approximation that errs by some metres and degrees")?;
        let step = Step::begin("GET /orientations/…/overlay");
        let overlay = write_overlay(self.seed, self.data.as_deref(), &client.overlay(id).await?)?;
        step.end(&format!("GET /orientations/…/overlay: {}", overlay.display()))?;
        let comparison = Comparison::new(scene, result)?;
        print(&format!("\n{}", comparison.text(scene)))?;
        Ok((comparison, id))
    }
}

/// Beside the database if that is kept, else where the system has its temporary files; it stays there.
fn write_overlay(seed: u64, data: Option<&Path>, picture: &[u8]) -> anyhow::Result<PathBuf> {
    let path = match data {
        Some(folder) => folder.join("overlay.jpg"),
        None => {
            let name = format!("gable-demo-{seed}-");
            tempfile::Builder::new().prefix(&name).suffix(".jpg").tempfile()?.into_temp_path().keep()?
        }
    };
    std::fs::write(&path, picture).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

/// Something that is being done, with the time it takes.
struct Step {
    began: Instant,
    bar: ProgressBar,
}

impl Step {
    fn begin(doing: &'static str) -> Self {
        let bar = ProgressBar::new_spinner().with_message(doing);
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { began: Instant::now(), bar }
    }

    fn end(self, done: &str) -> anyhow::Result<()> {
        self.bar.finish_and_clear();
        print(&format!("{:6.2} s  {done}", self.began.elapsed().as_secs_f64()))
    }
}
