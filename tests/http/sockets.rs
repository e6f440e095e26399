//! The traps of real connections: half-sent heads, stalled bodies, ends that do not come.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use gable::http::serve::serve;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::support::{Service, jpeg};

struct Running {
    service: Service,
    address: SocketAddr,
    stop: CancellationToken,
    ended: JoinHandle<()>,
}

/// Times of one second, so that the tests need not wait long.
async fn running() -> Running {
    let service = Service::with(|configuration| {
        configuration.answer_idle_timeout_s = 1;
        configuration.head_timeout_s = 1;
        configuration.body_idle_timeout_s = 1;
        configuration.shutdown_timeout_s = 2;
        configuration.connections_max = 3;
    })
    .await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let stop = CancellationToken::new();
    let (app, state, stopped) = (service.app.clone(), service.state.clone(), stop.clone());
    let ended = tokio::spawn(async move { serve(listener, app, &state, stopped).await });
    Running { service, address, stop, ended }
}

impl Running {
    async fn send(&self, text: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        stream.write_all(text.as_bytes()).await.unwrap();
        stream
    }
}

/// All that the service sends until it closes; fails if it does not within `patience`.
async fn until_closed(stream: &mut TcpStream, patience: Duration) -> String {
    let mut received = Vec::new();
    let read = async {
        let mut buffer = [0; 4096];
        // a connection that is cut off may also be reset
        while let Ok(count @ 1..) = stream.read(&mut buffer).await {
            received.extend_from_slice(&buffer[..count]);
        }
    };
    tokio::time::timeout(patience, read).await.expect("the service has not closed the connection");
    String::from_utf8_lossy(&received).into_owned()
}

fn upload_head(length: usize) -> String {
    format!(
        "POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/jpeg\r\nContent-Length: {length}\r\n\r\n"
    )
}

const HEALTH: &str = "GET /health/live HTTP/1.1\r\nHost: localhost\r\n\r\n";

#[tokio::test]
async fn half_sent_head_is_closed_in_time() {
    let running = running().await;
    let began = Instant::now();
    let mut half = running.send("GET /health/live HTTP/1.1\r\nHo").await;
    until_closed(&mut half, Duration::from_secs(4)).await;
    assert!(began.elapsed() > Duration::from_millis(800), "not before its time");
}

#[tokio::test]
async fn silent_and_idle_connections_are_closed_in_time() {
    let running = running().await;
    let mut silent = running.send("").await;
    until_closed(&mut silent, Duration::from_secs(4)).await;
    let mut idle = running.send(HEALTH).await;
    assert!(until_closed(&mut idle, Duration::from_secs(4)).await.starts_with("HTTP/1.1 200"));
}

#[tokio::test]
async fn slow_clients_do_not_keep_others_out_for_long() {
    let running = running().await;
    let mut half = Vec::new();
    for _ in 0..9 {
        half.push(running.send("GET / HT").await);
    }
    let mut good = running.send(HEALTH).await;
    let answer = until_closed(&mut good, Duration::from_secs(8)).await;
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

#[tokio::test]
async fn body_that_pauses_too_long_is_a_problem_and_leaves_nothing() {
    let running = running().await;
    let mut stalled = running.send(&upload_head(5000)).await;
    stalled.write_all(&jpeg(0)[..50]).await.unwrap();
    let answer = until_closed(&mut stalled, Duration::from_secs(5)).await;
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert!(answer.contains("urn:gable:problem:too-slow"), "{answer}");
    assert_eq!(running.service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn body_that_dribbles_is_a_problem() {
    let running = running().await;
    let mut dribbling = running.send(&upload_head(5000)).await;
    let (mut reading, mut writing) = dribbling.split();
    let mut answer = String::new();
    let dribble = async {
        while writing.write_all(b"x").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    let read = async {
        // a reset after the answer is as good an end
        let _ = reading.read_to_string(&mut answer).await;
    };
    let both = async {
        tokio::select! { () = dribble => {}, () = read => {} }
    };
    tokio::time::timeout(Duration::from_secs(5), both).await.unwrap();
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert_eq!(running.service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn client_that_does_not_read_is_cut_off() {
    let running = running().await;
    let ask = "GET /docs/swagger-ui-bundle.js HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let mut deaf = running.send(&ask.repeat(30)).await;
    tokio::time::sleep(Duration::from_millis(2500)).await;
    let received = until_closed(&mut deaf, Duration::from_secs(3)).await;
    assert!(received.len() < 20_000_000, "all of it was sent: {} bytes", received.len());
}

#[tokio::test]
async fn body_shorter_than_declared_leaves_nothing() {
    let running = running().await;
    let mut short = running.send(&upload_head(5000)).await;
    short.write_all(&jpeg(0)).await.unwrap();
    short.shutdown().await.unwrap();
    let answer = until_closed(&mut short, Duration::from_secs(5)).await;
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 400"), "{answer}");
    for part in ["incoming", "images"] {
        assert_eq!(running.service.files(part), Vec::<String>::new());
    }
}

#[tokio::test]
async fn too_large_a_body_is_refused_before_it_is_sent() {
    let running = running().await;
    let head = upload_head(3_000_000_000).replace("\r\n\r\n", "\r\nExpect: 100-continue\r\n\r\n");
    let mut large = running.send(&head).await;
    let answer = until_closed(&mut large, Duration::from_secs(5)).await;
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
}

#[tokio::test]
async fn end_comes_at_once_when_nothing_is_under_way() {
    let running = running().await;
    let mut idle = running.send(HEALTH).await;
    let mut first = [0; 12];
    idle.read_exact(&mut first).await.unwrap();
    let began = Instant::now();
    running.stop.cancel();
    running.ended.await.unwrap();
    assert!(began.elapsed() < Duration::from_millis(500), "{:?}", began.elapsed());
    assert!(TcpStream::connect(running.address).await.is_err());
}

#[tokio::test]
async fn end_lets_requests_under_way_come_to_theirs() {
    let running = running().await;
    let file = jpeg(0);
    let mut upload = running.send(&upload_head(file.len())).await;
    upload.write_all(&file[..100]).await.unwrap();
    tokio::time::sleep(Duration::from_millis(200)).await;
    running.stop.cancel();
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert_eq!(running.service.get("/health/ready").await.status, 503);
    upload.write_all(&file[100..]).await.unwrap();
    let answer = until_closed(&mut upload, Duration::from_secs(3)).await;
    assert!(answer.starts_with("HTTP/1.1 201"), "{answer}");
    running.ended.await.unwrap();
}

#[tokio::test]
async fn half_sent_head_and_dribbling_body_do_not_hold_up_the_end() {
    let running = running().await;
    let half = running.send("GET /health/live HTTP/1.1\r\nHo").await;
    let mut dribbling = running.send(&upload_head(5000)).await;
    let dribble = tokio::spawn(async move {
        while dribbling.write_all(b"x").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    tokio::time::sleep(Duration::from_millis(200)).await;
    let began = Instant::now();
    running.stop.cancel();
    running.ended.await.unwrap();
    assert!(began.elapsed() < Duration::from_millis(2500), "{:?}", began.elapsed());
    drop(half);
    dribble.await.unwrap();
    assert_eq!(running.service.files("incoming"), Vec::<String>::new());
}
