//! Lists of control scenes as files: what `POST /control-scenes` takes, with the file of each picture.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};

use crate::configuration::Configuration;
use crate::control::geojson::Rejection;
use crate::control::{ImportReport, Mode, scenes};
use crate::database::Database;
use crate::http::control_scenes::{CheckedScene, ControlSceneRequest};
use crate::imagery::Limits;
use crate::store::now;
use anyhow::Context as _;
use serde_json::{Map, Value};
use uuid::Uuid;

use super::orient::read_json;

/// What is read of the pictures.
pub(super) struct Bounds {
    limits: Limits,
    max_bytes: u64,
}

impl Bounds {
    pub(super) fn of(configuration: &Configuration) -> Self {
        Self { limits: configuration.scene_limits(), max_bytes: configuration.scene_max_bytes as u64 }
    }
}

/// A list of scenes whose pictures are not read yet.
pub(super) struct SceneList {
    folder: PathBuf,
    entries: Vec<Map<String, Value>>,
}

/// An entry of the list with its picture.
pub(super) struct ReadScene {
    pub(super) checked: CheckedScene,
    file: Vec<u8>,
}

impl SceneList {
    /// Reads a list; its pictures are in the folder `scenes` beside it, or right beside it.
    pub(super) fn read(file: &Path) -> anyhow::Result<Self> {
        Ok(Self { folder: file.parent().unwrap_or(Path::new("")).to_owned(), entries: read_json(file)? })
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    /// The entries one after the other, each read when it is its turn; the bad ones never lose the others.
    pub(super) fn scenes(&self, bounds: &Bounds) -> impl Iterator<Item = Result<ReadScene, Rejection>> {
        let mut names = HashSet::new();
        self.entries.iter().enumerate().map(move |(index, entry)| {
            let name = entry.get("name").and_then(Value::as_str).map(str::to_owned);
            let read = self.scene(entry, bounds).and_then(|scene| match names.insert(name.clone()) {
                true => Ok(scene),
                false => Err("the name occurs earlier in this list; names are unique".to_owned()),
            });
            read.map_err(|detail| Rejection::new(index, name, detail))
        })
    }

    fn scene(&self, entry: &Map<String, Value>, bounds: &Bounds) -> Result<ReadScene, String> {
        let mut about = entry.clone();
        let Some(Value::String(name)) = about.remove("file") else {
            return Err("file is missing; each scene needs the name of the file of its picture".to_owned());
        };
        let request: ControlSceneRequest = serde_json::from_value(about.into()).map_err(|error| error.to_string())?;
        let file = self.picture(&name, bounds).map_err(|error| format!("{error:#}"))?;
        let checked = request.check(&file, &std::env::temp_dir(), &bounds.limits).map_err(|error| error.to_string())?;
        Ok(ReadScene { checked, file })
    }

    fn picture(&self, name: &str, bounds: &Bounds) -> anyhow::Result<Vec<u8>> {
        let places = [self.folder.join("scenes").join(name), self.folder.join(name)];
        let path = places.iter().find(|path| path.is_file()).unwrap_or(&places[0]);
        let told = || format!("cannot read {}", path.display());
        let bytes = std::fs::metadata(path).with_context(told)?.len();
        anyhow::ensure!(
            bytes <= bounds.max_bytes,
            "{} has {bytes} bytes; the picture of a scene may have {} (set by `scene_max_bytes`)",
            path.display(),
            bounds.max_bytes
        );
        std::fs::read(path).with_context(told)
    }
}

/// Writes all good scenes of a list. `progress` is told how many entries are done.
pub(super) async fn import(
    pool: &Database,
    list: &SceneList,
    bounds: &Bounds,
    mode: Mode,
    progress: impl Fn(usize),
) -> anyhow::Result<ImportReport> {
    let mut report = ImportReport::default();
    let (mut names, mut told) = (Vec::new(), BTreeSet::new());
    for (index, scene) in list.scenes(bounds).enumerate() {
        match scene {
            Ok(ReadScene { checked: CheckedScene { content, warnings, .. }, file }) => {
                told.extend(warnings.into_iter().map(|warning| warning.detail));
                if mode == Mode::Insert && scenes::by_id_or_name(pool, &content.name).await?.is_some() {
                    let detail = "a scene of this name exists already; --mode upsert would replace it".to_owned();
                    report.reject(Rejection::new(index, Some(content.name), detail));
                } else {
                    match scenes::write(pool, Uuid::now_v7(), &content, &file, now()).await?.new {
                        true => report.imported += 1,
                        false => report.updated += 1,
                    }
                    names.push(content.name);
                }
            }
            Err(rejection) => report.reject(rejection),
        }
        progress(index + 1);
    }
    if mode == Mode::Replace && !names.is_empty() {
        scenes::remove_all_but(pool, &names.iter().map(String::as_str).collect::<Vec<_>>()).await?;
    }
    for detail in told {
        tracing::warn!("{detail}");
    }
    Ok(report)
}
