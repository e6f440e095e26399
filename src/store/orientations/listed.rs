//! Lists of orientations.

use chrono::{DateTime, Utc};
use uuid::Uuid;

use super::{Orientation, Row, Status};
use crate::database::{Query, containing, query};
use crate::store::{Store, StoreError};

/// What a list of orientations is restricted to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Filter {
    /// Only of this status.
    pub status: Option<Status>,
    /// Only with this verdict.
    pub verdict: Option<String>,
    /// Only of this state of their review.
    pub review: Option<Review>,
    /// Only with a reason of this code.
    pub reason: Option<String>,
    /// Only of this image.
    pub image_id: Option<Uuid>,
    /// Only by this camera.
    pub camera_id: Option<Uuid>,
    /// Only of this block.
    pub block_id: Option<Uuid>,
    /// Only those whose image has this in its name, or whose id, or that of their image, begins with it.
    pub text: Option<String>,
    /// Only those asked for at this time or later.
    pub since: Option<DateTime<Utc>>,
    /// Only those asked for before this time.
    pub until: Option<DateTime<Utc>>,
    /// Only those with a smaller id.
    pub before: Option<Uuid>,
}

/// What staff have decided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Review {
    /// Nothing yet, of one that has succeeded.
    Open,
    /// That it is right.
    Accepted,
    /// That it is wrong.
    Rejected,
}

/// Digits with which an id may be looked for: fewer are those of all ids of a minute.
const ID_DIGITS_MIN: usize = 8;

impl Store {
    /// At most `limit` orientations, the newest first. Results and drawings are left out.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientations(&self, filter: &Filter, limit: u32) -> Result<Vec<Orientation>, StoreError> {
        let rows: Vec<Row> = listed(filter, limit).fetch_all(&self.database).await?;
        rows.into_iter().map(Orientation::try_from).collect()
    }
}

/// Columns with the names of what an orientation `o` refers to.
pub(super) const NAMES: &str = ", (SELECT name FROM images WHERE images.id = o.image_id) AS image_name,
     (SELECT name FROM cameras WHERE cameras.id = o.camera_id) AS camera_name,
     (SELECT block_id FROM block_images WHERE orientation_id = o.id LIMIT 1) AS block_id";

pub(super) fn listed(filter: &Filter, limit: u32) -> Query {
    let columns = query(
        "SELECT o.id, o.image_id, o.camera_id, o.prepared, o.status, o.stage, o.progress, o.attempts, o.error_code,
         o.error, o.verdict, CAST(NULL AS TEXT) AS result, CAST(NULL AS TEXT) AS drawing, o.created_at, o.started_at,
         o.finished_at, o.fate, o.priority, o.turn, o.diagnosis, o.review",
    )
    .then(NAMES);
    // those with a reason are walked along its index: they may be few among many
    let (columns, before, order) = match &filter.reason {
        None => (columns.then(" FROM orientations AS o WHERE TRUE"), "o.id < ?", " ORDER BY o.id DESC LIMIT ?"),
        Some(code) => (
            columns
                .then(
                    " FROM orientation_reasons AS r JOIN orientations AS o ON o.id = r.orientation_id WHERE r.code = ?",
                )
                .bind(code),
            "r.orientation_id < ?",
            " ORDER BY r.orientation_id DESC LIMIT ?",
        ),
    };
    let kept = columns
        .and("o.status = ?", filter.status.map(Status::name))
        .and("o.verdict = ?", filter.verdict.as_deref())
        .and("o.image_id = ?", filter.image_id)
        .and("o.camera_id = ?", filter.camera_id)
        .and("o.id IN (SELECT orientation_id FROM block_images WHERE block_id = ?)", filter.block_id)
        .and("o.created_at >= ?", filter.since)
        .and("o.created_at < ?", filter.until)
        .and(before, filter.before);
    let kept = match filter.review {
        None => kept,
        Some(Review::Open) => kept.then(" AND o.status = 'succeeded' AND o.review IS NULL"),
        Some(Review::Accepted) => kept.then(" AND o.review = 'accepted'"),
        Some(Review::Rejected) => kept.then(" AND o.review = 'rejected'"),
    };
    let kept = match &filter.text {
        None => kept,
        Some(text) => with_text(kept, text),
    };
    kept.then(order).bind(limit)
}

fn with_text(query: Query, text: &str) -> Query {
    let named = query
        .then(" AND (lower((SELECT name FROM images WHERE images.id = o.image_id)) LIKE lower(?) ESCAPE '\\'")
        .bind(containing(text));
    let Some([first, last]) = ids_beginning_with(text) else { return named.then(")") };
    named
        .then(" OR (o.id >= ?")
        .bind(first)
        .then(" AND o.id <= ?)")
        .bind(last)
        .then(" OR (o.image_id >= ?")
        .bind(first)
        .then(" AND o.image_id <= ?))")
        .bind(last)
}

/// The first and the last id that begin with these hexadecimal digits, with or without hyphens.
fn ids_beginning_with(text: &str) -> Option<[Uuid; 2]> {
    let digits = text.replace('-', "");
    let possible = (ID_DIGITS_MIN..=32).contains(&digits.len()) && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let filled = |rest: &str| Uuid::try_parse(&format!("{digits}{}", rest.repeat(32 - digits.len()))).ok();
    if possible { Some([filled("0")?, filled("f")?]) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_found_by_their_first_digits() {
        let range = |text| ids_beginning_with(text).map(|ids| ids.map(|id| id.to_string()));
        let between = |a: &str, b: &str| Some([a.to_owned(), b.to_owned()]);
        assert_eq!(
            range("019A1b2c-3"),
            between("019a1b2c-3000-0000-0000-000000000000", "019a1b2c-3fff-ffff-ffff-ffffffffffff")
        );
        let whole = "019a1b2c-3d4e-7f60-8123-456789abcdef";
        assert_eq!(range(whole), between(whole, whole));
        for text in ["019a1b2", "019a1b2g", "", "IMG_0042.JPG", &"0".repeat(33), "019a1b2ü"] {
            assert_eq!(range(text), None, "{text}");
        }
    }
}
