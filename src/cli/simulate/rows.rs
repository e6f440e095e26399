//! The rows of a study on disk: appended one by one, so that a run that was stopped goes on where it was.

use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

use crate::classifiers::LabelledImage;
use crate::study::{self, Mixture, Row, mixture};
use anyhow::{Context as _, bail};
use rustix::fs::FlockOperation;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::lines::{LinesFile, replace};

const LABELLED_FILE: &str = "labelled.jsonl";
const ROWS_FILE: &str = "rows.csv";
const MANIFEST_FILE: &str = "study.json";

/// What all rows of a folder have in common. Rows that another program or another mixture has made do not belong in
/// one table with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    pub(super) mixture: Mixture,
    pub(super) mixture_version: u32,
    /// Of the program that made the rows.
    pub(super) program_sha256: String,
}

impl Manifest {
    pub(super) fn of(mixture: Mixture) -> anyhow::Result<Self> {
        let program = std::env::current_exe().and_then(std::fs::read).context("cannot read the running program")?;
        let program_sha256 = Sha256::digest(program).iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { mixture, mixture_version: mixture::VERSION, program_sha256 })
    }
}

/// What is kept of an image: its row, and what classifiers learn from it.
#[derive(Debug, Clone)]
pub(super) struct Examined {
    pub(super) row: Row,
    pub(super) labelled: LabelledImage,
}

/// The files of rows and of labelled images, open for more.
pub(super) struct RowsFile {
    rows: LinesFile,
    labelled: LinesFile,
    /// The folder: one run at a time.
    _lock: File,
}

impl RowsFile {
    /// Opens the files of a folder or begins them; returns the images that are in both.
    pub(super) fn open(folder: &Path, manifest: &Manifest) -> anyhow::Result<(Self, Vec<Examined>)> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let lock = File::open(folder).with_context(|| format!("cannot open {}", folder.display()))?;
        rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive)
            .with_context(|| format!("another run works in {}", folder.display()))?;
        check_manifest(folder, manifest)?;
        let path = folder.join(ROWS_FILE);
        let read = || format!("cannot read {}", path.display());
        let (rows, text) = LinesFile::open(path.clone())?;
        let known: Result<Vec<Row>, _> = csv::Reader::from_reader(text.as_bytes()).deserialize().collect();
        let known = known.with_context(read)?;
        if let Some(row) = known.iter().find(|row| row.mixture != manifest.mixture) {
            bail!("{}: the row of seed {} is of the mixture {}", path.display(), row.seed, row.mixture.name());
        }
        if let Some(row) = known.iter().find(|row| !row.is_consistent()) {
            bail!("{}: the counts of the row of seed {} contradict each other", path.display(), row.seed);
        }
        let (labelled, text) = LinesFile::open(folder.join(LABELLED_FILE))?;
        let mut of_image: HashMap<String, LabelledImage> = HashMap::new();
        for line in text.lines() {
            let image: LabelledImage =
                serde_json::from_str(line).with_context(|| format!("cannot read {LABELLED_FILE}"))?;
            of_image.insert(image.image.clone(), image);
        }
        let both = known.into_iter().filter_map(|row| {
            let labelled = of_image.remove(&study::image_name(row.mixture, row.seed))?;
            Some(Examined { row, labelled })
        });
        let both = both.collect();
        Ok((Self { rows, labelled, _lock: lock }, both))
    }

    /// Adds an image. Its row comes last: an image without one is examined again.
    pub(super) fn append(&mut self, image: &Examined) -> anyhow::Result<()> {
        self.labelled.append(&labelled_lines([image])?)?;
        let header = self.rows.is_empty()?;
        self.rows.append(&row_lines([image], header)?)
    }

    /// Writes the images anew, in this order.
    pub(super) fn replace(self, images: &[Examined]) -> anyhow::Result<()> {
        self.labelled.replace(&labelled_lines(images)?)?;
        self.rows.replace(&row_lines(images, true)?)
    }
}

fn row_lines<'a>(images: impl IntoIterator<Item = &'a Examined>, header: bool) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::WriterBuilder::new().has_headers(header).from_writer(Vec::new());
    for image in images {
        writer.serialize(&image.row)?;
    }
    Ok(writer.into_inner().map_err(|error| error.into_error())?)
}

fn labelled_lines<'a>(images: impl IntoIterator<Item = &'a Examined>) -> anyhow::Result<Vec<u8>> {
    let mut lines = Vec::new();
    for image in images {
        serde_json::to_writer(&mut lines, &image.labelled)?;
        lines.push(b'\n');
    }
    Ok(lines)
}

fn check_manifest(folder: &Path, manifest: &Manifest) -> anyhow::Result<()> {
    let path = folder.join(MANIFEST_FILE);
    if !path.exists() {
        if folder.join(ROWS_FILE).exists() {
            bail!("{} has rows but no {MANIFEST_FILE} that says of what: give another --out", folder.display());
        }
        let text = format!("{}\n", serde_json::to_string_pretty(manifest)?);
        return replace(&path, text.as_bytes());
    }
    let before: Manifest = super::super::orient::read_json(&path)?;
    if before == *manifest {
        return Ok(());
    }
    let what = if before.mixture != manifest.mixture {
        format!("it is of the mixture {}", before.mixture.name())
    } else if before.mixture_version != manifest.mixture_version {
        format!("its mixture is of version {}, not {}", before.mixture_version, manifest.mixture_version)
    } else {
        "it was begun by another build of gable, which may orient otherwise".to_owned()
    };
    bail!("the study in {} cannot be continued: {what}; give another --out", folder.display())
}
