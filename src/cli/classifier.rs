//! `gable classifier`: the classifiers of a data folder.

use std::path::PathBuf;

use crate::classifiers::Texts;
use crate::jobs::active::{ActiveClassifier, SHIPPED, stored_classifier};
use crate::jobs::training::name_fault;
use crate::store::Store;
use crate::store::classifiers::{ClassifierStatus, ClassifierTexts, StoredClassifier};
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, Subcommand};
use uuid::Uuid;

use super::{print, sets};

const EXAMPLES: &str = "\
Examples:
  gable classifier list --data /srv/gable
  gable classifier add my-classifier --name rhineland --data /srv/gable
  gable classifier activate rhineland --data /srv/gable
  gable classifier rollback --data /srv/gable

All of it works while the service runs.";

/// List, add and activate the classifiers of a data folder
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ClassifierCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// All classifiers, the active one marked.
    List(Data),
    /// Add one from the folder that `gable train` has made.
    Add {
        /// The folder.
        folder: PathBuf,
        /// Its unique name.
        #[arg(long)]
        name: String,
        #[command(flatten)]
        data: Data,
    },
    /// Let one decide from now on, by its name; `shipped` is the one that Gable brings along.
    Activate {
        /// Its name.
        name: String,
        #[command(flatten)]
        data: Data,
    },
    /// Take the last activation back.
    Rollback(Data),
}

#[derive(Debug, Args)]
struct Data {
    /// Data folder.
    #[arg(long, value_name = "FOLDER", env = "GABLE_DATA", default_value = "gable-data")]
    data: PathBuf,
}

impl Data {
    async fn open(&self) -> anyhow::Result<Store> {
        if !self.data.join("gable.db").exists() {
            bail!("there is no data folder {}; give --data FOLDER", self.data.display());
        }
        Ok(Store::open(&self.data).await?)
    }
}

/// Classifiers of a data folder that are looked through, at most.
const MOST: u32 = 10_000;

impl ClassifierCommand {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        match self.action {
            Action::List(data) => list(&data.open().await?).await,
            Action::Add { folder, name, data } => {
                let texts = sets::texts_of(&folder)?;
                texts.load().with_context(|| folder.display().to_string())?;
                let store = data.open().await?;
                refuse_taken(&store, &name).await?;
                let sha256 = texts.sha256();
                let Texts { model, scaling, description } = texts;
                let stored = ClassifierTexts { model, scaling, description };
                let plan = serde_json::json!({"added_from": folder}).to_string();
                if !store.add_classifier(Uuid::now_v7(), &name, &plan, &stored, sha256).await? {
                    return Err(taken(&name));
                }
                print(&format!("added {name}"))
            }
            Action::Activate { name, data } => {
                let store = data.open().await?;
                let id = match named(&store, &name).await? {
                    Some(stored) => {
                        let whole = store.classifier(stored.id).await?.context("it is gone")?;
                        stored_classifier(&whole)?;
                        Some(stored.id)
                    }
                    None => None,
                };
                store.activate_classifier(id).await?;
                tell_active(&store).await
            }
            Action::Rollback(data) => {
                let store = data.open().await?;
                if !store.roll_classifier_back().await? {
                    bail!("no classifier was ever activated");
                }
                tell_active(&store).await
            }
        }
    }
}

/// Refuses a name that no new classifier can have.
pub(super) async fn refuse_taken(store: &Store, name: &str) -> anyhow::Result<()> {
    if let Some(fault) = name_fault(name) {
        bail!("{fault}; give another --name");
    }
    let is_taken =
        store.classifiers(None, MOST).await?.iter().any(|s| s.name == name && s.status != ClassifierStatus::Failed);
    if is_taken { Err(taken(name)) } else { Ok(()) }
}

/// What is told of a name that another classifier has.
pub(super) fn taken(name: &str) -> anyhow::Error {
    anyhow!("there is a classifier of the name {name:?} already; give another --name")
}

/// A classifier by its name; `None` for the one that Gable brings along.
async fn named(store: &Store, name: &str) -> anyhow::Result<Option<StoredClassifier>> {
    if name == SHIPPED {
        return Ok(None);
    }
    let found = store.classifiers(None, MOST).await?.into_iter().find(|stored| stored.name == name);
    Ok(Some(found.with_context(|| format!("there is no classifier of the name {name:?}"))?))
}

async fn tell_active(store: &Store) -> anyhow::Result<()> {
    let active = ActiveClassifier::default().get(store).await?;
    print(&format!("{} decides from now on ({})", active.name, active.loaded.hash()))
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let active = store.activations(1).await?.first().and_then(|activation| activation.classifier_id);
    let mark = |is_active: bool| if is_active { "*" } else { " " };
    print(&format!("{} {SHIPPED:<30} ready", mark(active.is_none())))?;
    for stored in store.classifiers(None, MOST).await? {
        let hash: String = stored.sha256.iter().flatten().take(6).map(|byte| format!("{byte:02x}")).collect();
        let error = stored.error.unwrap_or_default();
        let mark = mark(active == Some(stored.id));
        print(&format!("{mark} {:<30} {:<9} {hash} {error}", stored.name, stored.status.name()))?;
    }
    Ok(())
}
