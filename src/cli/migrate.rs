//! `gable migrate`.

use crate::database::Database;
use crate::store::Store;
use clap::Args;

use super::{Settings, print};

const EXAMPLES: &str = "\
Examples:
  gable migrate --database-url postgres://gable@db/gable
      Makes the tables, or brings them to this version. Run it before the services and workers of a new version; it waits \
      for another one that is at it.

  gable backup --to /backup/before && gable migrate
      There is no way back but the backup.";

/// Make the tables of the database, or bring them up to date
///
/// SQLite is brought up to date by every start anyway. PostgreSQL needs the trusted extensions pgcrypto and hstore; where
/// the user may not make them, the answer says what an administrator has to run.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Migrate {
    #[command(flatten)]
    settings: Settings,
}

impl Migrate {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let configuration = self.settings.gather(&[])?;
        match &configuration.database_url {
            Some(url) => Database::postgres(url).await?.migrate().await?,
            None => Store::connect(&configuration.place()).await?.close().await,
        }
        print("the tables are those of this version")
    }
}
