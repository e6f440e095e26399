//! A file of lines to which a run appends, and whose last line a run that was killed may have left unfinished.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// The file, open for more.
pub(super) struct LinesFile {
    path: PathBuf,
    file: File,
}

impl LinesFile {
    /// Opens the file or begins it, cuts off an unfinished line, and returns the text of the others.
    pub(super) fn open(path: PathBuf) -> anyhow::Result<(Self, String)> {
        let read = || format!("cannot read {}", path.display());
        let mut text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            text => text.with_context(read)?,
        };
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        text.truncate(whole);
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(read)?;
        file.set_len(whole as u64).with_context(read)?;
        Ok((Self { path, file }, text))
    }

    /// Whether nothing is in it yet.
    pub(super) fn is_empty(&self) -> anyhow::Result<bool> {
        Ok(self.file.metadata().with_context(|| format!("cannot read {}", self.path.display()))?.len() == 0)
    }

    /// Adds lines in one piece: whoever reads meanwhile sees whole ones.
    pub(super) fn append(&mut self, lines: &[u8]) -> anyhow::Result<()> {
        self.file.write_all(lines).with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Writes the file anew.
    pub(super) fn replace(self, lines: &[u8]) -> anyhow::Result<()> {
        replace(&self.path, lines)
    }
}

/// Writes a file in such a way that there is always a whole one.
pub(super) fn replace(path: &Path, content: &[u8]) -> anyhow::Result<()> {
    let mut fresh = path.as_os_str().to_owned();
    fresh.push(".new");
    let written = std::fs::write(&fresh, content).and_then(|()| std::fs::rename(&fresh, path));
    written.with_context(|| format!("cannot write {}", path.display()))
}
