//! `gable account`.

use std::io::{BufRead as _, IsTerminal as _, Write as _};

use crate::store::accounts::{Change, check_name};
use crate::store::keys::Role;
use crate::store::{Store, passwords};
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, Subcommand};

use super::{Settings, note, print};

const EXAMPLES: &str = "\
Examples:
  gable account new anna --role operator
      Asks for a password, and makes an account to log in with.

  pass show gable/anna | gable account password anna
      Gives it another password, and logs it out everywhere.

  gable account disable anna
      Lets nobody log in with it any more, and logs it out everywhere.";

/// Make, list and change accounts of people who log in with a password
///
/// The password is the first line of the standard input.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct AccountCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Make an account
    #[command(after_help = "Example:\n  gable account new anna --role operator")]
    New {
        /// To log in with.
        name: String,
        /// What it allows: reader, operator or admin.
        #[arg(long)]
        role: Role,
        #[command(flatten)]
        settings: Settings,
    },
    /// Show all accounts
    #[command(after_help = "Example:\n  gable account list --data /srv/gable")]
    List {
        #[command(flatten)]
        settings: Settings,
    },
    /// Let nobody log in with an account any more
    #[command(after_help = "Example:\n  gable account disable anna")]
    Disable {
        /// The account's.
        name: String,
        #[command(flatten)]
        settings: Settings,
    },
    /// Give an account another password
    #[command(after_help = "Example:\n  gable account password anna")]
    Password {
        /// The account's.
        name: String,
        #[command(flatten)]
        settings: Settings,
    },
}

impl AccountCommand {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        match self.action {
            Action::New { name, role, settings } => new(&open(&settings).await?, &name, role).await,
            Action::List { settings } => list(&open(&settings).await?).await,
            Action::Disable { name, settings } => {
                let change = Change { disabled: Some(true), ..Change::default() };
                changed(&open(&settings).await?, &name, change, "gable account disable").await
            }
            Action::Password { name, settings } => {
                let store = open(&settings).await?;
                let change = Change { password: Some(asked().await?), ..Change::default() };
                changed(&store, &name, change, "gable account password").await
            }
        }
    }
}

async fn open(settings: &Settings) -> anyhow::Result<Store> {
    Ok(Store::connect(&settings.gather(&[])?.place()).await?)
}

async fn new(store: &Store, name: &str, role: Role) -> anyhow::Result<()> {
    check_name(name).map_err(|detail| anyhow!(detail))?;
    let password = asked().await?;
    let Some(account) = store.add_account(name, role, &password).await? else {
        bail!("there is an account {name:?} already");
    };
    note(store, "gable account new", &account.id.to_string()).await?;
    tracing::info!(id = %account.id, %role, name, "made an account");
    Ok(())
}

async fn list(store: &Store) -> anyhow::Result<()> {
    for account in store.accounts(None, u32::MAX).await? {
        let state = account.disabled_at.map_or_else(|| String::from("valid"), |at| format!("disabled {at:.0}"));
        print(&format!("{}  {:<8}  {:<20}  {state}", account.id, account.role.name(), account.name))?;
    }
    Ok(())
}

async fn changed(store: &Store, name: &str, change: Change, action: &str) -> anyhow::Result<()> {
    let account = store.account(name).await?;
    let (account, _) = account.ok_or_else(|| anyhow!("there is no account {name:?}"))?;
    store.change_account(account.id, &change).await?;
    note(store, action, &account.id.to_string()).await?;
    tracing::info!(id = %account.id, name, "changed the account");
    Ok(())
}

/// What is kept of the password that the user types, or that comes through a pipe.
async fn asked() -> anyhow::Result<String> {
    let mut input = std::io::stdin().lock();
    if input.is_terminal() {
        eprint!("Password: ");
        std::io::stderr().flush()?;
    }
    let mut line = String::new();
    input.read_line(&mut line).context("the password cannot be read")?;
    drop(input);
    Ok(passwords::hash(line.trim_end_matches(['\r', '\n']).to_owned()).await?)
}
