//! `kill -9` at any moment: what was acknowledged is there, what was not leaves nothing half.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use crate::command_line::{Serving, gable};
use crate::support::jpeg;

/// Uploads one image after the other until the service is gone; the ids and hashes that were acknowledged.
fn upload_until_it_dies(address: &str, round: u8) -> Vec<(String, String)> {
    let mut acknowledged = Vec::new();
    for shade in 0..=255 {
        let mut file = jpeg(shade);
        // after the end of the picture, so that every round has files of its own
        file.extend_from_slice(&[round; 200_000]);
        let Some(answer) = post(address, &file) else { break };
        assert!(answer.starts_with("HTTP/1.1 20"), "{answer}");
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        let image: serde_json::Value = serde_json::from_str(body).unwrap();
        let text = |name: &str| image[name].as_str().unwrap().to_owned();
        acknowledged.push((text("id"), text("sha256")));
    }
    acknowledged
}

fn post(address: &str, file: &[u8]) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    let length = file.len();
    let head = format!(
        "POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/jpeg\r\nContent-Length: {length}\r\n\
         Connection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).ok()?;
    stream.write_all(file).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    answer.ends_with('}').then_some(answer)
}

#[test]
fn killed_service_has_lost_nothing_that_it_acknowledged() {
    let folder = tempfile::tempdir().unwrap();
    let mut acknowledged = Vec::new();
    for round in 0..6 {
        let mut serving = Serving::start(&mut gable(folder.path(), &["serve"]));
        let address = serving.address.clone();
        let uploading = std::thread::spawn(move || upload_until_it_dies(&address, round));
        std::thread::sleep(Duration::from_millis(60 + 37 * u64::from(round)));
        serving.child.kill().unwrap();
        serving.child.wait().unwrap();
        acknowledged.extend(uploading.join().unwrap());
    }
    assert!(!acknowledged.is_empty());
    let serving = Serving::start(&mut gable(folder.path(), &["serve"]));
    for (id, sha256) in &acknowledged {
        assert!(serving.get(&format!("/api/v1/images/{id}"), "").starts_with("HTTP/1.1 200"), "{id} is lost");
        let file = std::fs::read(folder.path().join("data/images").join(sha256)).unwrap();
        assert_eq!(gable::store::images::hexadecimal(&Sha256::digest(file)), *sha256);
    }
    assert_eq!(std::fs::read_dir(folder.path().join("data/incoming")).unwrap().count(), 0, "orphans were not swept");
}
