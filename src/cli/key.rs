//! `gable key`.

use crate::store::Store;
use crate::store::keys::{Role, random_secret};
use anyhow::bail;
use chrono::{DateTime, SecondsFormat, TimeDelta, Utc};
use clap::{Args, Subcommand};
use uuid::Uuid;

use super::{Settings, note, print};

const EXAMPLES: &str = "\
Examples:
  gable key new --role admin --name anna
      Makes a key and prints it, this once. Send it as `Authorization: Bearer <key>`.

  gable key new --role reader --name audit-2026 --expires 2027-01-01T00:00:00Z
      Makes a key that ends by itself.

  gable key list --data /srv/gable
      Shows all keys: id, role, name, when made, whether valid, when last used. The keys themselves are not stored.

  gable key revoke 0199f3c2-8d8e-7c60-a5e4-2f1d3c4b5a69
      Ends a key at once, also for a service that is running.";

/// Make, list and revoke keys of the API
///
/// Roles: a reader may look, an operator may also upload, import and orient, an admin may do everything.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Key {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Make a key and print it
    #[command(after_help = "Example:\n  gable key new --role operator --name production")]
    New {
        /// What it allows: reader, operator or admin.
        #[arg(long)]
        role: Role,
        /// Whose it is, or what for.
        #[arg(long, default_value = "")]
        name: String,
        /// When it ends by itself (RFC 3339).
        #[arg(long, value_name = "TIME", conflicts_with = "expires_in_days")]
        expires: Option<DateTime<Utc>>,
        /// After how many days it ends by itself.
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u32).range(1..=36_500))]
        expires_in_days: Option<u32>,
        #[command(flatten)]
        settings: Settings,
    },
    /// Show all keys
    #[command(after_help = "Example:\n  gable key list --data /srv/gable")]
    List {
        #[command(flatten)]
        settings: Settings,
    },
    /// End a key at once
    #[command(after_help = "Example:\n  gable key revoke 0199f3c2-8d8e-7c60-a5e4-2f1d3c4b5a69")]
    Revoke {
        /// The id that `gable key list` shows.
        id: Uuid,
        #[command(flatten)]
        settings: Settings,
    },
}

impl Key {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        match self.action {
            Action::New { role, name, expires, expires_in_days, settings } => {
                let expires = expires.or(expires_in_days.map(|days| Utc::now() + TimeDelta::days(days.into())));
                new(&open(&settings).await?, role, &name, expires).await
            }
            Action::List { settings } => list(&open(&settings).await?).await,
            Action::Revoke { id, settings } => revoke(&open(&settings).await?, id).await,
        }
    }
}

async fn open(settings: &Settings) -> anyhow::Result<Store> {
    Ok(Store::connect(&settings.gather(&[])?.place()).await?)
}

async fn new(store: &Store, role: Role, name: &str, expires: Option<DateTime<Utc>>) -> anyhow::Result<()> {
    if expires.is_some_and(|at| at <= Utc::now()) {
        bail!("the key would have expired already");
    }
    let secret = random_secret()?;
    let key = store.add_key(&secret, name, role, expires).await?;
    note(store, "gable key new", &key.id.to_string()).await?;
    tracing::info!(id = %key.id, %role, name, "made a key; it is shown only now");
    print(&secret)
}

async fn list(store: &Store) -> anyhow::Result<()> {
    for key in store.keys(None, u32::MAX).await? {
        let state = match (key.revoked_at, key.expires_at) {
            (Some(at), _) => format!("revoked {}", seconds(at)),
            (None, Some(at)) if key.has_expired() => format!("expired {}", seconds(at)),
            (None, Some(at)) => format!("valid until {}", seconds(at)),
            (None, None) => String::from("valid"),
        };
        let used = key.last_used_at.map_or_else(|| String::from("never used"), |at| format!("used {}", seconds(at)));
        let (id, role, name, made) = (key.id, key.role.name(), key.name, seconds(key.created_at));
        print(&format!("{id}  {role:<8}  {name:<20}  made {made}  {state}  {used}"))?;
    }
    Ok(())
}

fn seconds(time: DateTime<Utc>) -> String {
    time.to_rfc3339_opts(SecondsFormat::Secs, true)
}

async fn revoke(store: &Store, id: Uuid) -> anyhow::Result<()> {
    if !store.revoke_key(id).await? {
        bail!("there is no valid key with the id {id}");
    }
    note(store, "gable key revoke", &id.to_string()).await?;
    tracing::info!(%id, "revoked");
    Ok(())
}
