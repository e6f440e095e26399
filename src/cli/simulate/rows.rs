//! The rows of a study on disk: appended one by one, so that a run that was stopped goes on where it was.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use gable::study::{Mixture, Row, mixture};
use rustix::fs::FlockOperation;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

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

/// The file of rows, open for more.
pub(super) struct RowsFile {
    path: PathBuf,
    file: File,
    /// The folder: one run at a time.
    _lock: File,
}

impl RowsFile {
    /// Opens the rows of a folder or begins them; returns those that are there already.
    pub(super) fn open(folder: &Path, manifest: &Manifest) -> anyhow::Result<(Self, Vec<Row>)> {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let path = folder.join(ROWS_FILE);
        let lock = File::open(folder).with_context(|| format!("cannot open {}", folder.display()))?;
        rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive)
            .with_context(|| format!("another run works in {}", folder.display()))?;
        check_manifest(folder, manifest)?;
        let read = || format!("cannot read {}", path.display());
        let mut text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            text => text.with_context(read)?,
        };
        // a run that was killed may leave a part of a line
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        text.truncate(whole);
        let rows: Result<Vec<Row>, _> = csv::Reader::from_reader(text.as_bytes()).deserialize().collect();
        let rows = rows.with_context(read)?;
        if let Some(row) = rows.iter().find(|row| row.mixture != manifest.mixture) {
            bail!("{}: the row of seed {} is of the mixture {}", path.display(), row.seed, row.mixture.name());
        }
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(read)?;
        file.set_len(whole as u64).with_context(read)?;
        Ok((Self { path, file, _lock: lock }, rows))
    }

    /// Adds a row, with a header if it is the first.
    pub(super) fn append(&mut self, row: &Row) -> anyhow::Result<()> {
        let write = || format!("cannot write {}", self.path.display());
        let empty = self.file.metadata().with_context(write)?.len() == 0;
        let line = lines([row], empty)?;
        // in one piece: whoever reads meanwhile sees whole rows
        self.file.write_all(&line).with_context(write)
    }

    /// Writes the rows anew, in this order.
    pub(super) fn replace(self, rows: &[Row]) -> anyhow::Result<()> {
        let fresh = self.path.with_extension("csv.new");
        std::fs::write(&fresh, lines(rows, true)?).with_context(|| format!("cannot write {}", fresh.display()))?;
        std::fs::rename(&fresh, &self.path).with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn lines<'a>(rows: impl IntoIterator<Item = &'a Row>, header: bool) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::WriterBuilder::new().has_headers(header).from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner().map_err(|error| error.into_error())?)
}

fn check_manifest(folder: &Path, manifest: &Manifest) -> anyhow::Result<()> {
    let path = folder.join(MANIFEST_FILE);
    if !path.exists() {
        if folder.join(ROWS_FILE).exists() {
            bail!("{} has rows but no {MANIFEST_FILE} that says of what: give another --out", folder.display());
        }
        let text = format!("{}\n", serde_json::to_string_pretty(manifest)?);
        let fresh = path.with_extension("json.new");
        let written = std::fs::write(&fresh, text).and_then(|()| std::fs::rename(&fresh, &path));
        return written.with_context(|| format!("cannot write {}", path.display()));
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
