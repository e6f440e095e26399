//! The built binary on simulated towns: `gable demo` and `gable simulate`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panic")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

/// In a folder of its own, which is that of temporary files too.
fn gable(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gable"));
    command.current_dir(folder).args(arguments).env("TMPDIR", folder);
    command
}

fn run(command: &mut Command) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn demonstration_ends_with_status_0_and_leaves_only_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (status, told, errors) = run(&mut gable(folder.path(), &["demo", "--exit", "--seed", "1"]));
    assert_eq!(status, Some(0), "{told}{errors}");
    assert_eq!(errors, "");
    assert!(told.contains("Verdict: GREEN") && told.contains("the orientation is right"), "{told}");
    let [picture] = &files(folder.path())[..] else { panic!("{:?}", files(folder.path())) };
    assert!(told.contains(picture), "{told}");
    let picture = image::open(folder.path().join(picture)).unwrap();
    assert_eq!((picture.width(), picture.height()), (1500, 1125));
}

/// Ended with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn demonstration_goes_on_serving_what_it_has_shown() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["demo", "--seed", "2", "--listen", "127.0.0.1:0", "--data", "town"];
    let mut demo = Running(gable(folder.path(), &arguments).stdout(Stdio::piped()).spawn().unwrap());
    let lines = BufReader::new(demo.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut urls = lines.skip_while(|line| !line.starts_with("Serving")).skip(1).take(3);
    for kind in ["text/html", "application/json", "text/html"] {
        let answer = get(urls.next().unwrap().trim());
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        assert!(answer.contains(&format!("content-type: {kind}")), "{answer}");
    }
    let (status, _, errors) = run(&mut gable(folder.path(), &["demo", "--exit", "--data", "town"]));
    assert_eq!((status, errors.contains("a database already")), (Some(1), true), "{errors}");
    kill_process(Pid::from_child(&demo.0), Signal::INT).unwrap();
    assert!(demo.0.wait().unwrap().success());
    for kept in ["gable.db", "overlay.jpg"] {
        assert!(folder.path().join("town").join(kept).exists(), "{kept}");
    }
}

/// The head of the answer.
fn get(url: &str) -> String {
    let (address, path) = url.strip_prefix("http://").unwrap().split_once('/').unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET /{path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).split("\r\n\r\n").next().unwrap().to_owned()
}

#[test]
fn simulate_writes_what_orient_reads() {
    let folder = tempfile::tempdir().unwrap();
    let small = json!({
        "camera": {"image_size_px": [600, 450], "principal_distance_px": 520.0, "principal_point_px": [301.0, 224.0]},
        "photograph": {"rays_per_pixel": 1}
    });
    std::fs::write(folder.path().join("small.json"), small.to_string()).unwrap();
    let arguments = ["simulate", "--seed", "3", "--images", "2", "--out", "two towns", "--settings", "small.json"];
    let (status, told, errors) = run(&mut gable(folder.path(), &arguments));
    assert_eq!(status, Some(0), "{errors}");
    let scene = folder.path().join("two towns/seed-3");
    assert!(scene.join("truth.json").exists());

    let command = told.lines().last().unwrap().trim();
    let binary = Path::new(env!("CARGO_BIN_EXE_gable")).parent().unwrap();
    let path = format!("{}:{}", binary.display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    let (status, told, errors) = run(shell.current_dir(folder.path()).args(["-c", command]).env("PATH", path));
    assert_eq!(status, Some(0), "{command}: {errors}");
    let result = &serde_json::from_str::<Value>(&told).unwrap()["result"];
    let in_view = &serde_json::from_slice::<Value>(&std::fs::read(scene.with_file_name("seed-4/truth.json")).unwrap())
        .unwrap()["control_points_in_view"];
    let expected: Vec<_> = result["control_points"].as_array().unwrap().iter().map(|point| &point["name"]).collect();
    let common = in_view.as_array().unwrap().iter().filter(|name| expected.contains(name)).count();
    assert!(common > 5, "expected {expected:?}, in view {in_view}");
    assert!(scene.with_file_name("seed-4/overlay.png").exists());
}

#[test]
fn settings_of_a_scene_that_make_no_sense_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (settings, named) in [(r#"{"flight": {"height_m": 3}}"#, "height_m is 3"), (r#"{"town": {"size": 3}}"#, "size")]
    {
        std::fs::write(folder.path().join("settings.json"), settings).unwrap();
        let (status, _, errors) = run(&mut gable(folder.path(), &["simulate", "--settings", "settings.json"]));
        assert_eq!((status, errors.contains(named)), (Some(1), true), "{errors}");
    }
    assert_eq!(files(folder.path()), ["settings.json"]);
}
