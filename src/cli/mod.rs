//! The command line: one file a command.

mod account;
mod audit;
mod backup;
mod block;
mod camera;
mod classifier;
mod crs;
mod dataset;
mod demo;
mod doctor;
mod evaluate;
mod export;
mod import;
mod interior;
mod key;
mod migrate;
mod openapi;
mod orient;
mod ortho;
mod scan;
mod scene;
mod scenes;
mod serve;
mod sets;
mod simulate;
mod train;
mod webhook;
mod work;
mod worker;

use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use crate::configuration::{Configuration, ConfigurationError, LogFormat};
use crate::geoids::GeoidFolder;
use crate::geometry::geoid;
use crate::service::ServiceError;
use crate::store::Store;
use crate::store::audit::NewEntry;
use anyhow::Context as _;
use clap::{Args, Parser, Subcommand};
use tracing_subscriber::EnvFilter;

/// Finds the exterior orientation of single aerial images from roof lines of buildings and small pictures of the
/// ground, and says whether it can be trusted.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, max_term_width = 120)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Serve(serve::Serve),
    Work(work::WorkCommand),
    #[command(hide = true)]
    Worker(worker::Worker),
    Migrate(migrate::Migrate),
    Backup(backup::Backup),
    Restore(backup::Restore),
    Doctor(doctor::Doctor),
    Import(import::Import),
    Block(block::BlockCommand),
    Orient(Box<orient::Orient>),
    Interior(interior::Interior),
    Export(export::Export),
    Ortho(ortho::Ortho),
    Scene(scene::SceneCommand),
    Camera(camera::CameraCommand),
    Crs(crs::CrsCommand),
    Simulate(simulate::Simulate),
    Evaluate(evaluate::Evaluate),
    Train(train::Train),
    Classifier(classifier::ClassifierCommand),
    Key(key::Key),
    Account(account::AccountCommand),
    Audit(audit::Audit),
    Webhook(webhook::Webhook),
    Openapi(openapi::OpenApi),
}

impl Command {
    async fn run(self) -> anyhow::Result<()> {
        match self {
            Self::Demo(command) => command.run().await,
            Self::Serve(command) => command.run().await,
            Self::Work(command) => command.run().await,
            Self::Worker(command) => command.run().await,
            Self::Migrate(command) => command.run().await,
            Self::Backup(command) => command.run().await,
            Self::Restore(command) => command.run().await,
            Self::Doctor(command) => command.run().await,
            Self::Import(command) => command.run().await,
            Self::Block(command) => command.run().await,
            Self::Orient(command) => command.run().await,
            Self::Interior(command) => command.run().await,
            Self::Export(command) => command.run().await,
            Self::Ortho(command) => command.run().await,
            Self::Scene(command) => command.run().await,
            Self::Camera(command) => command.run(),
            Self::Crs(command) => command.run().await,
            Self::Simulate(command) => command.run().await,
            Self::Evaluate(command) => command.run().await,
            Self::Train(command) => command.run().await,
            Self::Classifier(command) => command.run().await,
            Self::Key(command) => command.run().await,
            Self::Account(command) => command.run().await,
            Self::Audit(command) => command.run().await,
            Self::Webhook(command) => command.run().await,
            Self::Openapi(command) => command.run(),
        }
    }
}

/// Where the settings come from; for every command that uses the data folder.
#[derive(Debug, Default, Args)]
struct Settings {
    /// Data folder: database and pictures. [env: GABLE_DATA] [default: gable-data]
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// PostgreSQL in place of SQLite in the data folder. [env: GABLE_DATABASE_URL]
    #[arg(long, value_name = "URL")]
    database_url: Option<String>,
    /// Bucket for the images in place of the data folder. [env: GABLE_OBJECTS_URL]
    #[arg(long, value_name = "S3-URL")]
    objects_url: Option<String>,
    /// TOML file with settings.
    #[arg(long, value_name = "FILE", env = "GABLE_CONFIG")]
    config: Option<PathBuf>,
}

impl Settings {
    /// The settings with further flags on top, and the log begun.
    fn gather(&self, flags: &[(&'static str, Option<String>)]) -> anyhow::Result<Configuration> {
        let data = self.data.as_ref().map(|folder| folder.to_string_lossy().into_owned());
        let given = |(name, value): (&'static str, Option<String>)| value.map(|value| (name, value));
        let places =
            [("data", data), ("database_url", self.database_url.clone()), ("objects_url", self.objects_url.clone())];
        let flags: Vec<_> = flags.iter().cloned().chain(places).filter_map(given).collect();
        let (configuration, ignored) = Configuration::gather(self.config.as_deref(), environment(), &flags)?;
        begin_log(&configuration)?;
        install_geoids(configuration.geoid_folder());
        if !ignored.is_empty() {
            tracing::warn!(variables = ignored.join(" "), "these variables name no setting and are ignored");
        }
        Ok(configuration)
    }
}

fn environment() -> impl Iterator<Item = (String, String)> {
    std::env::vars_os()
        .filter_map(|(name, value)| Some((name.into_string().ok()?, value.to_string_lossy().into_owned())))
}

/// The folder of geoid grids of a command without settings: as file and environment say.
fn geoids_of_environment() -> anyhow::Result<PathBuf> {
    let file = std::env::var_os("GABLE_CONFIG").map(PathBuf::from);
    Ok(Configuration::gather(file.as_deref(), environment(), &[])?.0.geoid_folder())
}

/// From now on compound systems find their grids here.
fn install_geoids(folder: PathBuf) {
    geoid::install(Arc::new(GeoidFolder::new(folder)));
}

fn begin_log(configuration: &Configuration) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(&configuration.log).map_err(|error| ConfigurationError::Unreadable {
        detail: format!("log is {:?}, which is not a filter such as info,gable=debug: {error}", configuration.log),
    })?;
    // it logs every tag of every image, positions too
    let filter = filter.add_directive("nom_exif=off".parse()?);
    // what CREATE … IF NOT EXISTS finds there already
    let filter = filter.add_directive("sqlx::postgres::notice=warn".parse()?);
    let colours = std::io::stderr().is_terminal();
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_ansi(colours).with_writer(std::io::stderr);
    let begun = match configuration.log_format {
        LogFormat::Text => log.try_init(),
        LogFormat::Json => log.json().flatten_event(true).try_init(),
    };
    begun.map_err(|error| anyhow::anyhow!(error)).context("the log cannot be begun")
}

/// Reads the command line and does what it says. Status 2 is for settings and arguments that cannot be used.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return failed(&error.into()),
    };
    let result = runtime.block_on(cli.command.run());
    // a blocking job that does not heed its cancel must not hold up the end
    runtime.shutdown_background();
    result.map_or_else(|error| failed(&error), |()| ExitCode::SUCCESS)
}

/// Notes in the audit log what a command has changed.
async fn note(store: &Store, action: &str, object: &str) -> anyhow::Result<()> {
    let entry = NewEntry {
        who: String::from("command line"),
        action: action.to_owned(),
        object: object.to_owned(),
        status: 0,
        request_id: String::new(),
    };
    store.note(entry).await.context("it is done, but could not be noted in the audit log")
}

/// Prints a result. A reader that has seen enough, like `head`, is no error.
fn print(text: &str) -> anyhow::Result<()> {
    let mut output = std::io::stdout().lock();
    match writeln!(output, "{text}").and_then(|()| output.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("cannot print"),
        _ => Ok(()),
    }
}

fn failed(error: &anyhow::Error) -> ExitCode {
    eprintln!("gable: {}", told(error));
    let no_key = matches!(error.downcast_ref(), Some(ServiceError::NoKey { .. }));
    if no_key || error.is::<ConfigurationError>() { ExitCode::from(2) } else { ExitCode::FAILURE }
}

/// An error with its causes, but none that the message before has told already.
fn told(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}
