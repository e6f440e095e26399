//! API keys. A key is 256 random bits; only its SHA-256 is kept, which is enough to know it again and useless to a thief.

use std::fmt;
use std::str::FromStr;
use std::time::Instant;

use chrono::{DateTime, SubsecRound as _, TimeDelta, Utc};
use rand::TryRngCore as _;
use rand::rngs::OsRng;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use sqlx::FromRow;
use subtle::ConstantTimeEq as _;
use utoipa::ToSchema;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::query;

/// What a caller may do; each role may do all that the one before it may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
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
    /// When it ends by itself.
    pub expires_at: Option<DateTime<Utc>>,
    /// When it was last used, to the minute.
    pub last_used_at: Option<DateTime<Utc>>,
}

/// How often the use of a key is noted.
const USE_NOTED_EVERY: TimeDelta = TimeDelta::minutes(1);

impl Key {
    /// Whether it has ended by itself.
    #[must_use]
    pub fn has_expired(&self) -> bool {
        self.expires_at.is_some_and(|at| at <= now())
    }

    /// Whether its use is worth a note: the last one is a minute old.
    #[must_use]
    pub fn use_is_worth_a_note(&self) -> bool {
        self.last_used_at.is_none_or(|at| now() - at >= USE_NOTED_EVERY)
    }
}

/// What somebody has shown to be let in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Presented {
    /// A key that is valid.
    Valid(Key),
    /// One that has ended by itself.
    Expired(Key),
    /// None, or one that was revoked.
    Unknown,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    role: String,
    sha256: Vec<u8>,
    created_at: DateTime<Utc>,
    revoked_at: Option<DateTime<Utc>>,
    expires_at: Option<DateTime<Utc>>,
    last_used_at: Option<DateTime<Utc>>,
}

impl TryFrom<Row> for Key {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let role = row.role.parse().map_err(|_| StoreError::Unknown { what: "role", value: row.role })?;
        Ok(Self {
            id: row.id,
            name: row.name,
            role,
            created_at: row.created_at,
            revoked_at: row.revoked_at,
            expires_at: row.expires_at,
            last_used_at: row.last_used_at,
        })
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

/// What is kept of a key or a session.
pub(super) fn digest(secret: &str) -> [u8; 32] {
    Sha256::digest(secret.as_bytes()).into()
}

impl Store {
    /// Remembers a key, which may end by itself.
    ///
    /// # Errors
    /// [`StoreError::Database`], also if the same key is there already.
    pub async fn add_key(
        &self,
        secret: &str,
        name: &str,
        role: Role,
        expires_at: Option<DateTime<Utc>>,
    ) -> Result<Key, StoreError> {
        let key = Key {
            id: Uuid::now_v7(),
            name: name.to_owned(),
            role,
            created_at: now(),
            revoked_at: None,
            expires_at: expires_at.map(|at| at.trunc_subsecs(6)),
            last_used_at: None,
        };
        query("INSERT INTO keys (id, name, role, sha256, created_at, expires_at) VALUES ($1, $2, $3, $4, $5, $6)")
            .bind(key.id)
            .bind(&key.name)
            .bind(role.name())
            .bind(digest(secret).as_slice())
            .bind(key.created_at)
            .bind(key.expires_at)
            .execute(&self.database)
            .await?;
        Ok(key)
    }

    /// The key that this secret belongs to, as it was at most a moment ago: one that another process revokes ends within
    /// a second.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn key(&self, secret: &str) -> Result<Presented, StoreError> {
        let (sha256, began) = (digest(secret), Instant::now());
        match self.recent_keys.get(&sha256) {
            Some(Presented::Valid(key)) if key.has_expired() => return Ok(Presented::Expired(key)),
            Some(presented) => return Ok(presented),
            None => {}
        }
        let row: Option<Row> = query("SELECT * FROM keys WHERE sha256 = $1 AND revoked_at IS NULL")
            .bind(sha256.as_slice())
            .fetch_optional(&self.database)
            .await?;
        let row = row.filter(|row| bool::from(row.sha256.ct_eq(&sha256)));
        let presented = match row.map(Key::try_from).transpose()? {
            Some(key) if key.has_expired() => Presented::Expired(key),
            Some(key) => Presented::Valid(key),
            None => return Ok(Presented::Unknown),
        };
        self.recent_keys.put(sha256, presented.clone(), began);
        Ok(presented)
    }

    /// Notes that a key was used just now.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_use_of_key(&self, id: Uuid) -> Result<(), StoreError> {
        query("UPDATE keys SET last_used_at = $1 WHERE id = $2").bind(now()).bind(id).execute(&self.database).await?;
        self.recent_keys.forget_all();
        Ok(())
    }

    /// Whether a key or an account was ever made. Revoked and disabled ones count: taking the last one away must not open
    /// the door.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn any_key(&self) -> Result<bool, StoreError> {
        let any = query("SELECT EXISTS (SELECT 1 FROM keys) OR EXISTS (SELECT 1 FROM accounts)");
        Ok(any.fetch_value(&self.database).await?)
    }

    /// At most `limit` keys, the newest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn keys(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<Key>, StoreError> {
        let rows = query("SELECT * FROM keys WHERE TRUE").and("id < ?", before).then(" ORDER BY id DESC LIMIT ?");
        let rows: Vec<Row> = rows.bind(limit).fetch_all(&self.database).await?;
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
        self.recent_keys.forget_all();
        Ok(done == 1)
    }
}
