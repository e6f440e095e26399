//! Which addresses may be told.

use std::net::IpAddr;

use reqwest::Url;

use super::address::is_public;

const LONGEST: usize = 2000;

/// Which addresses may be told.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Policy {
    /// Names that may be told, `*.example.org` for all below one; empty: any that is public.
    pub hosts: Vec<String>,
    /// Whether this machine may be told, also by `http`; for tests.
    pub allow_loopback: bool,
}

impl Policy {
    /// The address, if it may be told.
    ///
    /// # Errors
    /// What is wrong with it, for the client.
    pub fn check(&self, text: &str) -> Result<Url, String> {
        if text.len() > LONGEST {
            return Err(format!("the address has more than {LONGEST} characters"));
        }
        let url = Url::parse(text).map_err(|error| format!("this is no address: {error}"))?;
        let host = url.host_str().unwrap_or_default().trim_end_matches('.').to_owned();
        match url.scheme() {
            "https" => {}
            "http" if self.allow_loopback && is_this_machine(&host) => {}
            _ => return Err(String::from("the address must begin with https://")),
        }
        if !url.username().is_empty() || url.password().is_some() || url.fragment().is_some() {
            return Err(String::from("the address must have no user, password or fragment"));
        }
        if !self.is_listed(&host) {
            return Err(format!("{host} is not among the hosts that this service may tell (webhook_hosts)"));
        }
        let public = match literal(&host) {
            Some(address) => self.allows(address),
            None => host.contains('.') && !is_this_machine(&host) || self.allow_loopback && is_this_machine(&host),
        };
        if !public {
            return Err(format!("{host} is not on the public internet"));
        }
        Ok(url)
    }

    /// Whether a connection may be made to this address.
    #[must_use]
    pub fn allows(&self, address: IpAddr) -> bool {
        is_public(address) || (self.allow_loopback && address.is_loopback())
    }

    fn is_listed(&self, host: &str) -> bool {
        let fits = |listed: &String| match listed.strip_prefix('*') {
            Some(end) => host.len() > end.len() && host.ends_with(end),
            None => host == listed,
        };
        self.hosts.is_empty() || self.hosts.iter().any(fits)
    }
}

/// The address that stands in place of a name. The parser of URLs has brought `127.1`, `0x7f.1` and the like to their
/// usual form.
fn literal(host: &str) -> Option<IpAddr> {
    host.trim_start_matches('[').trim_end_matches(']').parse().ok()
}

fn is_this_machine(host: &str) -> bool {
    let named = host == "localhost" || host.ends_with(".localhost");
    named || literal(host).is_some_and(|address| address.is_loopback())
}
