//! The built binary: settings, keys, signals.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

pub(crate) fn gable(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gable"));
    command
        .current_dir(folder)
        .args(arguments)
        .env_remove("GABLE_BOOTSTRAP_KEY")
        .env("GABLE_DATA", folder.join("data"));
    command
}

fn output(command: &mut Command) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}

/// A service on a free port, ended with the test.
pub(crate) struct Serving {
    pub(crate) child: Child,
    pub(crate) address: String,
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Serving {
    pub(crate) fn start(command: &mut Command) -> Self {
        let mut child = command.env("GABLE_LISTEN", "127.0.0.1:0").stderr(Stdio::piped()).spawn().unwrap();
        let mut log = BufReader::new(child.stderr.take().unwrap());
        let mut address = None;
        while address.is_none() {
            let mut line = String::new();
            assert_ne!(log.read_line(&mut line).unwrap(), 0, "the service has ended");
            address =
                line.split_once("listening on http://").map(|(_, rest)| rest.split(',').next().unwrap().to_owned());
        }
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        Self { child, address: address.unwrap() }
    }

    pub(crate) fn get(&self, path: &str, key: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let authorization = if key.is_empty() { String::new() } else { format!("Authorization: Bearer {key}\r\n") };
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n{authorization}Connection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    fn send(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    fn ended_within(&mut self, patience: Duration) -> Option<i32> {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(began.elapsed() < patience, "the service has not ended within {patience:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

#[test]
fn settings_that_cannot_be_used_end_it_with_status_2_and_one_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("unknown.toml"), "uplod_max_bytes = 5\n").unwrap();
    std::fs::write(folder.path().join("type.toml"), "wait_max_s = \"long\"\n").unwrap();
    std::fs::write(folder.path().join("broken.toml"), "listen = \n").unwrap();
    type Variables<'a> = &'a [(&'a str, &'a str)];
    let cases: [(&[&str], Variables<'_>, &str); 19] = [
        (&["serve", "--config", "missing.toml"], &[], "missing.toml"),
        (&["serve", "--config", "unknown.toml"], &[], "uplod_max_bytes"),
        (&["serve", "--config", "type.toml"], &[], "wait_max_s"),
        (&["serve", "--config", "broken.toml"], &[], "broken.toml"),
        (&["serve", "--listen", "nowhere"], &[], "listen"),
        (&["serve"], &[("GABLE_LISTEN", "127.0.0.1:99999")], "listen"),
        (&["serve"], &[("GABLE_UPLOAD_MAX_BYTES", "many")], "upload_max_bytes"),
        (&["serve"], &[("GABLE_UPLOAD_MAX_BYTES", "0")], "upload_max_bytes is 0"),
        (&["serve"], &[("GABLE_HEAD_TIMEOUT_S", "99999999999")], "head_timeout_s is 99999999999"),
        (&["serve"], &[("GABLE_RATE_PER_S", "-1")], "rate_per_s is -1"),
        (&["serve"], &[("GABLE_RATE_BURST", "0")], "rate_burst is 0"),
        (&["serve"], &[("GABLE_REQUESTS_MAX", "0")], "requests_max is 0"),
        (&["serve"], &[("GABLE_SESSION_IDLE_S", "1")], "session_idle_s is 1"),
        (&["serve"], &[("GABLE_WEBHOOK_HOSTS", "https://example.org/")], "webhook_hosts is https://example.org/"),
        (&["serve"], &[("GABLE_WEBHOOK_SECRET", "whsec_c2hvcnQ=")], "webhook_secret is malformed"),
        (&["serve"], &[("GABLE_COOKIE_SECURE", "perhaps")], "cookie_secure"),
        (&["serve"], &[("GABLE_LOG_FORMAT", "xml")], "log_format"),
        (&["serve"], &[("GABLE_LOG", "gable=loud")], "log is"),
        (&["serve"], &[("GABLE_BOOTSTRAP_KEY", "short")], "GABLE_BOOTSTRAP_KEY"),
    ];
    for (arguments, variables, named) in cases {
        let (status, _, errors) = output(gable(folder.path(), arguments).envs(variables.iter().copied()));
        assert_eq!(status, Some(2), "{arguments:?} {variables:?}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{errors}");
        assert!(errors.contains(named), "{named}: {errors}");
    }
}

#[test]
fn service_for_the_network_does_not_start_without_a_key() {
    let folder = tempfile::tempdir().unwrap();
    let (status, _, errors) = output(&mut gable(folder.path(), &["serve", "--listen", "0.0.0.0:0"]));
    assert_eq!(status, Some(2));
    assert!(errors.contains("there is no key") && errors.lines().count() == 1, "{errors}");
}

#[test]
fn a_cause_is_told_once() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let folder = tempfile::tempdir().unwrap();
    let (status, _, errors) = output(&mut gable(folder.path(), &["serve", "--listen", &address]));
    let why = std::io::Error::from(rustix::io::Errno::ADDRINUSE).to_string();
    assert_eq!(status, Some(1));
    assert_eq!((errors.contains(&address), errors.matches(&why).count()), (true, 1), "{errors}");
}

#[test]
fn two_services_do_not_share_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let _first = Serving::start(&mut gable(folder.path(), &["serve"]));
    let (status, _, errors) = output(&mut gable(folder.path(), &["serve", "--listen", "127.0.0.1:0"]));
    assert_eq!(status, Some(1));
    assert!(errors.contains("in use by another gable service"), "{errors}");
}

#[test]
fn help_shows_every_setting() {
    let folder = tempfile::tempdir().unwrap();
    let (_, help, _) = output(&mut gable(folder.path(), &["serve", "--help"]));
    let settings = gable::configuration::Configuration::settings();
    assert!(settings.len() > 20);
    for setting in settings {
        assert!(
            !setting.about.is_empty() && help.contains(&format!("{} = {}", setting.name, setting.default)),
            "{setting:?}"
        );
    }
}

#[test]
fn flags_count_more_than_the_environment_and_that_more_than_the_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("gable.toml"), "data = 'from-file'\n").unwrap();
    let made = |name: &str| folder.path().join(name).join("gable.db").exists();
    let list = || gable(folder.path(), &["key", "list", "--config", "gable.toml"]);
    assert_eq!(output(list().env_remove("GABLE_DATA")).0, Some(0));
    assert!(made("from-file"));
    assert_eq!(output(list().env("GABLE_DATA", "from-environment")).0, Some(0));
    assert!(made("from-environment"));
    assert_eq!(output(list().args(["--data", "from-flag"]).env("GABLE_DATA", "unused")).0, Some(0));
    assert!(made("from-flag") && !made("unused"));
}

#[test]
fn variables_of_others_are_ignored_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let (status, _, errors) =
        output(gable(folder.path(), &["key", "list"]).env("GABLE_PORT_8080_TCP", "tcp://10.0.0.1:8080"));
    assert_eq!(status, Some(0));
    assert!(errors.contains("GABLE_PORT_8080_TCP"), "{errors}");
}

#[test]
fn keys_are_made_used_listed_and_revoked_while_the_service_runs() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(&mut gable(folder.path(), &["serve"]));
    assert!(serving.get("/api/v1/cameras", "").starts_with("HTTP/1.1 200"));
    let (status, printed, _) = output(&mut gable(folder.path(), &["key", "new", "--role", "reader", "--name", "anna"]));
    assert_eq!(status, Some(0));
    let secret = printed.trim();
    assert_eq!((printed.lines().count(), secret.len()), (1, 70));
    assert!(serving.get("/api/v1/cameras", "").starts_with("HTTP/1.1 401"));
    assert!(serving.get("/api/v1/cameras", secret).starts_with("HTTP/1.1 200"));
    let (_, listed, _) = output(&mut gable(folder.path(), &["key", "list"]));
    assert!(listed.contains("reader") && listed.contains("anna") && !listed.contains(secret), "{listed}");
    let id = listed.split_whitespace().next().unwrap();
    assert_eq!(output(&mut gable(folder.path(), &["key", "revoke", id])).0, Some(0));
    std::thread::sleep(Duration::from_secs(1));
    assert!(serving.get("/api/v1/cameras", secret).starts_with("HTTP/1.1 401"));
    let (status, _, errors) = output(&mut gable(folder.path(), &["key", "revoke", id]));
    assert_eq!(status, Some(1));
    assert!(errors.contains("no valid key"), "{errors}");
}

#[test]
fn keys_end_by_themselves_accounts_log_in_and_the_audit_log_knows_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| output(&mut gable(folder.path(), arguments));
    assert_eq!(run(&["key", "new", "--role", "admin", "--expires-in-days", "30"]).0, Some(0));
    assert_eq!(run(&["key", "new", "--role", "reader", "--expires", "2099-01-01T00:00:00Z"]).0, Some(0));
    assert_eq!(run(&["key", "new", "--role", "reader", "--expires", "2001-01-01T00:00:00Z"]).0, Some(1));
    let listed = run(&["key", "list"]).1;
    assert!(listed.contains("valid until 2099-01-01T00:00:00Z") && listed.contains("never used"), "{listed}");
    let typed = |arguments: &[&str], text: &str| {
        let mut command = gable(folder.path(), arguments);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        child.wait_with_output().unwrap().status.code()
    };
    let password = "correct horse battery\n";
    assert_eq!(typed(&["account", "new", "anna", "--role", "operator"], "short\n"), Some(1));
    assert_eq!(typed(&["account", "new", "anna", "--role", "operator"], password), Some(0));
    assert_eq!(typed(&["account", "new", "anna", "--role", "operator"], password), Some(1));
    assert_eq!(typed(&["account", "password", "anna"], password), Some(0));
    assert_eq!(run(&["account", "disable", "anna"]).0, Some(0));
    assert_eq!(run(&["account", "disable", "berta"]).0, Some(1));
    let listed = run(&["account", "list"]).1;
    assert!(listed.contains("anna") && listed.contains("operator") && listed.contains("disabled"), "{listed}");
    let (status, verified, _) = run(&["audit", "verify"]);
    assert!(status == Some(0) && verified.starts_with("5 rows"), "{verified}");
    let secret = run(&["webhook", "secret"]).1;
    assert!(secret.starts_with("whsec_") && secret == run(&["webhook", "secret"]).1, "{secret}");
}

#[test]
fn bootstrap_key_is_the_first_key_only() {
    let folder = tempfile::tempdir().unwrap();
    let secret = "0123456789abcdef0123456789abcdef";
    let mut serve = gable(folder.path(), &["serve"]);
    serve.env("GABLE_BOOTSTRAP_KEY", secret);
    let serving = Serving::start(&mut serve);
    assert!(serving.get("/api/v1/cameras", "").starts_with("HTTP/1.1 401"));
    assert!(serving.get("/api/v1/cameras", secret).starts_with("HTTP/1.1 200"));
    drop(serving);
    let (_, listed, _) = output(&mut gable(folder.path(), &["key", "list"]));
    assert_eq!(listed.lines().count(), 1);
    output(&mut gable(folder.path(), &["key", "revoke", listed.split_whitespace().next().unwrap()]));
    let serving = Serving::start(&mut serve);
    assert!(serving.get("/api/v1/cameras", secret).starts_with("HTTP/1.1 401"), "a revoked key must not come back");
}

#[test]
fn first_signal_ends_it_in_peace_and_the_second_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut serving = Serving::start(&mut gable(folder.path(), &["serve"]));
    serving.send(Signal::TERM);
    assert_eq!(serving.ended_within(Duration::from_secs(5)), Some(0));
    let mut serving = Serving::start(&mut gable(folder.path(), &["serve"]));
    let mut stalled = TcpStream::connect(&serving.address).unwrap();
    write!(
        stalled,
        "POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/jpeg\r\nContent-Length: 9\r\n\r\n"
    )
    .unwrap();
    std::thread::sleep(Duration::from_millis(300));
    serving.send(Signal::TERM);
    std::thread::sleep(Duration::from_millis(300));
    assert!(serving.child.try_wait().unwrap().is_none(), "it waits for the request under way");
    serving.send(Signal::TERM);
    assert_eq!(serving.ended_within(Duration::from_secs(1)), Some(1));
}

#[test]
fn log_as_json_is_json_and_holds_no_key() {
    let folder = tempfile::tempdir().unwrap();
    let (_, secret, errors) = output(
        gable(folder.path(), &["key", "new", "--role", "admin"])
            .env("GABLE_LOG_FORMAT", "json")
            .env("GABLE_LOG", "trace"),
    );
    assert!(!errors.is_empty() && !errors.contains(secret.trim()));
    for line in errors.lines() {
        assert!(serde_json::from_str::<serde_json::Value>(line).is_ok(), "{line}");
    }
}

#[test]
fn every_command_teaches_by_example() {
    let folder = tempfile::tempdir().unwrap();
    let help = |arguments: &[&str]| {
        let (status, text, _) = output(gable(folder.path(), arguments).arg("--help"));
        assert_eq!(status, Some(0), "{arguments:?}");
        text
    };
    let commands = help(&[]);
    let names = commands.split_once("Commands:").unwrap().1.split_once("Options:").unwrap().0;
    let names: Vec<_> =
        names.lines().filter_map(|line| line.split_whitespace().next()).filter(|n| *n != "help").collect();
    assert!(names.contains(&"serve"), "{commands}");
    for name in names {
        assert!(help(&[name]).contains("Example"), "{name}");
    }
}
