//! Lists: each filter against a list filtered by hand, and all of them in time over ten thousand rows.

use std::time::{Duration, Instant};

use chrono::TimeDelta;
use sqlx::AssertSqlSafe;

use super::listed::listed;
use super::million::plan;
use super::*;
use crate::database::{Database, Dialects};
use crate::store::blocks::{self, Block, BlockImage};
use crate::store::references::tests::{Bench, finished};

fn diagnosis(codes: &[&str]) -> DiagnosisInShort {
    let reasons = codes.iter().map(|code| ReasonInShort { code: (*code).to_owned(), detail: format!("{code}.") });
    DiagnosisInShort { score: Some(1.25), probability_correct: Some(0.75), reasons: reasons.collect() }
}

impl Bench {
    /// An orientation that has succeeded for these reasons.
    async fn decided(&self, image: Uuid, verdict: &str, codes: &[&str]) -> Uuid {
        let id = self.queued(image).await;
        let claim = Claim { id, lease: Uuid::now_v7() };
        self.store.begin_attempt(claim, Uuid::nil()).await.unwrap().unwrap();
        let result = Finished { verdict: verdict.into(), diagnosis: diagnosis(codes), ..finished("{}", &[]) };
        assert!(self.store.finish(claim, &result).await.unwrap());
        id
    }

    async fn review(&self, id: Uuid, decision: &str) {
        let review = query("UPDATE orientations SET review = $1 WHERE id = $2").bind(decision).bind(id);
        assert_eq!(review.execute(self.store.database()).await.unwrap(), 1);
    }

    async fn ids(&self, filter: Filter) -> Vec<Uuid> {
        self.store.orientations(&filter, 100).await.unwrap().into_iter().map(|row| row.id).collect()
    }

    /// A block of these orientations.
    async fn block(&self, orientations: &[Uuid]) -> Uuid {
        let (id, text) = (Uuid::now_v7(), String::new);
        let block = Block { id, name: text(), settings: text(), crs: text(), images: 9, created_at: now() };
        let mut transaction = self.store.begin_write().await.unwrap();
        blocks::insert(&mut transaction, &block).await.unwrap();
        for (number, orientation) in orientations.iter().enumerate() {
            let image = BlockImage {
                number: number as i64 + 1,
                name: number.to_string(),
                approximation: text(),
                sha256: None,
                image_id: None,
                orientation_id: Some(*orientation),
            };
            blocks::insert_image(&mut transaction, id, &image).await.unwrap();
        }
        transaction.commit().await.unwrap();
        id
    }
}

#[tokio::test]
async fn what_is_listed_has_its_names_its_diagnosis_and_its_block() {
    let bench = Bench::new().await;
    let image = bench.image_named(Some("IMG_1.JPG")).await;
    let id = bench.decided(image, "yellow", &["few_control_points", "tolerance"]).await;
    let waiting = bench.queued(bench.image().await).await;
    let block = bench.block(&[id]).await;
    bench.review(id, "accepted").await;
    let rows = bench.store.orientations(&Filter::default(), 10).await.unwrap();
    assert_eq!(rows.iter().map(|row| row.id).collect::<Vec<_>>(), [waiting, id]);
    let [row, shown] = [rows[1].clone(), bench.store.orientation(id).await.unwrap().unwrap()];
    assert_eq!((&row.result, &shown.result), (&None, &Some("{}".to_owned())));
    for row in [row, shown] {
        assert_eq!(row.diagnosis, Some(diagnosis(&["few_control_points", "tolerance"])));
        assert_eq!((row.image_name.as_deref(), row.camera_name.as_deref()), (Some("IMG_1.JPG"), Some("camera")));
        assert_eq!((row.block_id, row.review.as_deref()), (Some(block), Some("accepted")));
    }
    let row = &rows[0];
    assert_eq!((&row.diagnosis, &row.image_name, row.block_id, &row.review), (&None, &None, None, &None));
}

#[tokio::test]
async fn each_filter_keeps_what_it_should() {
    let bench = Bench::new().await;
    let named = bench.image_named(Some("Flight_7/100%_Ort.TIF")).await;
    let other = bench.image_named(Some("Flight-7.tif")).await;
    let nameless = bench.image().await;
    let a = bench.decided(named, "green", &["fine"]).await;
    let b = bench.decided(other, "red", &["few_control_points", "fine"]).await;
    let c = bench.decided(nameless, "yellow", &["few_control_points"]).await;
    let d = bench.queued(named).await;
    bench.review(a, "accepted").await;
    bench.review(b, "rejected").await;
    let block = bench.block(&[b, d]).await;
    let none = Filter::default;
    let text = |text: &str| Filter { text: Some(text.to_owned()), ..Filter::default() };
    assert_eq!(bench.ids(none()).await, [d, c, b, a]);
    assert_eq!(bench.ids(Filter { review: Some(Review::Open), ..none() }).await, [c]);
    assert_eq!(bench.ids(Filter { review: Some(Review::Accepted), ..none() }).await, [a]);
    assert_eq!(bench.ids(Filter { review: Some(Review::Rejected), ..none() }).await, [b]);
    let reason = |code: &str| Filter { reason: Some(code.to_owned()), ..Filter::default() };
    assert_eq!(bench.ids(reason("few_control_points")).await, [c, b]);
    assert_eq!(bench.ids(Filter { before: Some(c), ..reason("few_control_points") }).await, [b]);
    assert_eq!(bench.ids(Filter { verdict: Some("green".into()), ..reason("fine") }).await, [a]);
    assert_eq!(bench.ids(reason("few")).await, Vec::<Uuid>::new());
    assert_eq!(bench.ids(Filter { block_id: Some(block), ..none() }).await, [d, b]);
    assert_eq!(bench.ids(Filter { camera_id: Some(bench.camera_id), ..none() }).await, [d, c, b, a]);
    assert_eq!(bench.ids(Filter { camera_id: Some(named), ..none() }).await, Vec::<Uuid>::new());
    assert_eq!(bench.ids(text("flight")).await, [d, b, a]);
    assert_eq!(bench.ids(text("FLIGHT_7")).await, [d, a], "an underscore stands for itself");
    assert_eq!(bench.ids(text("100%_o")).await, [d, a]);
    assert_eq!(bench.ids(text("%")).await, [d, a]);
    assert_eq!(bench.ids(text("\\")).await, Vec::<Uuid>::new());
    assert_eq!(bench.ids(text(&c.to_string())).await, [c]);
    assert_eq!(bench.ids(text(&nameless.simple().to_string().to_uppercase())).await, [c]);
    assert_eq!(bench.ids(text(&c.to_string()[..8])).await, [d, c, b, a], "made in the same minute");
    let created_at = bench.store.orientation(b).await.unwrap().unwrap().created_at;
    assert_eq!(bench.ids(Filter { until: Some(created_at), ..none() }).await, [a]);
    let later = created_at + TimeDelta::microseconds(1);
    assert_eq!(bench.ids(Filter { since: Some(created_at), until: Some(later), ..none() }).await, [b]);
}

/// A row of before the migration gets its diagnosis and its reasons out of its result.
#[tokio::test]
async fn rows_of_before_have_a_diagnosis_too() {
    let bench = Bench::new().await;
    let (told, red, empty) = (bench.image().await, bench.image().await, bench.image().await);
    let results = [
        (
            told,
            r#"{"diagnosis": {"verdict": "green", "score": 1.25, "threshold": 1, "probability_correct": 0.1,
                   "reasons": [{"code": "a", "detail": "A \"b\" ü"}, {"code": "b", "detail": "B"}]}, "x": null}"#,
        ),
        (red, r#"{"diagnosis": {"verdict": "red", "reasons": [{"code": "b", "detail": "B"}]}}"#),
        (empty, "{}"),
    ];
    let mut ids = Vec::new();
    for (image, result) in results {
        let id = bench.finished(image, "{}", &[]).await;
        let update = query("UPDATE orientations SET result = $1 WHERE id = $2").bind(result).bind(id);
        update.execute(bench.store.database()).await.unwrap();
        ids.push(id);
    }
    let undo = "DROP TABLE orientation_reasons; DROP INDEX orientations_by_review; DROP INDEX orientations_to_review;
                DROP INDEX orientations_rejected; DROP INDEX orientations_doubtful;
                ALTER TABLE orientations DROP COLUMN diagnosis; ALTER TABLE orientations DROP COLUMN review;
                ALTER TABLE images DROP COLUMN name; ALTER TABLE images DROP COLUMN camera_model;";
    match bench.store.database() {
        Database::Sqlite(pool) => {
            let again = include_str!("../../../migrations/sqlite/0063_names_and_reviews.sql");
            sqlx::raw_sql(AssertSqlSafe(format!("{undo}{again}"))).execute(pool).await.map(|_| ()).unwrap();
        }
        Database::Postgres(pool) => {
            let again = include_str!("../../../migrations/postgres/0063_names_and_reviews.sql");
            sqlx::raw_sql(AssertSqlSafe(format!("{undo}{again}"))).execute(pool).await.map(|_| ()).unwrap();
        }
    }
    let mut rows = bench.store.orientations(&Filter::default(), 10).await.unwrap();
    rows.reverse();
    let told = rows.iter().map(|row| row.diagnosis.clone().unwrap()).collect::<Vec<_>>();
    assert_eq!((told[0].score, told[0].probability_correct), (Some(1.25), Some(0.1)));
    let reason = |code: &str, detail: &str| ReasonInShort { code: code.into(), detail: detail.into() };
    assert_eq!(told[0].reasons, [reason("a", "A \"b\" ü"), reason("b", "B")]);
    assert_eq!(told[1], DiagnosisInShort { reasons: vec![reason("b", "B")], ..DiagnosisInShort::default() });
    assert_eq!(told[2], DiagnosisInShort::default());
    assert_eq!(bench.ids(Filter { reason: Some("b".into()), ..Filter::default() }).await, [ids[1], ids[0]]);
    assert_eq!(bench.ids(Filter { reason: Some("a".into()), ..Filter::default() }).await, [ids[0]]);
}

/// Ten thousand orientations, each of an image of its own.
async fn fill(bench: &Bench) -> Uuid {
    let statements = [
        Dialects {
            sqlite: "WITH RECURSIVE numbers (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM numbers WHERE n < 10000)
                     INSERT INTO images (id, sha256, size_bytes, format, width_px, height_px, created_at, name)
                     SELECT randomblob(16), randomblob(32), 1, 'tiff', 9, 9, $1, 'IMG_' || n || '.TIF' FROM numbers",
            postgres: "INSERT INTO images (id, sha256, size_bytes, format, width_px, height_px, created_at, name)
                       SELECT gen_random_uuid(), sha256(n::text::bytea), 1, 'tiff', 9, 9, $1, 'IMG_' || n || '.TIF'
                       FROM generate_series(1, 10000) AS n",
        },
        Dialects {
            sqlite: "INSERT INTO orientations (id, image_id, camera_id, prepared, status, verdict, result, record, diagnosis, created_at)
                     SELECT randomblob(16), id, (SELECT id FROM cameras), '{}', 'succeeded', 'green', '{}', '{}',
                            '{\"reasons\": [{\"code\": \"fine\", \"detail\": \"x\"}]}', $1 FROM images",
            postgres: "INSERT INTO orientations (id, image_id, camera_id, prepared, status, verdict, result, record, diagnosis, created_at)
                       SELECT gen_random_uuid(), id, (SELECT id FROM cameras), '{}', 'succeeded', 'green', '{}', '{}',
                              '{\"reasons\": [{\"code\": \"fine\", \"detail\": \"x\"}]}', $1 FROM images",
        },
    ];
    for statement in statements {
        let filled = query(bench.store.database().dialect(statement)).bind(now());
        assert_eq!(filled.execute(bench.store.database()).await.unwrap(), 10_000);
    }
    query("INSERT INTO orientation_reasons (code, orientation_id) SELECT 'fine', id FROM orientations")
        .execute(bench.store.database())
        .await
        .unwrap();
    // the oldest of all is looked for
    let oldest = bench.decided(bench.image_named(Some("needle.tif")).await, "red", &["rare"]).await;
    let down = query("UPDATE orientations SET review = 'rejected' WHERE id = $1").bind(oldest);
    down.execute(bench.store.database()).await.unwrap();
    query("ANALYZE").execute(bench.store.database()).await.unwrap();
    oldest
}

#[tokio::test]
async fn ten_thousand_are_listed_in_time_with_every_filter() {
    let bench = Bench::new().await;
    let oldest = fill(&bench).await;
    let block = bench.block(&[oldest]).await;
    let none = Filter::default;
    let text = |text: &str| Some(text.to_owned());
    let filters = [
        none(),
        Filter { status: Some(Status::Failed), ..none() },
        Filter { verdict: text("red"), ..none() },
        Filter { review: Some(Review::Open), ..none() },
        Filter { review: Some(Review::Rejected), ..none() },
        Filter { reason: text("fine"), ..none() },
        Filter { reason: text("rare"), ..none() },
        Filter { reason: text("fine"), verdict: text("red"), ..none() },
        Filter { camera_id: Some(bench.camera_id), ..none() },
        Filter { camera_id: Some(block), ..none() },
        Filter { block_id: Some(block), ..none() },
        Filter { text: text("img_"), ..none() },
        Filter { text: text("needle"), ..none() },
        Filter { text: text(&oldest.to_string()), ..none() },
        Filter { text: text("nothing has this name"), ..none() },
        Filter { since: Some(now()), ..none() },
        Filter { until: Some(now() - TimeDelta::days(9)), ..none() },
    ];
    // without optimisation SQLite is several times slower
    let most = Duration::from_millis(if cfg!(debug_assertions) { 1000 } else { 100 });
    for filter in filters {
        let told = plan(bench.store.database(), listed(&filter, 100)).await;
        let mut took = Duration::MAX;
        for _ in 0..5 {
            let began = Instant::now();
            bench.store.orientations(&filter, 100).await.unwrap();
            took = took.min(began.elapsed());
        }
        eprintln!("{took:?} for {filter:?}: {told}");
        assert!(took < most, "{took:?}: {filter:?}: {told}");
    }
}
