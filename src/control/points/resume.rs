//! What is noted of an import, so that one that was interrupted goes on where it was.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use chrono::Utc;
use sha2::{Digest as _, Sha256};

use super::import::Import;
use crate::control::{ControlError, ImportReport, Reading};
use crate::database::{Database, Transaction, query};

/// So much is read at both ends of a file to know it again: a model of a state has hundreds of gigabytes.
const ENDS_BYTES: u64 = 1 << 20;

/// What a file is known by: SHA-256 of its size, its beginning and its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileIdentity([u8; 32]);

impl FileIdentity {
    /// That of a file.
    ///
    /// # Errors
    /// [`std::io::Error`] if it cannot be read.
    pub fn of(path: &Path) -> std::io::Result<Self> {
        let mut file = File::open(path)?;
        let size = file.metadata()?.len();
        let mut hash = Sha256::new();
        hash.update(size.to_le_bytes());
        let mut ends = Vec::new();
        (&mut file).take(ENDS_BYTES).read_to_end(&mut ends)?;
        file.seek(SeekFrom::Start(size.saturating_sub(ENDS_BYTES)))?;
        file.take(ENDS_BYTES).read_to_end(&mut ends)?;
        hash.update(&ends);
        Ok(Self(hash.finalize().into()))
    }
}

/// An import that is under way.
pub(super) struct Begun {
    /// The number of its row.
    pub(super) id: i64,
    /// What has come of it.
    pub(super) report: ImportReport,
    /// Of what it reads, so many items are done.
    pub(super) items_done: usize,
}

/// Takes up an import of the same file into the same set that was interrupted, or begins one. It is the same only if it is
/// to be understood in the same way: what was written with a wrong system would stay.
pub(super) async fn begun(
    database: &Database,
    import: &Import,
    reading: &Reading,
    set_id: i64,
) -> Result<Begun, ControlError> {
    let file = import.file.map(|FileIdentity(file)| understood(file, import, reading));
    let mut transaction = database.begin_alone().await?;
    if let Some(file) = &file {
        if import.anew {
            query("UPDATE control_imports SET file = NULL WHERE file = $1 AND set_id = $2 AND ended_at IS NULL")
                .bind(file)
                .bind(set_id)
                .execute(&mut transaction)
                .await?;
        }
        let found: Option<(i64, i64, i64, i64, i64)> = query(
            "SELECT id, items_done, imported, updated, refused FROM control_imports
             WHERE file = $1 AND set_id = $2 AND ended_at IS NULL ORDER BY id DESC LIMIT 1",
        )
        .bind(file)
        .bind(set_id)
        .fetch_optional(&mut transaction)
        .await?;
        if let Some((id, items_done, imported, updated, refused)) = found {
            let [items_done, imported, updated, rejected_count] =
                [items_done, imported, updated, refused].map(|count| count.unsigned_abs() as usize);
            let resumed_at = Some(items_done);
            let report = ImportReport { imported, updated, rejected_count, resumed_at, ..ImportReport::default() };
            return Ok(Begun { id, report, items_done });
        }
    }
    let id = query("INSERT INTO control_imports (set_id, file, began_at) VALUES ($1, $2, $3) RETURNING id")
        .bind(set_id)
        .bind(file)
        .bind(Utc::now())
        .fetch_value(&mut transaction)
        .await?;
    transaction.commit().await?;
    Ok(Begun { id, report: ImportReport::default(), items_done: 0 })
}

/// What a file is known by together with how it is read.
fn understood(file: [u8; 32], import: &Import, reading: &Reading) -> Vec<u8> {
    let Reading { format, crs, geoid_undulation_m, defaults, heights_assumed: _ } = reading;
    let how = (import.mode, format, crs.as_ref().map(ToString::to_string), geoid_undulation_m, defaults);
    Sha256::new().chain_update(file).chain_update(format!("{how:?}")).finalize().to_vec()
}

/// Notes how far an import has come, together with what it has written.
pub(super) async fn note(
    transaction: &mut Transaction,
    id: i64,
    report: &ImportReport,
    items_done: usize,
) -> Result<(), ControlError> {
    query("UPDATE control_imports SET items_done = $1, imported = $2, updated = $3, refused = $4 WHERE id = $5")
        .bind(items_done as i64)
        .bind(report.imported as i64)
        .bind(report.updated as i64)
        .bind(report.rejected_count as i64)
        .bind(id)
        .execute(transaction)
        .await?;
    Ok(())
}

/// Notes that an import has come to its end.
pub(super) async fn end(transaction: &mut Transaction, id: i64) -> Result<(), ControlError> {
    query("UPDATE control_imports SET ended_at = $1 WHERE id = $2")
        .bind(Utc::now())
        .bind(id)
        .execute(transaction)
        .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn a_file_is_known_by_its_ends_and_its_size() {
        let identity = |bytes: &[u8]| {
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(bytes).unwrap();
            FileIdentity::of(file.path()).unwrap()
        };
        let long = vec![7_u8; 3 << 20];
        let (mut end, mut middle) = (long.clone(), long.clone());
        *end.last_mut().unwrap() = 8;
        middle[3 << 19] = 8;
        assert_eq!(identity(&long), identity(&middle));
        assert_ne!(identity(&long), identity(&end));
        assert_ne!(identity(b""), identity(b"a"));
        assert_ne!(identity(&long), identity(&long[1..]));
    }
}
