use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use super::*;
use crate::store::now;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;
use uuid::Uuid;

/// Ways to write, or to arrive at, a place that nobody outside may be sent to. `{port}` is a listener on 127.0.0.1.
const SPELLINGS: &str = "
    https://127.0.0.1:{port}/ https://127.1:{port}/ https://127.0.1:{port}/ https://127.000.000.001:{port}/
    https://2130706433:{port}/ https://0x7f000001:{port}/ https://0x7f.1:{port}/ https://0x7f.0x0.0x0.0x1:{port}/
    https://017700000001:{port}/ https://0177.0.0.1:{port}/ https://0177.0.0.01:{port}/ https://127.0.0.1.:{port}/
    https://127.255.255.254:{port}/ https://%31%32%37.0.0.1:{port}/ https://①②⑦.⓪.⓪.①:{port}/ https://127。0。0。1:{port}/
    https://0:{port}/ https://0.0.0.0:{port}/ https://0x0:{port}/ https://[::]:{port}/ https://[::1]:{port}/
    https://[0:0:0:0:0:0:0:1]:{port}/ https://[0000::0001]:{port}/ https://[::127.0.0.1]:{port}/
    https://[::ffff:127.0.0.1]:{port}/ https://[::ffff:7f00:1]:{port}/ https://[0:0:0:0:0:ffff:7f00:0001]:{port}/
    https://[::ffff:0:127.0.0.1]:{port}/ https://[64:ff9b::127.0.0.1]:{port}/ https://[64:ff9b::7f00:1]:{port}/
    https://[64:ff9b:1::a9fe:a9fe]:{port}/ https://[2002:7f00:1::]:{port}/ https://[2002:a9fe:a9fe::1]:{port}/
    https://[2001:0:7f00:1::]:{port}/ https://[::ffff:169.254.169.254]/ https://169.254.169.254/latest/meta-data/
    https://169.254.43518/ https://2852039166/ https://0xa9fea9fe/ https://0251.0376.0251.0376/ https://0xa9.254.0251.254/
    https://[fd00:ec2::254]/ https://[fe80::1]:{port}/ https://[fc00::1]/ https://[fdff:ffff::1]/ https://[ff02::1]/
    https://[2001:db8::1]/ https://[3fff::1]/ https://[100::1]/ https://[5f00::1]/ https://10.0.0.1/ https://10.1/
    https://172.16.0.1/ https://172.31.255.255/ https://192.168.0.1/ https://192.168.257/ https://100.64.0.1/
    https://100.100.100.200/ https://168.63.129.16/ https://192.0.0.192/ https://198.18.0.1/ https://224.0.0.1/
    https://239.255.255.250/ https://255.255.255.255/ https://240.0.0.1/ https://192.0.2.1/ https://203.0.113.1/
    https://localhost:{port}/ https://LOCALHOST:{port}/ https://localhost.:{port}/ https://a.localhost:{port}/
    https://ⓛocalhost:{port}/ https://metadata/ https://intranet/ https://user@127.0.0.1:{port}/
    https://example.org@127.0.0.1:{port}/ https://example.org:443@127.0.0.1:{port}/ https://user:word@example.org/
    http://127.0.0.1:{port}/ http://example.org/ //127.0.0.1:{port}/ file:///etc/passwd ftp://example.org/
    gopher://127.0.0.1:{port}/ https:127.0.0.1:{port} https:\\\\127.0.0.1:{port}\\ https:/127.0.0.1:{port}/
    https:///127.0.0.1:{port}/ javascript:alert(1) https://example.org/#fragment https:// https://[::1%25lo]:{port}/
";

fn due(url: &str) -> Due {
    Due {
        id: Uuid::now_v7(),
        orientation_id: Uuid::now_v7(),
        url: url.to_owned(),
        created_at: now(),
        attempts: 1,
        tried_for_ms: 0,
        status: String::from("succeeded"),
        verdict: Some(String::from("green")),
        block: None,
    }
}

/// Answers of look-ups, one after the other; the last one again and again.
fn answering(answers: &[&[&str]]) -> (Lookup, Arc<AtomicUsize>) {
    let addresses = |answer: &&[&str]| answer.iter().map(|text| text.parse().unwrap()).collect();
    let answers: Vec<Vec<IpAddr>> = answers.iter().map(addresses).collect();
    let asked = Arc::new(AtomicUsize::new(0));
    let counter = asked.clone();
    let lookup: Lookup = Arc::new(move |_| {
        let number = counter.fetch_add(1, Ordering::SeqCst).min(answers.len() - 1);
        let answer = answers[number].clone();
        Box::pin(async move { Ok(answer) })
    });
    (lookup, asked)
}

fn sender(policy: Policy, lookup: Lookup) -> Sender {
    Sender::new(policy, Secret::random().unwrap(), lookup).unwrap()
}

/// A receiver on 127.0.0.1 that gives these answers one after the other, and what it has heard.
async fn receiver(answers: Vec<String>) -> (SocketAddr, Arc<Mutex<Vec<String>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let hearing = heard.clone();
    tokio::spawn(async move {
        for answer in answers {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut text = Vec::new();
            let mut buffer = [0; 4096];
            while !String::from_utf8_lossy(&text).ends_with("finished\"}") {
                match stream.read(&mut buffer).await.unwrap() {
                    0 => break,
                    count => text.extend_from_slice(&buffer[..count]),
                }
            }
            hearing.lock().unwrap().push(String::from_utf8(text).unwrap());
            stream.write_all(answer.as_bytes()).await.unwrap();
            stream.shutdown().await.unwrap();
        }
    });
    (address, heard)
}

fn answer(status: &str) -> String {
    format!("HTTP/1.1 {status}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")
}

fn this_machine() -> Policy {
    Policy { allow_loopback: true, ..Policy::default() }
}

#[tokio::test]
async fn no_spelling_of_an_inner_address_is_connected_to() {
    let (address, heard) = receiver(vec![answer("200 OK")]).await;
    let spellings: Vec<String> =
        SPELLINGS.split_whitespace().map(|text| text.replace("{port}", &address.port().to_string())).collect();
    assert!(spellings.len() >= 60, "{}", spellings.len());
    let (lookup, _) = answering(&[&["127.0.0.1"]]);
    let sender = sender(Policy::default(), lookup);
    for spelling in &spellings {
        assert!(Policy::default().check(spelling).is_err(), "{spelling} would be accepted");
        assert!(matches!(sender.send(&due(spelling)).await, Err(SendError::Refused(_))), "{spelling}");
    }
    assert!(heard.lock().unwrap().is_empty(), "{heard:?}");
}

#[tokio::test]
async fn name_of_an_inner_address_is_not_connected_to() {
    let (address, heard) = receiver(vec![answer("200 OK")]).await;
    for found in ["127.0.0.1", "::1", "::ffff:127.0.0.1", "169.254.169.254", "10.0.0.1", "fd00::1", "64:ff9b::7f00:1"] {
        for found in [&[found][..], &["93.184.215.14", found][..]] {
            let (lookup, asked) = answering(&[found]);
            let url = format!("https://inner.example.org:{}/", address.port());
            let error = sender(Policy::default(), lookup).send(&due(&url)).await.unwrap_err();
            assert!(error.to_string().contains("not public"), "{found:?}: {error}");
            assert_eq!(asked.load(Ordering::SeqCst), 1, "{found:?}");
        }
    }
    assert!(heard.lock().unwrap().is_empty(), "{heard:?}");
}

/// The name is looked up once: what it stands for a moment later is not asked.
#[tokio::test]
async fn name_that_leads_elsewhere_a_moment_later_leads_nowhere() {
    let (address, heard) = receiver(vec![answer("200 OK")]).await;
    // a public address first, so that a second look-up would be let through to this machine
    let (lookup, asked) = answering(&[&["192.88.98.1"], &["127.0.0.1"]]);
    let url = format!("https://rebinding.example.org:{}/", address.port());
    let sender = sender(Policy::default(), lookup);
    let first = tokio::time::timeout(Duration::from_secs(8), sender.send(&due(&url))).await.unwrap();
    assert!(first.is_err());
    assert_eq!(asked.load(Ordering::SeqCst), 1);
    let second = sender.send(&due(&url)).await.unwrap_err();
    assert!(second.to_string().contains("not public"), "{second}");
    assert!(heard.lock().unwrap().is_empty(), "{heard:?}");
}

#[tokio::test]
async fn redirection_is_not_followed() {
    let (inner, heard_inside) = receiver(vec![answer("200 OK")]).await;
    let away = format!("302 Found\r\nlocation: http://{inner}/");
    let (outer, _) = receiver(vec![answer(&away)]).await;
    let sender = sender(this_machine(), by_the_system());
    let error = sender.send(&due(&format!("http://{outer}/"))).await.unwrap_err();
    assert!(matches!(error, SendError::Status(status) if status.as_u16() == 302), "{error}");
    assert!(heard_inside.lock().unwrap().is_empty());
}

#[tokio::test]
async fn answer_without_end_and_answer_that_does_not_come_are_given_up() {
    let endless = format!("HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n{}", "x".repeat(1 << 20));
    let (address, _) = receiver(vec![endless]).await;
    let sender = sender(this_machine(), by_the_system());
    sender.send(&due(&format!("http://{address}/"))).await.unwrap();
    let silent = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let began = std::time::Instant::now();
    let error = sender.send(&due(&format!("http://{}/", silent.local_addr().unwrap()))).await.unwrap_err();
    assert!(matches!(error, SendError::Connection(_)), "{error}");
    assert!((4..8).contains(&began.elapsed().as_secs()), "{:?}", began.elapsed());
}

#[tokio::test]
async fn what_is_told_is_signed_and_the_same_in_every_try() {
    let (address, heard) = receiver(vec![answer("500 Oh"), answer("204 Fine")]).await;
    let secret = Secret::random().unwrap();
    let sender = Sender::new(this_machine(), secret.clone(), by_the_system()).unwrap();
    let event = due(&format!("http://localhost:{}/hook?a=b", address.port()));
    assert!(matches!(sender.send(&event).await, Err(SendError::Status(status)) if status.as_u16() == 500));
    sender.send(&event).await.unwrap();
    let heard = heard.lock().unwrap().clone();
    let bodies: Vec<&str> = heard.iter().map(|text| text.split_once("\r\n\r\n").unwrap().1).collect();
    assert_eq!(bodies[0], bodies[1]);
    for text in &heard {
        let field = |name: &str| {
            let line = text.lines().find(|line| line.to_lowercase().starts_with(&format!("{name}:"))).unwrap();
            line.split_once(':').unwrap().1.trim().to_owned()
        };
        assert!(text.starts_with("POST /hook?a=b HTTP/1.1\r\n"), "{text}");
        assert_eq!(field("webhook-id"), event.id.to_string());
        let timestamp: i64 = field("webhook-timestamp").parse().unwrap();
        let body = bodies[0].as_bytes();
        assert!((now().timestamp() - timestamp).abs() < 60);
        assert_eq!(field("webhook-signature"), secret.sign(&field("webhook-id"), timestamp, body));
    }
    let told: serde_json::Value = serde_json::from_str(bodies[0]).unwrap();
    assert_eq!(told["type"], "orientation.finished");
    assert_eq!(told["data"]["id"], event.orientation_id.to_string());
    assert_eq!(told["data"]["verdict"], "green");
}

/// The vector that the libraries of the Standard Webhooks specification are tested with.
#[test]
fn signature_is_that_of_the_specification() {
    let secret: Secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw".parse().unwrap();
    let signature = secret.sign("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, br#"{"test": 2432232314}"#);
    assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    assert_eq!(secret.to_string(), "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw");
    assert_eq!(format!("{secret:?}"), "Secret");
    for malformed in ["", "whsec_", "whsec_AAAA", "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "whsec_???"] {
        assert!(malformed.parse::<Secret>().is_err(), "{malformed}");
    }
}

#[test]
fn public_addresses_and_listed_hosts_are_let_through() {
    for url in
        ["https://example.org/", "https://93.184.215.14:8443/a?b=c", "https://[2606:2800:21f::1]/", "https://a.b.c"]
    {
        Policy::default().check(url).unwrap();
    }
    let listed = Policy { hosts: vec!["hooks.example.org".into(), "*.example.com".into()], allow_loopback: false };
    for url in [
        "https://hooks.example.org/",
        "https://HOOKS.example.org./",
        "https://a.example.com/",
        "https://a.b.example.com",
    ] {
        listed.check(url).unwrap();
    }
    for url in
        ["https://example.org/", "https://hooks.example.org.evil.net/", "https://example.com/", "https://aexample.com/"]
    {
        assert!(listed.check(url).unwrap_err().contains("webhook_hosts"), "{url}");
    }
}

#[test]
fn pauses_grow_from_a_second_to_an_hour() {
    assert!((1..=100).all(|_| pause(1) == FIRST_PAUSE));
    for attempts in 2..200 {
        let whole = 2_f64.powi(attempts - 1).min(3600.0);
        let pause = pause(u32::try_from(attempts).unwrap()).as_secs_f64();
        assert!((whole / 2.0..=whole).contains(&pause), "{attempts}: {pause}");
    }
}
