//! An axum handler that does nothing but answer a text, to hold the service's rate against.

use axum::Router;
use axum::http::header;
use axum::routing::get;

#[tokio::main]
async fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(address), Some(file)) = (arguments.next(), arguments.next()) else {
        return Err(std::io::Error::other("usage: bare ADDRESS:PORT FILE"));
    };
    let text: &'static str = std::fs::read_to_string(file)?.leak();
    let answer = async move || ([(header::CONTENT_TYPE, "application/json")], text);
    axum::serve(tokio::net::TcpListener::bind(address).await?, Router::new().route("/", get(answer))).await
}
