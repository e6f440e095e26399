//! What the database does under stress that the other tests do not meet.

use gable::database::{Database, query};

use crate::scratch::over_sqlite;
use crate::support::{Service, camera};

#[tokio::test]
async fn disk_that_is_full_for_a_while_does_no_lasting_harm() {
    if !over_sqlite() {
        return;
    }
    let service = Service::new().await;
    service.post("/api/v1/cameras", &camera("before")).await;
    let pages: i64 = query("PRAGMA page_count").fetch_value(service.state.store.database()).await.unwrap();
    limit_pages(&service, pages).await;
    let mut name = 0;
    let refused = loop {
        name += 1;
        let answer = service.post("/api/v1/cameras", &camera(&format!("{name}-{}", "x".repeat(190)))).await;
        if answer.status != 201 {
            break answer;
        }
        assert!(name < 1000, "the limit does not bind");
    };
    refused.problem(507);
    // SQLite has rolled back by itself; the next transaction must not meet the remains of the last one
    service.post("/api/v1/cameras", &camera("y")).await;
    limit_pages(&service, 1_000_000).await;
    for n in 0..20 {
        let answer = service.post("/api/v1/cameras", &camera(&format!("after {n}"))).await;
        assert_eq!(answer.status, 201, "{:?}", answer.body);
    }
    let check: String = query("PRAGMA integrity_check").fetch_value(service.state.store.database()).await.unwrap();
    assert_eq!(check, "ok");
}

#[tokio::test]
async fn database_that_others_hold_is_unavailable_not_at_fault() {
    if !over_sqlite() {
        return;
    }
    let service = Service::new().await;
    let held = service.state.store.begin_write().await.unwrap();
    let answer = service.post("/api/v1/cameras", &camera("late")).await;
    answer.problem(503);
    assert_eq!(answer.headers["retry-after"], "1");
    assert_eq!(service.get("/api/v1/cameras").await.status, 200, "readers are not held up");
    drop(held);
    assert_eq!(service.post("/api/v1/cameras", &camera("late")).await.status, 201);
}

/// The limit belongs to a connection: all that there can be are taken out of the pool, and given back with it.
async fn limit_pages(service: &Service, pages: i64) {
    let Database::Sqlite(pool) = service.state.store.database() else { unreachable!("it is over SQLite") };
    let mut connections = Vec::new();
    for _ in 0..pool.options().get_max_connections() {
        connections.push(pool.acquire().await.unwrap());
    }
    for connection in &mut connections {
        let pragma = sqlx::AssertSqlSafe(format!("PRAGMA max_page_count = {pages}"));
        sqlx::query(pragma).execute(&mut **connection).await.unwrap();
    }
}
