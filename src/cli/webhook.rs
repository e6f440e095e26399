//! `gable webhook`.

use crate::store::Store;
use crate::webhooks;
use clap::{Args, Subcommand};

use super::{Settings, print};

/// What receivers of webhooks need to know
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gable webhook secret --data /srv/gable")]
pub(crate) struct Webhook {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Print the secret that webhooks are signed with
    #[command(after_help = "Example:\n  gable webhook secret --data /srv/gable")]
    Secret {
        #[command(flatten)]
        settings: Settings,
    },
}

impl Webhook {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let Action::Secret { settings } = self.action;
        let configuration = settings.gather(&[])?;
        let store = Store::connect(&configuration.place()).await?;
        let secret = webhooks::secret(&store, configuration.webhook_secret.as_deref()).await?;
        print(&secret.to_string())
    }
}
