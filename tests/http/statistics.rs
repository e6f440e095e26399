//! Statistics, through the router.

use serde_json::{Value, json};

use crate::orientations::{Working, quick};
use crate::support::Service;

#[tokio::test(flavor = "multi_thread")]
async fn what_has_ended_is_counted_in_the_step_of_now() {
    let working = Working::with(quick()).await;
    for _ in 0..3 {
        assert_eq!(working.ask(&working.request(), &[("prefer", "wait=20")]).await.status, 200);
    }
    for (query, count) in [("", 7), ("?step=day", 7), ("?step=hour", 144)] {
        let told = working.service.get(&format!("/api/v1/statistics{query}")).await.json();
        let steps = told["steps"].as_array().unwrap();
        assert!(steps.len() == count || (count == 144 && (145..=168).contains(&steps.len())), "{}", steps.len());
        let sum = |name: &str| steps.iter().map(|step| step[name].as_i64().unwrap()).sum::<i64>();
        assert_eq!([sum("submitted"), sum("succeeded"), sum("yellow")], [3, 3, 3], "{told}");
        assert_eq!([sum("failed"), sum("cancelled"), sum("green"), sum("red"), sum("accepted")], [0; 5]);
        assert_eq!((&told["queued"], &told["running"], told.get("oldest_queued_at")), (&json!(0), &json!(0), None));
        assert_eq!(told["doubtful"], json!(3));
        assert_eq!(told["reasons"], json!([{"code": "few_control_points", "count": 3}]));
        assert_eq!(told["failures"], json!([]));
        let (median, p95) = (told["seconds"]["median"].as_f64().unwrap(), told["seconds"]["p95"].as_f64().unwrap());
        assert!((0.0..60.0).contains(&median) && median <= p95, "{told}");
        assert_eq!(told["step"], if query.contains("hour") { "hour" } else { "day" });
    }
}

#[tokio::test]
async fn parameters_that_make_no_sense_are_refused() {
    let service = Service::new().await;
    let empty = service.get("/api/v1/statistics?since=2024-02-28T12:00:00Z&until=2024-03-01T00:00:00Z").await.json();
    let at: Vec<&Value> = empty["steps"].as_array().unwrap().iter().map(|step| &step["at"]).collect();
    assert_eq!(at, ["2024-02-28T00:00:00Z", "2024-02-29T00:00:00Z"]);
    assert!(empty.get("seconds").is_none());
    for (query, pointer) in [
        ("since=now", "?since"),
        ("since=2100-01-01T00:00:00Z", "?since"),
        ("since=2020-01-01T00:00:00Z&until=2024-01-01T00:00:00Z", "?step"),
        ("since=2024-01-01T00:00:00Z&until=2024-03-01T00:00:00Z&step=hour", "?step"),
        ("step=week", "?step"),
        ("by=day", "?"),
    ] {
        let pointers = service.get(&format!("/api/v1/statistics?{query}")).await.problem(422);
        assert!(pointers[0].starts_with(pointer), "{query}: {pointers:?}");
    }
}
