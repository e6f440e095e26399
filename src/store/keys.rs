//! API keys. A key is 256 random bits; only its SHA-256 is kept, which is enough to know it again and useless to a thief.

use std::fmt;
use std::str::FromStr;

use chrono::{DateTime, Utc};
use rand::TryRngCore as _;
use rand::rngs::OsRng;
use sha2::{Digest as _, Sha256};
use sqlx::FromRow;
use subtle::ConstantTimeEq as _;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::query;

/// What a caller may do; each role may do all that the one before it may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Look.
    Reader,
    /// Upload, import, orient.
    Operator,
    /// Everything.
    Admin,
}

impl Role {
    /// All roles, the weakest first.
    pub const ALL: [Self; 3] = [Self::Reader, Self::Operator, Self::Admin];

    /// The role's name in the contract.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Reader => "reader",
            Self::Operator => "operator",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Not the name of a role.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} is not a role; the roles are reader, operator and admin")]
pub struct UnknownRole {
    /// What was given.
    pub name: String,
}

impl FromStr for Role {
    type Err = UnknownRole;

    fn from_str(name: &str) -> Result<Self, UnknownRole> {
        Self::ALL.into_iter().find(|role| role.name() == name).ok_or_else(|| UnknownRole { name: name.to_owned() })
    }
}

/// All that is known of a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    /// UUIDv7.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// What it allows.
    pub role: Role,
    /// When it was made.
    pub created_at: DateTime<Utc>,
    /// Since when it is not accepted any more.
    pub revoked_at: Option<DateTime<Utc>>,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    role: String,
    sha256: Vec<u8>,
    created_at: DateTime<Utc>,
    revoked_at: Option<DateTime<Utc>>,
}

impl TryFrom<Row> for Key {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let role = row.role.parse().map_err(|_| StoreError::Unknown { what: "role", value: row.role })?;
        Ok(Self { id: row.id, name: row.name, role, created_at: row.created_at, revoked_at: row.revoked_at })
    }
}

/// A new random key: `gable_` and 64 hexadecimal digits.
///
/// # Errors
/// If the operating system has no random numbers.
pub fn random_secret() -> Result<String, rand::rand_core::OsError> {
    let mut bytes = [0_u8; 32];
    OsRng.try_fill_bytes(&mut bytes)?;
    Ok(bytes.iter().fold(String::from("gable_"), |text, byte| format!("{text}{byte:02x}")))
}

fn digest(secret: &str) -> [u8; 32] {
    Sha256::digest(secret.as_bytes()).into()
}

impl Store {
    /// Remembers a key.
    ///
    /// # Errors
    /// [`StoreError::Database`], also if the same key is there already.
    pub async fn add_key(&self, secret: &str, name: &str, role: Role) -> Result<Key, StoreError> {
        let key = Key { id: Uuid::now_v7(), name: name.to_owned(), role, created_at: now(), revoked_at: None };
        query("INSERT INTO keys (id, name, role, sha256, created_at) VALUES ($1, $2, $3, $4, $5)")
            .bind(key.id)
            .bind(&key.name)
            .bind(role.name())
            .bind(digest(secret).as_slice())
            .bind(key.created_at)
            .execute(&self.database)
            .await?;
        Ok(key)
    }

    /// The key that this secret belongs to; `None` if there is none or it was revoked.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn key(&self, secret: &str) -> Result<Option<Key>, StoreError> {
        let sha256 = digest(secret);
        let row: Option<Row> = query("SELECT * FROM keys WHERE sha256 = $1 AND revoked_at IS NULL")
            .bind(sha256.as_slice())
            .fetch_optional(&self.database)
            .await?;
        row.filter(|row| bool::from(row.sha256.ct_eq(&sha256))).map(Key::try_from).transpose()
    }

    /// Whether a key was ever made. Revoked ones count: taking the last key away must not open the door.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn any_key(&self) -> Result<bool, StoreError> {
        Ok(query("SELECT EXISTS (SELECT 1 FROM keys)").fetch_value(&self.database).await?)
    }

    /// All keys, the newest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn keys(&self) -> Result<Vec<Key>, StoreError> {
        let rows: Vec<Row> = query("SELECT * FROM keys ORDER BY id DESC").fetch_all(&self.database).await?;
        rows.into_iter().map(Key::try_from).collect()
    }

    /// Revokes a key at once; `false` if there is none with this id that is still valid.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn revoke_key(&self, id: Uuid) -> Result<bool, StoreError> {
        let done = query("UPDATE keys SET revoked_at = $1 WHERE id = $2 AND revoked_at IS NULL")
            .bind(now())
            .bind(id)
            .execute(&self.database)
            .await?;
        Ok(done == 1)
    }
}
