//! Looking at orientations, correcting them by hand, and deciding about them.

use serde_json::{Value, json};

use crate::orientations::{Working, id, quick};

async fn oriented(working: &Working) -> String {
    let answer = working.ask(&working.request(), &[("prefer", "wait=20")]).await;
    assert_eq!(answer.status, 200);
    id(&answer)
}

fn path(id: &str, rest: &str) -> String {
    format!("/api/v1/orientations/{id}/{rest}")
}

#[tokio::test(flavor = "multi_thread")]
async fn what_there_is_to_see_is_told_in_pixels_and_on_the_ground() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let drawing = working.service.get(&path(&id, "drawing")).await.json();
    assert_eq!(drawing["image"]["width_px"], 64);
    let point = &drawing["control_points"][0];
    assert_eq!(
        (&point["name"], &point["state"], &point["kind"]),
        (&json!("church"), &json!("matched"), &json!("lines"))
    );
    assert_eq!(point["located_px"], json!([30.0, 35.0]));
    assert_eq!(
        drawing["edges"][0],
        json!({"control_point": 0, "projected_px": [[10.0, 10.0], [50.0, 10.0]], "matched_px": []})
    );
    let answer = working.service.get(&path(&id, "map")).await;
    assert_eq!(answer.headers["content-type"], "application/geo+json");
    let map = answer.json();
    let of_role = |role: &str| {
        let features = map["features"].as_array().unwrap().iter();
        features.filter(|f| f["properties"]["role"] == role).cloned().collect::<Vec<Value>>()
    };
    let centre = &of_role("projection_centre")[0]["geometry"]["coordinates"];
    for (value, expected) in [16.6, 52.7, 400.0].into_iter().enumerate() {
        assert!((centre[value].as_f64().unwrap() - expected).abs() < 1e-6, "{centre}");
    }
    let sigma = of_role("projection_centre")[0]["properties"]["sigma_m"][0].as_f64().unwrap();
    assert!((sigma - 0.01).abs() < 1e-12);
    // three standard deviations of 1 cm, magnified by a round number
    let ellipse = &of_role("error_ellipse")[0];
    let magnification = ellipse["properties"]["magnification"].as_f64().unwrap();
    let latitudes = ellipse["geometry"]["coordinates"][0].as_array().unwrap().iter().map(|p| p[1].as_f64().unwrap());
    let reach_m = (latitudes.fold(0.0, f64::max) - 52.7) * 111_270.0;
    assert!((reach_m / magnification - 0.03).abs() < 2e-4, "{reach_m} {magnification}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_decision_is_kept_with_who_and_why() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let reviews = path(&id, "reviews");
    // the fake pipeline keeps no orientation to learn from but its estimate
    let accepted = working.service.post(&reviews, &json!({"decision": "accepted"})).await;
    assert_eq!(accepted.status, 201, "{}", accepted.json());
    let rejected = working.service.post(&reviews, &json!({"decision": "rejected", "why": " wrong village \n"})).await;
    assert_eq!(rejected.status, 201);
    assert_eq!(rejected.json()["why"], "wrong village");
    assert_eq!(rejected.json()["who"], "loopback");
    let listed = working.service.get(&reviews).await.json();
    let told: Vec<&Value> = listed["items"].as_array().unwrap().iter().map(|review| &review["decision"]).collect();
    assert_eq!(told, ["rejected", "accepted"]);
    let orientation = working.service.get(&format!("/api/v1/orientations/{id}")).await.json();
    assert_eq!(orientation["review"], "rejected");
    assert_eq!(orientation["verdict"], "yellow", "the result stays as it was found");
    // what was rejected after all is no reference any more
    assert_eq!(working.service.get("/api/v1/references").await.json()["items"], json!([]));
    working.service.post(&reviews, &json!({"decision": "accepted"})).await;
    let references = working.service.get("/api/v1/references").await.json();
    assert_eq!(references["items"][0]["image"], json!(working.image));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_decision_that_makes_no_sense_is_refused_and_changes_nothing() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let reviews = path(&id, "reviews");
    for (review, pointer) in [
        (json!({"decision": "rejected"}), "/why"),
        (json!({"decision": "rejected", "why": "  "}), "/why"),
        (json!({"decision": "accepted", "correction": {"off": ["church"]}}), "/why"),
        (json!({"decision": "accepted", "why": "x".repeat(2001)}), "/why"),
        (json!({"decision": "accepted", "why": "a\u{7}b"}), "/why"),
        (json!({"decision": "accepted", "why": "so", "correction": {"off": ["nobody"]}}), "/correction"),
        (
            json!({"decision": "accepted", "why": "so", "correction": {"moved": [{"name": "a", "at_px": [81.0, 2.0]}]}}),
            "/correction/moved/0/at_px",
        ),
        (
            json!({"decision": "accepted", "why": "so", "correction": {"moved":
                [{"name": "a", "at_px": [5.0, 2.0]}, {"name": "a", "at_px": [6.0, 2.0]}]}}),
            "/correction/moved/1/name",
        ),
        (json!({"decision": "perhaps"}), "/decision"),
        (json!({"decision": "accepted", "who": "somebody else"}), "/who"),
    ] {
        let answer = working.service.post(&reviews, &review).await;
        assert!(answer.problem(422).contains(&pointer.to_owned()), "{review}: {:?}", answer.json());
    }
    assert_eq!(working.service.get(&reviews).await.json()["items"], json!([]));
    let nobody = path("01940000-0000-7000-8000-000000000000", "reviews");
    working.service.post(&nobody, &json!({"decision": "accepted"})).await.problem(404);
    working.service.get(&nobody).await.problem(404);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trial_keeps_nothing() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let before = working.service.get(&format!("/api/v1/orientations/{id}")).await.json();
    // on the desk the image is oriented by the pipeline itself, and here there is no control
    let tried = working.service.post(&path(&id, "trials"), &json!({})).await;
    assert_eq!(tried.status, 200, "{}", tried.json());
    assert_eq!(tried.json()["result"]["diagnosis"]["reasons"][0]["code"], "no_control_in_view");
    assert_eq!(tried.json()["drawing"]["control_points"], json!([]));
    let unknown = working.service.post(&path(&id, "trials"), &json!({"off": ["church"]})).await;
    assert_eq!(unknown.status, 422);
    working.service.get(&path(&id, "control-points/church/window")).await.problem(404);
    assert_eq!(working.service.get(&format!("/api/v1/orientations/{id}")).await.json(), before);
    assert_eq!(working.service.get(&path(&id, "reviews")).await.json()["items"], json!([]));
}
