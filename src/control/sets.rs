//! Named sets of control points: an area, a survey. Images are oriented by those that a request names.

use chrono::{DateTime, Utc};
use sqlx::FromRow;

use super::ControlError;
use super::points::remove_numbers;
use super::region::GeodeticBox;
use crate::database::{Database, Transaction, query};

/// Where an import names no set.
pub const DEFAULT_SET: &str = "default";
/// The longest name of a set.
pub const LONGEST_NAME: usize = 100;
/// The longest description of a set.
const LONGEST_DESCRIPTION: usize = 1_000;

/// A set.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct ControlSet {
    /// The number of its row.
    pub id: i64,
    /// Its unique name.
    pub name: String,
    /// What is in it.
    pub description: Option<String>,
    /// When it was surveyed.
    pub survey_year: Option<i64>,
    /// How many control points it has.
    pub points: i64,
    /// When it was first imported to.
    pub created_at: DateTime<Utc>,
}

/// What is said of a set that control points are written to; where there is none of its name it is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewSet {
    /// Its name.
    pub name: String,
    /// When it was surveyed; what is left out stays as it is.
    pub survey_year: Option<i64>,
    /// What is in it; what is left out stays as it is.
    pub description: Option<String>,
}

impl Default for NewSet {
    fn default() -> Self {
        Self { name: DEFAULT_SET.to_owned(), survey_year: None, description: None }
    }
}

impl NewSet {
    /// What is wrong with the name, the description or the year, and what would be right.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn check(&self) -> Result<(), String> {
        let name = &self.name;
        if name.trim().is_empty() || name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
            return Err(format!(
                "the name of a set must have 1 to {LONGEST_NAME} characters, none of them a control character"
            ));
        }
        let described = self.description.as_deref().unwrap_or_default().chars().count();
        if described > LONGEST_DESCRIPTION {
            return Err(format!("the description has {described} characters; at most {LONGEST_DESCRIPTION} are kept"));
        }
        match self.survey_year {
            Some(year) if !(1800..=2200).contains(&year) => Err(format!("{year} is no year of a survey")),
            _ => Ok(()),
        }
    }
}

/// The number of a set, which is made if there is none of its name.
pub(super) async fn found_or_made(database: &Database, set: &NewSet) -> Result<i64, ControlError> {
    Ok(query(
        "INSERT INTO control_sets (name, description, survey_year, created_at) VALUES ($1, $2, $3, $4)
         ON CONFLICT (name) DO UPDATE SET
             description = COALESCE(excluded.description, control_sets.description),
             survey_year = COALESCE(excluded.survey_year, control_sets.survey_year)
         RETURNING id",
    )
    .bind(&set.name)
    .bind(&set.description)
    .bind(set.survey_year)
    .bind(Utc::now())
    .fetch_value(database)
    .await?)
}

/// All sets, by name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn all(database: &Database) -> Result<Vec<ControlSet>, ControlError> {
    Ok(query("SELECT * FROM control_sets ORDER BY name").fetch_all(database).await?)
}

/// The set of a name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_name(database: &Database, name: &str) -> Result<Option<ControlSet>, ControlError> {
    Ok(query("SELECT * FROM control_sets WHERE name = $1").bind(name).fetch_optional(database).await?)
}

/// So many control points are removed in one transaction.
pub(super) const REMOVED_AT_ONCE: i64 = 20_000;

/// Removes a set with all its control points, some thousands at a time, so that others get to write in between; `false`
/// if there is none. The default set is emptied, and stays.
///
/// # Errors
/// [`ControlError`] if the database fails; what was removed by then is gone.
pub async fn remove(database: &Database, name: &str) -> Result<bool, ControlError> {
    let Some(set) = by_name(database, name).await? else { return Ok(false) };
    loop {
        let mut transaction = database.begin_alone().await?;
        let some: Vec<i64> = query("SELECT id FROM control_points WHERE set_id = $1 ORDER BY name LIMIT $2")
            .bind(set.id)
            .bind(REMOVED_AT_ONCE)
            .fetch_values(&mut transaction)
            .await?;
        if some.is_empty() {
            // an import that was interrupted would go on behind what is gone
            query("DELETE FROM control_imports WHERE set_id = $1").bind(set.id).execute(&mut transaction).await?;
            if name != DEFAULT_SET {
                query("DELETE FROM control_sets WHERE id = $1").bind(set.id).execute(&mut transaction).await?;
            }
            transaction.commit().await?;
            return Ok(true);
        }
        remove_numbers(&mut transaction, set.id, some).await?;
        transaction.commit().await?;
    }
}

/// Notes that a set has so many control points more.
pub(super) async fn counted(transaction: &mut Transaction, set_id: i64, more: i64) -> Result<(), ControlError> {
    query("UPDATE control_sets SET points = points + $1 WHERE id = $2")
        .bind(more)
        .bind(set_id)
        .execute(transaction)
        .await?;
    Ok(())
}

/// Notes that what is written into a set, beside what it has, lies in `region`, and keeps the set from being removed before
/// the transaction has ended.
pub(super) async fn widened(
    transaction: &mut Transaction,
    set_id: i64,
    region: GeodeticBox,
) -> Result<(), ControlError> {
    let GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg } = region;
    let found = query(
        "UPDATE control_sets SET
             min_lon_deg = CASE WHEN points > 0 AND min_lon_deg < $1 THEN min_lon_deg ELSE $1 END,
             max_lon_deg = CASE WHEN points > 0 AND max_lon_deg > $2 THEN max_lon_deg ELSE $2 END,
             min_lat_deg = CASE WHEN points > 0 AND min_lat_deg < $3 THEN min_lat_deg ELSE $3 END,
             max_lat_deg = CASE WHEN points > 0 AND max_lat_deg > $4 THEN max_lat_deg ELSE $4 END
         WHERE id = $5",
    )
    .bind(min_lon_deg)
    .bind(max_lon_deg)
    .bind(min_lat_deg)
    .bind(max_lat_deg)
    .bind(set_id)
    .execute(transaction)
    .await?;
    if found == 0 { Err(ControlError::SetRemoved) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_long_for_a_set_is_refused() {
        let of = |name: usize, description: usize| {
            let set =
                NewSet { name: "ä".repeat(name), description: Some("ä".repeat(description)), survey_year: None };
            set.check().err()
        };
        assert_eq!(of(100, 1_000), None);
        assert!(of(101, 0).unwrap().contains("1 to 100"));
        assert!(of(1, 1_001).unwrap().contains("1001 characters"));
    }
}
