//! `gable backup` and `gable restore`.

use std::path::{Path, PathBuf};

use crate::configuration::Configuration;
use crate::database::{Database, query};
use crate::store::Store;
use crate::store::images::{hexadecimal, sha256_of};
use anyhow::{Context as _, bail, ensure};
use clap::Args;
use tokio::process::Command;

use super::{Settings, print};

const BACKUP_EXAMPLES: &str = "\
Examples:
  gable backup --to /backup/gable --data /srv/gable
      Copies the database as it is at one moment, and then the images that are not there yet. The service goes on \
      meanwhile. Run it again as often as you like: only what is new is copied.

  gable backup --to /backup/gable --database-url postgres://gable@db/gable
      With PostgreSQL the same by its own `pg_dump`, which must be installed; images in a bucket are left to the bucket.";

const RESTORE_EXAMPLES: &str = "\
Examples:
  gable restore --from /backup/gable --data /srv/gable-new
      Into a data folder that has no database yet. Checks the database and the SHA-256 of every image.

  gable restore --from /backup/gable --database-url postgres://gable@db/gable_new
      Into an empty database, by `pg_restore`.";

/// The copy of SQLite's file, and that of PostgreSQL.
const SQLITE: &str = "gable.db";
const POSTGRES: &str = "gable.dump";
const IMAGES: &str = "images";

/// Copy database and images while the service goes on
#[derive(Debug, Args)]
#[command(after_help = BACKUP_EXAMPLES)]
pub(crate) struct Backup {
    /// The folder of the backup; it is made if it is not there.
    #[arg(long, value_name = "FOLDER")]
    to: PathBuf,
    #[command(flatten)]
    settings: Settings,
}

/// Make a service's data out of a backup
#[derive(Debug, Args)]
#[command(after_help = RESTORE_EXAMPLES)]
pub(crate) struct Restore {
    /// The folder of the backup.
    #[arg(long, value_name = "FOLDER")]
    from: PathBuf,
    #[command(flatten)]
    settings: Settings,
}

impl Backup {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let configuration = self.settings.gather(&[])?;
        let images = self.to.join(IMAGES);
        std::fs::create_dir_all(&images).with_context(|| format!("cannot create {}", images.display()))?;
        // first the database: what its rows refer to is there already, and stays while it is copied
        match &configuration.database_url {
            None => copy_sqlite(&configuration, &self.to).await?,
            Some(url) => run("pg_dump", &["--format=custom", "--dbname", url], "--file", &self.to, POSTGRES).await?,
        }
        let copied = match configuration.objects_url {
            Some(_) => 0,
            None => copy_new(&configuration.data.join(IMAGES), &images)?,
        };
        print(&format!("{} has the database, and {copied} images that it had not", self.to.display()))
    }
}

async fn copy_sqlite(configuration: &Configuration, to: &Path) -> anyhow::Result<()> {
    ensure!(configuration.data.join(SQLITE).exists(), "{} has no database", configuration.data.display());
    let store = Store::connect(&configuration.place()).await?;
    let (part, whole) = (to.join("gable.db.part"), to.join(SQLITE));
    remove_if_there(&part)?;
    // one moment of the database, whatever is written meanwhile
    query("VACUUM INTO $1").bind(part.to_string_lossy().as_ref()).execute(store.database()).await?;
    store.close().await;
    std::fs::File::open(&part)?.sync_all()?;
    std::fs::rename(&part, &whole)?;
    sync(to)
}

fn remove_if_there(file: &Path) -> anyhow::Result<()> {
    match std::fs::remove_file(file) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", file.display()))
        }
        _ => Ok(()),
    }
}

/// Runs a tool of PostgreSQL's that writes a file, which appears only as a whole.
async fn run(tool: &str, arguments: &[&str], file_flag: &str, folder: &Path, name: &str) -> anyhow::Result<()> {
    let part = folder.join(format!("{name}.part"));
    let mut command = Command::new(tool);
    command.args(arguments).arg(file_flag).arg(&part);
    finish(tool, &mut command).await?;
    std::fs::File::open(&part)?.sync_all()?;
    std::fs::rename(&part, folder.join(name))?;
    sync(folder)
}

async fn finish(tool: &str, command: &mut Command) -> anyhow::Result<()> {
    let ended = command.output().await;
    let ended = ended.with_context(|| format!("{tool} cannot be run; it comes with PostgreSQL's client"))?;
    ensure!(ended.status.success(), "{tool}: {}", String::from_utf8_lossy(&ended.stderr).trim());
    Ok(())
}

fn sync(folder: &Path) -> anyhow::Result<()> {
    std::fs::File::open(folder)?.sync_all().with_context(|| format!("cannot sync {}", folder.display()))
}

/// Copies the files that are not there yet. Their names are the SHA-256 of their bytes: the same name is the same file.
fn copy_new(from: &Path, to: &Path) -> anyhow::Result<usize> {
    let mut copied = 0;
    for entry in std::fs::read_dir(from).with_context(|| format!("cannot list {}", from.display()))? {
        let (source, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        let (whole, part) = (to.join(&name), to.join("image.part"));
        if whole.exists() {
            continue;
        }
        match std::fs::copy(&source, &part) {
            Ok(_) => {}
            // it was deleted meanwhile, and its row too
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => return Err(error).with_context(|| format!("cannot copy {}", source.display())),
        }
        std::fs::File::open(&part)?.sync_all()?;
        std::fs::rename(&part, &whole)?;
        copied += 1;
    }
    sync(to)?;
    Ok(copied)
}

impl Restore {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let configuration = self.settings.gather(&[])?;
        let (data, images) = (&configuration.data, configuration.data.join(IMAGES));
        std::fs::create_dir_all(&images).with_context(|| format!("cannot create {}", images.display()))?;
        if configuration.objects_url.is_none() {
            copy_new(&self.from.join(IMAGES), &images)?;
        }
        match &configuration.database_url {
            None => {
                let (copy, file) = (self.from.join(SQLITE), data.join(SQLITE));
                ensure!(!file.exists(), "{} has a database already; restore into a folder without", data.display());
                let part = data.join("gable.db.part");
                std::fs::copy(&copy, &part).with_context(|| format!("cannot copy {}", copy.display()))?;
                std::fs::File::open(&part)?.sync_all()?;
                std::fs::rename(&part, &file)?;
                sync(data)?;
            }
            Some(url) => {
                let dump = self.from.join(POSTGRES);
                ensure!(!any_table(url).await?, "the database has tables already; restore into an empty one");
                let mut restore = Command::new("pg_restore");
                restore.args(["--no-owner", "--exit-on-error", "--single-transaction", "--dbname", url]).arg(dump);
                finish("pg_restore", &mut restore).await?;
            }
        }
        let store = Store::connect(&configuration.place()).await?;
        let checked = check(&store, &configuration).await?;
        store.close().await;
        print(&format!("restored: {checked}"))
    }
}

async fn any_table(url: &str) -> anyhow::Result<bool> {
    let database = Database::postgres(url).await?;
    let any = query("SELECT EXISTS (SELECT 1 FROM pg_tables WHERE schemaname IN ('public', 'apalis'))");
    let any = any.fetch_value(&database).await?;
    database.close().await;
    Ok(any)
}

/// Whether the database is whole, and every image is what its row says.
async fn check(store: &Store, configuration: &Configuration) -> anyhow::Result<String> {
    if let Database::Sqlite(_) = store.database() {
        let found: String = query("PRAGMA integrity_check").fetch_value(store.database()).await?;
        ensure!(found == "ok", "the database is damaged: {found}");
    }
    let (mut before, mut images, mut bad) = (None, 0_usize, Vec::new());
    loop {
        let page = store.images(before, 500).await?;
        let Some(last) = page.last() else { break };
        before = Some(last.id);
        images += page.len();
        if configuration.objects_url.is_none() {
            for image in page {
                let file = store.image_file(&image.sha256).await?;
                let right = tokio::task::spawn_blocking(move || sha256_of(&std::fs::File::open(file)?)).await?;
                if right.ok() != Some(image.sha256) {
                    bad.push(hexadecimal(&image.sha256));
                }
            }
        }
    }
    if !bad.is_empty() {
        bail!("{} of {images} images are missing or damaged: {}", bad.len(), bad.join(" "));
    }
    let orientations: i64 = query("SELECT count(*) FROM orientations").fetch_value(store.database()).await?;
    Ok(format!("{orientations} orientations, {images} images, all as they were"))
}
