//! Labelled sets and classifiers as files on the command line.

use std::io::BufRead as _;
use std::path::Path;

use crate::classifiers::{LabelledImage, LabelledSet, Loaded, Texts, TrainingSet, texts};
use anyhow::{Context as _, bail};
use sha2::{Digest as _, Sha256};

/// Reads labelled sets: files of JSON Lines, or folders of studies.
pub(super) fn read_sets(paths: &[std::path::PathBuf]) -> anyhow::Result<TrainingSet> {
    let mut all = TrainingSet::default();
    for path in paths {
        let (set, images) = read_set(path)?;
        if all.sets.iter().any(|other: &LabelledSet| other.sha256 == set.sha256) {
            bail!("{} is given twice", path.display());
        }
        all.sets.push(set);
        all.images.extend(images);
    }
    Ok(all)
}

fn read_set(path: &Path) -> anyhow::Result<(LabelledSet, Vec<LabelledImage>)> {
    let file = if path.is_dir() { path.join("labelled.jsonl") } else { path.to_owned() };
    let content = std::fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
    let sha256 = Sha256::digest(&content).iter().map(|byte| format!("{byte:02x}")).collect();
    let mut images = Vec::new();
    for (number, line) in content.lines().enumerate() {
        let line = line.with_context(|| format!("cannot read {}", file.display()))?;
        if line.trim().is_empty() {
            continue;
        }
        let image = serde_json::from_str(&line).with_context(|| format!("{}, line {}", file.display(), number + 1))?;
        images.push(image);
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok((LabelledSet { name, images: images.len(), sha256 }, images))
}

/// Reads a classifier from its folder.
pub(super) fn read_classifier(folder: &Path) -> anyhow::Result<Loaded> {
    texts_of(folder)?.load().with_context(|| folder.display().to_string())
}

/// The three texts in a folder.
pub(super) fn texts_of(folder: &Path) -> anyhow::Result<Texts> {
    let [model, scaling, description] = texts::FILES.map(|name| {
        let path = folder.join(name);
        std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))
    });
    Ok(Texts { model: model?, scaling: scaling?, description: description? })
}

/// Writes a classifier into a folder.
pub(super) fn write_classifier(texts: &Texts, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    for (name, text) in texts::FILES.iter().zip([&texts.model, &texts.scaling, &texts.description]) {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}
