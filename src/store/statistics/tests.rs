//! Figures against rows that are counted by hand.

use chrono::TimeDelta;
use uuid::Uuid;

use super::*;
use crate::store::orientations::{Claim, DiagnosisInShort, Failure, Finished, ReasonInShort};
use crate::store::references::tests::{Bench, finished};

fn time(text: &str) -> DateTime<Utc> {
    text.parse().unwrap()
}

impl Bench {
    /// Sets when an orientation was asked for, and how long before its end it was begun.
    async fn at(&self, id: Uuid, created: &str, ended: Option<(&str, f64)>) -> Uuid {
        let finished_at = ended.map(|(at, _)| time(at));
        let took = ended.map(|(_, seconds)| TimeDelta::milliseconds((1e3 * seconds) as i64));
        let change = query("UPDATE orientations SET created_at = $1, started_at = $2, finished_at = $3 WHERE id = $4");
        let change = change.bind(time(created)).bind(finished_at.zip(took).map(|(at, took)| at - took));
        assert_eq!(change.bind(finished_at).bind(id).execute(self.store.database()).await.unwrap(), 1);
        id
    }

    async fn under_way(&self) -> Claim {
        let claim = Claim { id: self.queued(self.image().await).await, lease: Uuid::now_v7() };
        self.store.begin_attempt(claim, Uuid::nil()).await.unwrap().unwrap();
        claim
    }

    async fn succeeded(&self, verdict: &str, codes: &[&str]) -> Uuid {
        let claim = self.under_way().await;
        let reason = |code: &&str| ReasonInShort { code: (*code).to_owned(), detail: String::new() };
        let diagnosis = DiagnosisInShort { reasons: codes.iter().map(reason).collect(), ..DiagnosisInShort::default() };
        let result = Finished { verdict: verdict.into(), diagnosis, ..finished("{}", &[]) };
        assert!(self.store.finish(claim, &result).await.unwrap());
        claim.id
    }

    async fn failed(&self, code: &str) -> Uuid {
        let claim = self.under_way().await;
        assert!(self.store.fail(claim, &Failure { code: code.into(), detail: "x".into() }).await.unwrap());
        claim.id
    }
}

/// Four that have ended on two days, one that was cancelled, one that waits, and one that ends when the span ends.
async fn history() -> Bench {
    let bench = Bench::new().await;
    let a = bench.succeeded("green", &["fine", "x"]).await;
    bench.at(a, "2024-02-28T23:59:59.999600Z", Some(("2024-02-29T00:00:00Z", 2.0))).await;
    let b = bench.succeeded("red", &["fine"]).await;
    bench.at(b, "2024-02-29T00:00:00Z", Some(("2024-02-29T23:59:59.999600Z", 8.5))).await;
    let c = bench.failed("timeout").await;
    bench.at(c, "2024-02-29T12:00:00Z", Some(("2024-03-01T00:00:00Z", 600.0))).await;
    let d = bench.succeeded("green", &["x", "fine"]).await;
    bench.at(d, "2024-02-29T12:00:00Z", Some(("2024-03-01T12:59:59Z", 4.0))).await;
    let e = bench.queued(bench.image().await).await;
    assert!(bench.store.cancel(e).await.unwrap());
    bench.at(e, "2024-03-01T13:00:00Z", Some(("2024-03-01T13:30:00Z", 1.0))).await;
    let f = bench.queued(bench.image().await).await;
    bench.at(f, "2024-03-01T14:00:00.250Z", None).await;
    let g = bench.succeeded("green", &["y"]).await;
    bench.at(g, "2024-03-01T15:00:00Z", Some(("2024-03-02T00:00:00Z", 99.0))).await;
    for (id, review) in [(a, "accepted"), (b, "rejected")] {
        let decide = query("UPDATE orientations SET review = $1 WHERE id = $2").bind(review).bind(id);
        decide.execute(bench.store.database()).await.unwrap();
    }
    bench
}

fn span() -> Span {
    Span { since: time("2024-02-28T12:00:00Z"), until: time("2024-03-02T00:00:00Z") }
}

#[tokio::test]
async fn tallies_are_those_counted_by_hand() {
    let bench = history().await;
    let tally = |day: &str, [ended, verdict, review, error_code]: [&str; 4], count| {
        let text = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
        let number = Step::Day.number(time(&format!("{day}T00:00:00Z")));
        let [ended, verdict, review, error_code] = [ended, verdict, review, error_code].map(text);
        Tally { number, ended, verdict, review, error_code, count }
    };
    let expected = [
        tally("2024-02-28", [""; 4], 1),
        tally("2024-02-29", [""; 4], 3),
        tally("2024-03-01", [""; 4], 3),
        tally("2024-02-29", ["succeeded", "green", "accepted", ""], 1),
        tally("2024-02-29", ["succeeded", "red", "rejected", ""], 1),
        tally("2024-03-01", ["cancelled", "", "", ""], 1),
        tally("2024-03-01", ["failed", "", "", "timeout"], 1),
        tally("2024-03-01", ["succeeded", "green", "", ""], 1),
    ];
    let mut found = bench.store.tallies(span(), Step::Day).await.unwrap();
    found.sort_by(|a, b| (&a.ended, a.number, &a.verdict).cmp(&(&b.ended, b.number, &b.verdict)));
    let mut sorted = expected.to_vec();
    sorted.sort_by(|a, b| (&a.ended, a.number, &a.verdict).cmp(&(&b.ended, b.number, &b.verdict)));
    assert_eq!(found, sorted);
    let hours = bench.store.tallies(span(), Step::Hour).await.unwrap();
    let of = |at: &str, ended: Option<&str>| {
        let number = Step::Hour.number(time(at));
        let same = hours.iter().filter(|tally| tally.number == number && tally.ended.as_deref() == ended);
        same.map(|tally| tally.count).sum::<i64>()
    };
    assert_eq!(of("2024-02-28T23:00:00Z", None), 1);
    assert_eq!(of("2024-02-29T12:00:00Z", None), 2);
    assert_eq!(of("2024-02-29T00:00:00Z", Some("succeeded")), 1);
    assert_eq!(of("2024-02-29T23:00:00Z", Some("succeeded")), 1);
    assert_eq!(of("2024-03-01T12:00:00Z", Some("succeeded")), 1);
    assert_eq!(of("2024-03-01T13:00:00Z", Some("cancelled")), 1);
}

#[tokio::test]
async fn what_is_present_lasts_and_has_reasons_is_told() {
    let bench = history().await;
    let present = bench.store.present().await.unwrap();
    let oldest = Some(time("2024-03-01T14:00:00.250Z"));
    assert_eq!(present, Present { queued: 1, running: 0, oldest_queued_at: oldest, doubtful: 0 });
    // of four that have succeeded, two are decided
    let doubt = query("UPDATE orientations SET verdict = 'yellow' WHERE status = 'succeeded'");
    doubt.execute(bench.store.database()).await.unwrap();
    assert_eq!(bench.store.present().await.unwrap().doubtful, 2);
    // of 2, 4, 8.5 and 600 s
    let Durations { median_s, p95_s } = bench.store.durations(span()).await.unwrap().unwrap();
    assert!((median_s - 4.0).abs() < 2e-3 && (p95_s - 600.0).abs() < 2e-3, "{median_s}, {p95_s}");
    let told = |codes: &[(&str, i64)]| codes.iter().map(|(code, n)| ((*code).to_owned(), *n)).collect::<Vec<_>>();
    assert_eq!(bench.store.reasons(span()).await.unwrap(), told(&[("fine", 3), ("x", 2)]));
    let empty = Span { since: time("2023-01-01T00:00:00Z"), until: time("2023-02-01T00:00:00Z") };
    assert_eq!(bench.store.durations(empty).await.unwrap(), None);
    assert_eq!(bench.store.reasons(empty).await.unwrap(), []);
    assert_eq!(bench.store.tallies(empty, Step::Day).await.unwrap(), []);
}
