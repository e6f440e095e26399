//! Interior orientations of scans that are drawn for it.

use std::io::Cursor;

use axum::body::Body;
use axum::http::Request;
use gable::interior::{Mark, Plate};
use gable::simulation::film::{Laying, Make, ScanSettings, SimulatedScan, TiffSettings, write_tiff};
use serde_json::{Value, json};

use crate::support::{Service, camera, png};

const PATH: &str = "/api/v1/interior-orientations";

/// The definition of a plate, as `POST /cameras` has it.
fn definition(name: &str, plate: &Plate) -> Value {
    let template = |mark: &Mark| match mark {
        Mark::Library(library) => library.name(),
        Mark::Cut(_) => unreachable!("simulated marks are of the library"),
    };
    let fiducials: Vec<Value> = plate
        .fiducials
        .iter()
        .map(|f| {
            json!({"name": f.name, "position_mm": [f.position_mm.x, f.position_mm.y], "sigma_mm": f.sigma_mm,
                   "template": template(&f.mark), "rotation_deg": f.rotation_rad.to_degrees()})
        })
        .collect();
    let feature = plate.asymmetric.as_ref().unwrap();
    json!({
        "name": name, "principal_distance_mm": 153.2, "principal_point_mm": [0.0, 0.0], "format_mm": plate.format_mm,
        "fiducials": fiducials,
        "asymmetric_feature": {
            "position_mm": [feature.position_mm.x, feature.position_mm.y], "sigma_mm": feature.sigma_mm,
            "template": template(&feature.mark), "rotation_deg": feature.rotation_rad.to_degrees(),
        },
    })
}

/// A service with the camera `film`, the camera `digital` and a scan, whose id is given.
async fn prepared() -> (Service, String) {
    let mut settings = ScanSettings::good(Make::WildRc20, Laying::all()[1]);
    settings.scanner.pixel_um = [40.0, 40.0];
    let scan = SimulatedScan::draw(1, &settings);
    let mut file = Cursor::new(Vec::new());
    write_tiff(&scan, &TiffSettings::default(), &mut file).unwrap();
    let service = Service::new().await;
    assert_eq!(service.post("/api/v1/cameras", &camera("digital")).await.status, 201);
    let made = service.post("/api/v1/cameras", &definition("film", scan.plate())).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let image = service.upload("image/tiff", file.into_inner()).await;
    assert_eq!(image.status, 201, "{:?}", image.body);
    let id = image.json()["id"].as_str().unwrap().to_owned();
    (service, id)
}

#[tokio::test]
async fn a_scan_is_oriented_kept_shown_and_drawn() {
    let (service, image) = prepared().await;
    let wanted = json!({"image": image, "camera": "film"});
    let post = || {
        let post = Request::post(PATH).header("content-type", "application/json").header("idempotency-key", "once");
        post.body(Body::from(wanted.to_string())).unwrap()
    };
    let made = service.send(post()).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let made_json = made.json();
    let result = &made_json["result"];
    assert_eq!(made_json["verdict"], "green", "{}", result["diagnosis"]);
    assert_eq!(made_json["request"]["pixel_size_from"], "file");
    assert_eq!(made_json["request"]["pixel_size_um"], 40.0);
    assert_eq!(
        (&result["plate_orientation"]["quarter_turns"], result["polarity"].as_str()),
        (&json!(1), Some("positive"))
    );
    assert_eq!(service.send(post()).await.body, made.body);

    let location = made.headers["location"].to_str().unwrap().to_owned();
    assert_eq!(service.get(&location).await.json(), made_json);
    for query in [String::new(), format!("?image={image}&verdict=green"), "?camera=film&limit=1".to_owned()] {
        let page = service.get(&format!("{PATH}{query}")).await.json();
        assert_eq!(page["items"].as_array().unwrap().len(), 1, "{query}: {page}");
        assert_eq!(page["items"][0]["id"], made_json["id"]);
        assert!(page["items"][0].get("result").is_none());
    }
    for query in ["?verdict=red", "?camera=digital"] {
        assert_eq!(service.get(&format!("{PATH}{query}")).await.json()["items"], json!([]));
    }
    assert_eq!(service.get(&format!("{PATH}?verdict=blue")).await.problem(422), ["?verdict"]);

    let drawing = service.get(&format!("{location}/residuals.svg")).await;
    assert_eq!((drawing.status.as_u16(), &drawing.headers["content-type"]), (200, &"image/svg+xml".parse().unwrap()));
    let mark = result["marks"][0]["name"].as_str().unwrap();
    let picture = service.get(&format!("{location}/marks/{mark}.png")).await;
    assert_eq!((picture.status.as_u16(), &picture.headers["content-type"]), (200, &"image/png".parse().unwrap()));
    assert!(image::load_from_memory(&picture.body).unwrap().width() <= 600);
    for missing in ["marks/none.png".to_owned(), format!("marks/{mark}")] {
        service.get(&format!("{location}/{missing}")).await.problem(404);
    }

    service.delete("/api/v1/cameras/film").await.problem(409);
    assert_eq!(service.delete(&location).await.status, 204);
    for path in [String::new(), "/residuals.svg".to_owned(), format!("/marks/{mark}.png")] {
        service.get(&format!("{location}{path}")).await.problem(404);
    }
    service.delete(&location).await.problem(404);
}

#[tokio::test]
async fn what_cannot_be_oriented_is_told_by_its_field_and_no_film_is_a_red_result() {
    let (service, scan) = prepared().await;
    let photograph = service.upload("image/png", png(0)).await.json()["id"].clone();
    let nobody = "0190a6f4-7a3c-7000-8000-000000000000";
    for (image, camera, pixel_um, field) in [
        (scan.as_str(), "digital", 40.0, "/camera"),
        (&scan, "none", 40.0, "/camera"),
        (nobody, "film", 40.0, "/image"),
        (&scan, "film", 4000.0, "/pixel_size_um"),
    ] {
        let wanted = json!({"image": image, "camera": camera, "pixel_size_um": pixel_um});
        assert_eq!(service.post(PATH, &wanted).await.problem(422), [field]);
    }
    let red = service.post(PATH, &json!({"image": photograph, "camera": "film"})).await;
    assert_eq!((red.status.as_u16(), &red.json()["verdict"]), (201, &json!("red")), "{:?}", red.body);
    let location = red.headers["location"].to_str().unwrap().to_owned();
    assert_eq!(service.get(&format!("{location}/residuals.svg")).await.status, 200);
    let mark = red.json()["result"]["marks"][0]["name"].as_str().unwrap().to_owned();
    service.get(&format!("{location}/marks/{mark}.png")).await.problem(404);
}
