//! `gable openapi`.

use clap::Args;

const EXAMPLES: &str = "\
Examples:
  gable openapi > openapi/gable.json
      Renews the copy in the repository, which a test holds against the program.

  gable openapi | openapi-python-client generate --path /dev/stdin
      Generates a client.";

/// Print the HTTP contract as an OpenAPI 3.1 document
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct OpenApi {}

impl OpenApi {
    #[expect(clippy::unused_self, reason = "as all commands are run")]
    pub(crate) fn run(self) -> anyhow::Result<()> {
        super::print(&crate::http::document().to_pretty_json()?)
    }
}
