//! That a long history makes nothing slow: a million orientations that have ended, on either database.
//!
//! `cargo test --release --lib -- --ignored a_million`

use std::time::{Duration, Instant};

use super::listed::listed;
use super::*;
use crate::database::{Database, Dialects, Query};
use crate::store::references::tests::Bench;

const CLAIMS: u32 = 200;

/// A million orientations that have ended, spread over images and verdicts.
async fn fill(bench: &Bench) {
    let mut images = Vec::new();
    for _ in 0..100 {
        images.push(bench.image().await);
    }
    let finished = Dialects {
        sqlite: "WITH RECURSIVE numbers (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM numbers WHERE n < 10000)
                 INSERT INTO orientations (id, image_id, camera_id, prepared, status, verdict, result, record, created_at)
                 SELECT randomblob(16), $1, $2, '{}', 'succeeded', CASE n % 3 WHEN 0 THEN 'green' WHEN 1 THEN 'yellow' ELSE 'red' END,
                        '{}', '{}', $3 FROM numbers",
        postgres: "INSERT INTO orientations (id, image_id, camera_id, prepared, status, verdict, result, record, created_at)
                   SELECT gen_random_uuid(), $1, $2, '{}', 'succeeded', CASE n % 3 WHEN 0 THEN 'green' WHEN 1 THEN 'yellow' ELSE 'red' END,
                          '{}', '{}', $3 FROM generate_series(1, 10000) AS n",
    };
    for image in images {
        let sql = bench.store.database().dialect(finished);
        let filled = query(sql).bind(image).bind(bench.camera_id).bind(now());
        assert_eq!(filled.execute(bench.store.database()).await.unwrap(), 10_000);
    }
    query("ANALYZE").execute(bench.store.database()).await.unwrap();
}

/// Claims and ends so many orientations that wait: seconds for each.
async fn claims(bench: &Bench) -> f64 {
    let image = bench.image().await;
    let mut ids = Vec::new();
    for _ in 0..CLAIMS {
        ids.push(bench.queued(image).await);
    }
    let began = Instant::now();
    for id in ids {
        let claim = Claim { id, lease: Uuid::now_v7() };
        bench.store.begin_attempt(claim, Uuid::nil()).await.unwrap().unwrap();
        assert!(!bench.store.any_late().await.unwrap());
        assert!(bench.store.queued().await.unwrap() < CLAIMS);
        assert!(bench.store.fail(claim, &Failure { code: "x".into(), detail: "x".into() }).await.unwrap());
    }
    began.elapsed().as_secs_f64() / f64::from(CLAIMS)
}

/// How the database means to answer a statement, on one line.
pub(crate) async fn plan(database: &Database, statement: Query) -> String {
    let lines: Vec<String> = match database {
        Database::Sqlite(_) => {
            let plan: Vec<(i64, i64, i64, String)> =
                statement.before("EXPLAIN QUERY PLAN ").fetch_all(database).await.unwrap();
            plan.into_iter().map(|(_, _, _, line)| line).collect()
        }
        Database::Postgres(_) => statement.before("EXPLAIN ").fetch_values(database).await.unwrap(),
    };
    lines.join("; ")
}

#[tokio::test]
#[ignore = "takes a minute"]
async fn a_million_orientations_that_have_ended_make_nothing_slow() {
    let bench = Bench::new().await;
    claims(&bench).await;
    let empty_s = claims(&bench).await;
    fill(&bench).await;
    let full_s = claims(&bench).await;
    let ratio = full_s / empty_s;
    eprintln!("J10: a claim takes {:.2} ms, after a million {:.2} ms: {ratio:.2} times", 1e3 * empty_s, 1e3 * full_s);
    assert!(ratio <= 2.0, "{ratio}");
    // each list walks along an index from its beginning
    for (filter, index) in [
        (Filter::default(), "orientations"),
        (Filter { verdict: Some("green".into()), ..Filter::default() }, "orientations_by_verdict"),
        (Filter { status: Some(Status::Queued), ..Filter::default() }, ""),
        (Filter { image_id: Some(bench.image().await), ..Filter::default() }, "orientations_by_image"),
    ] {
        let told = plan(bench.store.database(), listed(&filter, 50)).await;
        eprintln!("{filter:?}: {told}");
        let scans = told.contains("SCAN orientations;") || told.contains("Seq Scan") || !told.contains(index);
        assert!(!scans, "{told}");
        let began = Instant::now();
        bench.store.orientations(&filter, 50).await.unwrap();
        assert!(began.elapsed() < Duration::from_millis(100), "{filter:?} takes {:?}", began.elapsed());
    }
}
