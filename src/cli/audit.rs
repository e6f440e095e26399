//! `gable audit`.

use crate::store::Store;
use crate::store::audit::Verified;
use anyhow::bail;
use clap::{Args, Subcommand};

use super::{Settings, print};

/// Check the audit log
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gable audit verify --data /srv/gable")]
pub(crate) struct Audit {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Check that every row is as it was noted; status 1 if not
    ///
    /// Prints how many there are and the hash of the last one. Kept elsewhere, it shows later whether rows were cut off
    /// at the end.
    #[command(after_help = "Example:\n  gable audit verify --data /srv/gable")]
    Verify {
        #[command(flatten)]
        settings: Settings,
    },
}

impl Audit {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let Action::Verify { settings } = self.action;
        let store = Store::connect(&settings.gather(&[])?.place()).await?;
        match store.verify_audit().await? {
            Verified::Whole { rows, sha256 } => {
                let sha256: String = sha256.iter().map(|byte| format!("{byte:02x}")).collect();
                print(&format!("{rows} rows, all as they were noted; the last one has the hash {sha256}"))
            }
            Verified::Broken { number } => bail!("row {number} of the audit log is missing, or not what was noted"),
        }
    }
}
