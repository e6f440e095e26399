//! Passwords, of which only Argon2id is kept, with the parameters that OWASP names: 19 MiB, two passes, one lane.

use std::sync::LazyLock;

use argon2::Argon2;
use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher as _, PasswordVerifier as _};
use tokio::sync::Semaphore;

/// Fewest and most characters of a password.
pub const LENGTHS: std::ops::RangeInclusive<usize> = 12..=256;

/// Passwords hashed at a time: each takes 19 MiB and a processor core for tens of milliseconds.
static HASHING: Semaphore = Semaphore::const_new(2);

/// A hash that belongs to no password that anybody knows: an account that is not there takes as long as one that is.
static NOBODY: LazyLock<Option<String>> = LazyLock::new(|| {
    let mut bytes = [0_u8; 32];
    rand::TryRngCore::try_fill_bytes(&mut rand::rngs::OsRng, &mut bytes).ok()?;
    Argon2::default().hash_password(&bytes).ok().map(|hash| hash.to_string())
});

/// Why a password cannot be hashed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PasswordError {
    /// Too short or too long.
    #[error("a password must have from {} to {} characters", LENGTHS.start(), LENGTHS.end())]
    Length,
    /// No memory, or no random numbers.
    #[error("the password cannot be hashed: {detail}")]
    Hash {
        /// The cause.
        detail: String,
    },
}

/// What is kept of a password: a PHC string with a salt of its own.
///
/// # Errors
/// [`PasswordError`].
pub async fn hash(password: String) -> Result<String, PasswordError> {
    if !LENGTHS.contains(&password.chars().count()) {
        return Err(PasswordError::Length);
    }
    let hashed = alone(move || Argon2::default().hash_password(password.as_bytes()).map(|hash| hash.to_string()));
    hashed.await?.map_err(|error| PasswordError::Hash { detail: error.to_string() })
}

/// Whether it is the password that `kept` was made of. Without one it is not, after as long a time.
///
/// # Errors
/// [`PasswordError::Hash`].
pub async fn is_right(kept: Option<String>, password: String) -> Result<bool, PasswordError> {
    alone(move || {
        let there = kept.is_some();
        let Some(kept) = kept.or_else(|| NOBODY.clone()) else { return false };
        let parsed = PasswordHash::new(&kept);
        let right = parsed.is_ok_and(|kept| Argon2::default().verify_password(password.as_bytes(), &kept).is_ok());
        right && there
    })
    .await
}

/// On a thread of its own, with few others.
async fn alone<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, PasswordError> {
    let permit = HASHING.acquire().await.map_err(|error| PasswordError::Hash { detail: error.to_string() })?;
    let done = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        work()
    });
    done.await.map_err(|error| PasswordError::Hash { detail: error.to_string() })
}
