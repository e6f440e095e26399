//! Accounts of people, and who is logged in.
//!
//! A session is 256 random bits in a cookie, of which the SHA-256 is kept. It is looked up with its account at every
//! request: an account that is disabled, or whose role or password was changed, is so at once.

use chrono::{DateTime, TimeDelta, Utc};
use sqlx::FromRow;
use subtle::ConstantTimeEq as _;
use uuid::Uuid;

use super::keys::{Role, digest};
use super::{Store, StoreError, now};
use crate::database::query;

/// How often the use of a session is noted.
const USE_NOTED_EVERY: TimeDelta = TimeDelta::minutes(1);

/// All that may be told of an account.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Account {
    /// UUIDv7.
    pub id: Uuid,
    /// For logging in; it does not change.
    pub name: String,
    /// What it allows.
    pub role: Role,
    /// When it was made.
    pub created_at: DateTime<Utc>,
    /// Since when nobody can log in with it.
    pub disabled_at: Option<DateTime<Utc>>,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    role: String,
    created_at: DateTime<Utc>,
    disabled_at: Option<DateTime<Utc>>,
}

impl TryFrom<Row> for Account {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let role = role(row.role)?;
        Ok(Self { id: row.id, name: row.name, role, created_at: row.created_at, disabled_at: row.disabled_at })
    }
}

fn role(name: String) -> Result<Role, StoreError> {
    name.parse().map_err(|_| StoreError::Unknown { what: "role", value: name })
}

/// What of an account is to change; what is none stays.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Change {
    /// What it allows.
    pub role: Option<Role>,
    /// Whether nobody can log in with it.
    pub disabled: Option<bool>,
    /// What is kept of a new password.
    pub password: Option<String>,
}

/// How long sessions last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lasting {
    /// Without being used.
    pub idle: TimeDelta,
    /// At the most.
    pub most: TimeDelta,
}

/// Somebody who is logged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Session {
    /// Of the account.
    pub name: String,
    /// Of the account.
    pub role: Role,
    /// Whether its use is worth a note: the last one is a minute old.
    pub use_is_worth_a_note: bool,
}

#[derive(FromRow)]
struct SessionRow {
    sha256: Vec<u8>,
    name: String,
    role: String,
    created_at: DateTime<Utc>,
    used_at: DateTime<Utc>,
}

const COLUMNS: &str = "SELECT id, name, role, created_at, disabled_at FROM accounts WHERE TRUE";

impl Store {
    /// Makes an account; none if the name is taken. `password` is what is kept of it (`passwords::hash`).
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_account(&self, name: &str, role: Role, password: &str) -> Result<Option<Account>, StoreError> {
        let account = Account { id: Uuid::now_v7(), name: name.to_owned(), role, created_at: now(), disabled_at: None };
        let insert = query(
            "INSERT INTO accounts (id, name, role, password, created_at) VALUES ($1, $2, $3, $4, $5)
             ON CONFLICT (name) DO NOTHING",
        );
        let insert = insert.bind(account.id).bind(name).bind(role.name()).bind(password).bind(account.created_at);
        Ok((insert.execute(&self.database).await? == 1).then_some(account))
    }

    /// At most `limit` accounts, the newest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn accounts(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<Account>, StoreError> {
        let rows = query(COLUMNS).and("id < ?", before).then(" ORDER BY id DESC LIMIT ?").bind(limit);
        let rows: Vec<Row> = rows.fetch_all(&self.database).await?;
        rows.into_iter().map(Account::try_from).collect()
    }

    /// The account with this name, and what is kept of its password.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn account(&self, name: &str) -> Result<Option<(Account, String)>, StoreError> {
        let row: Option<Row> = query(COLUMNS).and("name = ?", Some(name)).fetch_optional(&self.database).await?;
        let Some(row) = row else { return Ok(None) };
        let kept = query("SELECT password FROM accounts WHERE id = $1").bind(row.id);
        let kept: String = kept.fetch_value(&self.database).await?;
        Ok(Some((row.try_into()?, kept)))
    }

    /// Changes an account, as it is then; none if there is none. Who is logged in with it is logged out by a new password,
    /// and when it is disabled.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn change_account(&self, id: Uuid, change: &Change) -> Result<Option<Account>, StoreError> {
        let mut transaction = self.database.begin().await?;
        if let Some(role) = change.role {
            let update = query("UPDATE accounts SET role = $1 WHERE id = $2").bind(role.name()).bind(id);
            update.execute(&mut transaction).await?;
        }
        if let Some(disabled) = change.disabled {
            let update = query("UPDATE accounts SET disabled_at = $1 WHERE id = $2").bind(disabled.then(now)).bind(id);
            update.execute(&mut transaction).await?;
        }
        if let Some(password) = &change.password {
            let update = query("UPDATE accounts SET password = $1 WHERE id = $2").bind(password).bind(id);
            update.execute(&mut transaction).await?;
        }
        if change.password.is_some() || change.disabled == Some(true) {
            query("DELETE FROM sessions WHERE account_id = $1").bind(id).execute(&mut transaction).await?;
        }
        let row: Option<Row> = query(COLUMNS).and("id = ?", Some(id)).fetch_optional(&mut transaction).await?;
        transaction.commit().await?;
        row.map(Account::try_from).transpose()
    }

    /// Logs an account in, and out what was logged in by the cookie that the browser had before. Sessions that have ended
    /// by themselves are forgotten.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn begin_session(
        &self,
        secret: &str,
        account: Uuid,
        former: Option<&str>,
        lasting: Lasting,
    ) -> Result<(), StoreError> {
        let mut transaction = self.database.begin().await?;
        query("DELETE FROM sessions WHERE created_at < $1")
            .bind(now() - lasting.most)
            .execute(&mut transaction)
            .await?;
        query("DELETE FROM sessions WHERE used_at < $1").bind(now() - lasting.idle).execute(&mut transaction).await?;
        if let Some(former) = former {
            let delete = query("DELETE FROM sessions WHERE sha256 = $1").bind(digest(former).as_slice());
            delete.execute(&mut transaction).await?;
        }
        let insert = query("INSERT INTO sessions (sha256, account_id, created_at, used_at) VALUES ($1, $2, $3, $4)");
        let insert = insert.bind(digest(secret).as_slice()).bind(account).bind(now()).bind(now());
        insert.execute(&mut transaction).await?;
        Ok(transaction.commit().await?)
    }

    /// Who is logged in by this cookie; none if nobody is, any more.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn session(&self, secret: &str, lasting: Lasting) -> Result<Option<Session>, StoreError> {
        let sha256 = digest(secret);
        let row: Option<SessionRow> = query(
            "SELECT sessions.sha256, name, role, sessions.created_at, used_at
             FROM sessions JOIN accounts ON accounts.id = account_id
             WHERE sessions.sha256 = $1 AND disabled_at IS NULL",
        )
        .bind(sha256.as_slice())
        .fetch_optional(&self.database)
        .await?;
        let lasts = |row: &SessionRow| now() - row.created_at < lasting.most && now() - row.used_at < lasting.idle;
        let row = row.filter(|row| bool::from(row.sha256.ct_eq(&sha256)) && lasts(row));
        row.map(|row| {
            let use_is_worth_a_note = now() - row.used_at >= USE_NOTED_EVERY;
            Ok(Session { name: row.name, role: role(row.role)?, use_is_worth_a_note })
        })
        .transpose()
    }

    /// Notes that a session was used just now.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_use_of_session(&self, secret: &str) -> Result<(), StoreError> {
        let update = query("UPDATE sessions SET used_at = $1 WHERE sha256 = $2").bind(now());
        update.bind(digest(secret).as_slice()).execute(&self.database).await?;
        Ok(())
    }

    /// Logs out.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn end_session(&self, secret: &str) -> Result<(), StoreError> {
        let delete = query("DELETE FROM sessions WHERE sha256 = $1").bind(digest(secret).as_slice());
        delete.execute(&self.database).await?;
        Ok(())
    }
}

/// Whether an account may have this name.
///
/// # Errors
/// What is wrong with it.
pub fn check_name(name: &str) -> Result<(), &'static str> {
    let fits = |c: char| c.is_alphanumeric() || ".-_@".contains(c);
    match (1..=100).contains(&name.chars().count()) && name.chars().all(fits) {
        true => Ok(()),
        false => Err("a name has 1 to 100 letters, digits, `.`, `_`, `-` and `@`"),
    }
}
