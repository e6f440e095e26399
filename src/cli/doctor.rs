//! `gable doctor`.

use std::io::{IsTerminal as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::configuration::Configuration;
use crate::database::{Database, query};
use crate::geoids::{GeoidFolder, first_used};
use crate::geometry::Crs;
use crate::store::Store;
use anyhow::bail;
use clap::Args;
use tokio::net::TcpListener;

use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable doctor --config /etc/gable.toml
      Looks at everything that `gable serve` would need, a line each, and ends with status 1 if something is wrong. \
      May run beside the service; makes the data folder if there is none.

  gable doctor --settings
      Also shows every setting as it would be, secrets left out.";

/// Check settings, data folder, database, object store and workers before a start
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Doctor {
    /// Show all settings as they would be.
    #[arg(long = "settings")]
    show_settings: bool,
    #[command(flatten)]
    settings: Settings,
}

/// A commit waits for the disk; with a slower one few would be accepted in a second.
const SYNC_MAX: Duration = Duration::from_millis(50);
/// Clocks that differ by more make logs and expiry times hard to read.
const CLOCK_MAX_S: f64 = 2.0;
const FILES_MIN: u64 = 1024;
const SYNCS: u32 = 10;

/// What was found, a line each.
#[derive(Default)]
struct Findings {
    faults: usize,
}

impl Findings {
    fn tell(&mut self, part: &str, found: Result<String, String>) -> anyhow::Result<()> {
        let colours = std::io::stdout().is_terminal();
        let (word, code, text) = match found {
            Ok(text) => ("ok", 32, text),
            Err(text) => ("FAULT", 31, text),
        };
        self.faults += usize::from(word == "FAULT");
        let word = if colours { format!("\x1b[{code}m{word:<5}\x1b[0m") } else { format!("{word:<5}") };
        print(&format!("{word}  {part:<12}  {text}"))
    }
}

impl Doctor {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let quiet = std::env::var_os("GABLE_LOG").is_none().then(|| "error".to_owned());
        // settings that cannot be used end it here, with their own line
        let configuration = self.settings.gather(&[("log", quiet)])?;
        let mut findings = Findings::default();
        findings.tell("settings", Ok("can be used".to_owned()))?;
        if self.show_settings {
            show(&configuration)?;
        }
        findings.tell("folder", folder(&configuration))?;
        findings.tell("geoids", geoids(&configuration))?;
        let store = Store::connect(&configuration.place()).await;
        match &store {
            Ok(store) => {
                findings.tell("database", database(store).await)?;
                findings.tell("objects", objects(store, &configuration).await)?;
                findings.tell("keys", keys(store, &configuration).await)?;
                findings.tell("clock", clock(store).await)?;
            }
            Err(error) => findings.tell("database", Err(error.to_string()))?,
        }
        findings.tell("address", address(&configuration).await)?;
        findings.tell("files", files())?;
        findings.tell("workers", Ok(workers(&configuration)))?;
        match findings.faults {
            0 => Ok(()),
            1 => bail!("there is a fault"),
            faults => bail!("there are {faults} faults"),
        }
    }
}

fn show(configuration: &Configuration) -> anyhow::Result<()> {
    let values = serde_json::to_value(configuration)?;
    for setting in Configuration::settings() {
        let value = &values[&setting.name];
        let value = match value.as_str() {
            Some(url) if setting.name.ends_with("_url") => without_password(url),
            Some(_) if setting.name.ends_with("_secret") => "(given)".to_owned(),
            Some(text) => text.to_owned(),
            None if value.is_null() => "(not given)".to_owned(),
            None => value.to_string(),
        };
        print(&format!("         {} = {value}", setting.name))?;
    }
    Ok(())
}

/// A URL with its password left out.
fn without_password(url: &str) -> String {
    let Some((scheme, rest)) = url.split_once("://") else { return url.to_owned() };
    match rest.split_once('@') {
        Some((user, place)) => {
            let user = user.split(':').next().unwrap_or_default();
            format!("{scheme}://{user}@{place}")
        }
        None => url.to_owned(),
    }
}

fn folder(configuration: &Configuration) -> Result<String, String> {
    let folder = &configuration.data;
    let synced = std::fs::create_dir_all(folder).and_then(|()| sync_time(folder));
    let synced = synced.map_err(|error| format!("{} cannot be written: {error}", folder.display()))?;
    let facts = rustix::fs::statvfs(folder).map_err(|error| format!("its room is not told: {error}"))?;
    let free = facts.f_bavail.saturating_mul(facts.f_frsize);
    if free < configuration.disk_reserve_bytes {
        return Err(format!(
            "{free} bytes are free, less than disk_reserve_bytes = {}",
            configuration.disk_reserve_bytes
        ));
    }
    let told = format!("{}: {:.1} GB free, synced in {synced:.1?}", folder.display(), free as f64 / 1e9);
    if synced > SYNC_MAX { Err(format!("{told}, which is slow: at most {SYNC_MAX:?} is good")) } else { Ok(told) }
}

/// None is no fault: who gives ellipsoidal heights needs none.
fn geoids(configuration: &Configuration) -> Result<String, String> {
    let folder = configuration.geoid_folder();
    let found = GeoidFolder::new(&folder).found();
    let faults: Vec<String> = found
        .iter()
        .filter_map(|found| Some(format!("{} cannot be used: {}", found.name, found.fault.as_ref()?)))
        .collect();
    if !faults.is_empty() {
        return Err(format!("{}: {}", folder.display(), faults.join("; ")));
    }
    if found.is_empty() {
        return Ok(format!("none in {}: compound CRSs are refused", folder.display()));
    }
    let mut told: Vec<String> =
        found.iter().map(|found| format!("{} ({})", found.name, found.systems.join(", "))).collect();
    for system in Crs::height_systems() {
        if let (Some(used), Some(preferred)) = (first_used(system, &found), system.grids.first())
            && used != *preferred
        {
            told.push(format!("{} by {used}, as {preferred} is not there", system.name));
        }
    }
    Ok(format!("{}: {}", folder.display(), told.join(", ")))
}

fn sync_time(folder: &Path) -> std::io::Result<Duration> {
    let mut file = tempfile::tempfile_in(folder)?;
    let began = Instant::now();
    for _ in 0..SYNCS {
        file.write_all(&[0; 4096])?;
        file.sync_data()?;
    }
    Ok(began.elapsed() / SYNCS)
}

async fn database(store: &Store) -> Result<String, String> {
    let told = |error: sqlx::Error| error.to_string();
    match store.database() {
        Database::Sqlite(_) => {
            let found: String = query("PRAGMA quick_check(1)").fetch_value(store.database()).await.map_err(told)?;
            if found == "ok" { Ok("SQLite, whole, syncs every commit".to_owned()) } else { Err(found) }
        }
        Database::Postgres(_) => {
            let version: String = query("SHOW server_version").fetch_value(store.database()).await.map_err(told)?;
            let began = Instant::now();
            query("SELECT TRUE").fetch_value::<bool>(store.database()).await.map_err(told)?;
            Ok(format!("PostgreSQL {version}, tables of this version, answers in {:.1?}", began.elapsed()))
        }
    }
}

async fn objects(store: &Store, configuration: &Configuration) -> Result<String, String> {
    store.ping().await.map_err(|error| error.to_string())?;
    Ok(configuration.objects_url.clone().unwrap_or_else(|| "in the data folder".to_owned()))
}

async fn keys(store: &Store, configuration: &Configuration) -> Result<String, String> {
    match store.any_key().await.map_err(|error| error.to_string())? {
        true => Ok("there are some".to_owned()),
        false if configuration.listen.ip().is_loopback() => Ok("none: programs on this machine are let in".to_owned()),
        false => Err("none, but others can reach the address: `gable key new --role admin`".to_owned()),
    }
}

async fn clock(store: &Store) -> Result<String, String> {
    let Database::Postgres(_) = store.database() else { return Ok("that of this machine".to_owned()) };
    let theirs: f64 = query("SELECT CAST(extract(epoch FROM clock_timestamp()) AS DOUBLE PRECISION)")
        .fetch_value(store.database())
        .await
        .map_err(|error| error.to_string())?;
    let ours = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default().as_secs_f64();
    let told = format!("{:.1} s apart from the database's", (ours - theirs).abs());
    if (ours - theirs).abs() > CLOCK_MAX_S { Err(told) } else { Ok(told) }
}

async fn address(configuration: &Configuration) -> Result<String, String> {
    let listen = configuration.listen;
    match TcpListener::bind(listen).await {
        Ok(_) => Ok(format!("{listen} is free")),
        Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {
            Ok(format!("{listen} is in use, by the service perhaps"))
        }
        Err(error) => Err(format!("{listen}: {error}")),
    }
}

fn files() -> Result<String, String> {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).maximum;
    match limit {
        Some(limit) if limit < FILES_MIN => Err(format!("{limit} may be open, which is few: raise `ulimit -n`")),
        Some(limit) => Ok(format!("{limit} may be open")),
        None => Ok("any number may be open".to_owned()),
    }
}

fn workers(configuration: &Configuration) -> String {
    if !configuration.work {
        return "none here: `gable work` orients".to_owned();
    }
    let (workers, most) = (configuration.worker_count(), configuration.worker_memory_max_bytes as f64 / 1e9);
    format!("{workers} processes with at most {most:.1} GB each")
}
