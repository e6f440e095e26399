//! What the settings of callers and receivers mean: logins, rates, webhooks.

use chrono::TimeDelta;

use super::{Configuration, ConfigurationError};
use crate::store::accounts::Lasting;
use crate::webhooks::{Policy as WebhookPolicy, Secret};

impl Configuration {
    /// Whether browsers are to send cookies back through TLS alone.
    #[must_use]
    pub fn cookies_are_secure(&self) -> bool {
        self.cookie_secure.unwrap_or(!self.listen.ip().is_loopback())
    }

    /// How long logins last.
    #[must_use]
    pub fn sessions_last(&self) -> Lasting {
        // `check` has seen that they are no longer than a year
        let seconds = |seconds: u64| TimeDelta::seconds(i64::try_from(seconds).unwrap_or(i64::from(i32::MAX)));
        Lasting { idle: seconds(self.session_idle_s), most: seconds(self.session_max_s) }
    }

    /// Which addresses webhooks may go to.
    #[must_use]
    pub fn webhook_policy(&self) -> WebhookPolicy {
        let hosts = self.webhook_hosts.split(',').map(|host| host.trim().to_ascii_lowercase());
        WebhookPolicy {
            hosts: hosts.filter(|host| !host.is_empty()).collect(),
            allow_loopback: self.webhook_allow_loopback,
        }
    }

    pub(super) fn check_callers(&self) -> Result<(), ConfigurationError> {
        let rates = [("rate_per_s", self.rate_per_s, 0.0), ("rate_burst", self.rate_burst, 1.0)];
        for (key, value, least) in rates {
            if !(least..=1e9).contains(&value) {
                let wanted = if least > 0.0 { "from 1 to 1e9" } else { "from 0 to 1e9" };
                return Err(ConfigurationError::OutOfRange { key, value: value.to_string(), wanted });
            }
        }
        if self.session_idle_s < 300 {
            let value = self.session_idle_s.to_string();
            return Err(ConfigurationError::OutOfRange { key: "session_idle_s", value, wanted: "at least 300" });
        }
        let host_fits = |host: &String| {
            let name = host.strip_prefix("*.").unwrap_or(host);
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._[]:".contains(&b))
        };
        if let Some(host) = self.webhook_policy().hosts.into_iter().find(|host| !host_fits(host)) {
            let wanted = "names of hosts with commas between them, *.example.org for all below one";
            return Err(ConfigurationError::OutOfRange { key: "webhook_hosts", value: host, wanted });
        }
        // its value is not told
        if self.webhook_secret.as_ref().is_some_and(|secret| secret.parse::<Secret>().is_err()) {
            let (value, wanted) = (String::from("malformed"), "whsec_ and 24 to 64 bytes in base64");
            return Err(ConfigurationError::OutOfRange { key: "webhook_secret", value, wanted });
        }
        Ok(())
    }
}
