use nalgebra::{Vector2, Vector3};
use serde_json::json;

use super::*;
use crate::classifiers::labelled::tests::simulated;
use crate::classifiers::labelled::{Pose, TrialRecord};
use crate::control::near::Reach;
use crate::database::query;
use crate::geometry::Brown;
use crate::imagery::Limits;
use crate::jobs::active::{SHIPPED, stored_classifier};
use crate::jobs::request::{ImageFacts, OrientationRequest};
use crate::jobs::{Jobs, Settings};
use crate::pipeline::Fault;
use crate::store::classifiers::ClassifierStatus;
use crate::store::images::Header;
use crate::store::now;
use crate::store::reviews::{Decision, NewReview};

/// A data folder with a camera and an image.
pub(in crate::jobs) struct Bench {
    pub(in crate::jobs) store: Store,
    camera: Camera,
    camera_id: Uuid,
    image_id: Uuid,
    _folder: tempfile::TempDir,
}

const SIZE_PX: [u32; 2] = [60, 40];

impl Bench {
    pub(in crate::jobs) async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        let camera = Camera::new(SIZE_PX, 50.0, Vector2::new(30.0, 20.0), Brown::default()).unwrap();
        let (camera_id, image_id) = (Uuid::now_v7(), Uuid::now_v7());
        store.add_camera(camera_id, "camera", &camera).await.unwrap();
        let mut upload = store.begin_upload().unwrap();
        upload.write(b"an image").await.unwrap();
        let header = Header {
            format: "png".into(),
            width_px: SIZE_PX[0],
            height_px: SIZE_PX[1],
            position: None,
            camera_model: None,
            taken_on: None,
        };
        store.keep_image(image_id, upload.complete().await.unwrap(), &header, None).await.unwrap();
        Self { store, camera, camera_id, image_id, _folder: folder }
    }

    /// A request for the image, 400 m above the ellipsoid.
    fn prepared(&self, tolerance: (&str, f64)) -> Prepared {
        let position = json!({"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 400.0]});
        let mut request = json!({"image": self.image_id, "camera": "camera", "approximation": {"position": position}});
        request[tolerance.0] = tolerance.1.into();
        let request: OrientationRequest = serde_json::from_value(request).unwrap();
        request
            .prepare(
                Some([self.camera.width_px, self.camera.height_px]),
                &ImageFacts { size_px: SIZE_PX, ..ImageFacts::default() },
            )
            .unwrap()
    }

    /// Orientations of the image that have succeeded with these records.
    pub(in crate::jobs) async fn keep(&self, records: &[String]) {
        self.keep_prepared(records, &self.prepared(("tolerance_m", 1.0))).await;
    }

    async fn keep_prepared(&self, records: &[String], prepared: &Prepared) {
        let mut transaction = self.store.begin_write().await.unwrap();
        for record in records {
            let sql = "INSERT INTO orientations
                 (id, image_id, camera_id, prepared, status, verdict, result, drawing, record, created_at)
                 VALUES ($1, $2, $3, $4, 'succeeded', 'green', '{}', '{}', $5, $6)";
            query(sql)
                .bind(Uuid::now_v7())
                .bind(self.image_id)
                .bind(self.camera_id)
                .bind(serde_json::to_string(prepared).unwrap())
                .bind(record)
                .bind(now())
                .execute(&mut transaction)
                .await
                .unwrap();
        }
        transaction.commit().await.unwrap();
    }

    /// Gives the reference of the image in the local frame of the request.
    async fn refer(&self, truth: &ExteriorOrientation) {
        let frame = self.prepared(("tolerance_m", 1.0)).frame().unwrap();
        let rotation = truth.camera_from_object * frame.local_from_geocentric();
        let rows = std::array::from_fn(|k| rotation.matrix()[(k / 3, k % 3)]);
        let centre_m = frame.to_geocentric(truth.projection_centre_m).into();
        let reference = given_now(self.image_id, "west".to_owned(), centre_m, rows);
        self.store.put_references(&[reference]).await.unwrap();
    }

    fn jobs(&self) -> Jobs {
        let settings = Settings {
            workers: 1,
            queue_max: 10,
            max_attempts: 1,
            timeout: Duration::from_secs(60),
            limits: Limits::default(),
            reach: Reach::default(),
        };
        Jobs::new(self.store.clone(), settings, Arc::new(|_, _, _, _| Err(Fault::Cancelled)))
    }

    /// Queues a training, of an uploaded set if there is one.
    async fn queue(&self, name: &str, kind: Kind, set: Option<&[u8]>, activate: bool) -> Uuid {
        let id = Uuid::now_v7();
        let plan = TrainingPlan {
            kinds: vec![kind.name().to_owned()],
            costs: Costs::default().into(),
            source: if set.is_some() { Source::Upload } else { Source::History },
            activate,
        };
        if let Some(set) = set {
            std::fs::write(upload_path(&self.store, id), set).unwrap();
        }
        assert!(self.store.queue_classifier(id, name, &serde_json::to_string(&plan).unwrap()).await.unwrap());
        id
    }

    /// The classifier as soon as this holds for it.
    async fn until(&self, id: Uuid, holds: impl Fn(&StoredClassifier) -> bool) -> StoredClassifier {
        let waiting = async {
            loop {
                let stored = self.store.classifier(id).await.unwrap().unwrap();
                if holds(&stored) {
                    return stored;
                }
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(60), waiting).await.unwrap()
    }

    async fn ended(&self, id: Uuid) -> StoredClassifier {
        self.until(id, |stored| stored.finished_at.is_some()).await
    }

    fn uploads(&self) -> usize {
        std::fs::read_dir(self.store.folder().join(TRAINING)).unwrap().count()
    }
}

fn lines(images: &[LabelledImage]) -> Vec<u8> {
    images.iter().flat_map(|image| serde_json::to_vec(image).unwrap().into_iter().chain(*b"\n")).collect()
}

fn two_areas() -> Vec<LabelledImage> {
    [simulated("north", 1, 100), simulated("south", 2, 80)].concat()
}

fn record(estimate: Option<Pose>) -> String {
    let record = Record {
        evidence: Some([("sigma0".to_owned(), 1.25)].into()),
        estimate,
        ground_height_m: estimate.map(|_| 100.0),
        trials: vec![TrialRecord(9, 1, 0.5, 1.5, Pose([0.0, 0.5, 400.0, 0.0, 0.0, 0.7]))],
    };
    serde_json::to_string(&record).unwrap()
}

#[test]
fn a_set_is_read_line_by_line_and_the_line_at_fault_is_named() {
    let images = simulated("north", 1, 5);
    assert_eq!(parse_set(&lines(&images)), Ok(images.clone()));
    let spaced = String::from_utf8(lines(&images)).unwrap().replace('\n', "\r\n \r\n");
    assert_eq!(parse_set(spaced.as_bytes()), Ok(images.clone()));
    assert_eq!(parse_set(b"\n\n"), Ok(vec![]));
    for broken in [&b"{"[..], b"[]", b"\xff", b"{\"image\": \"a\", \"area\": \"b\", \"tolerance_m\": -1}"] {
        let content = [&lines(&images[..2]), &b"\n"[..], broken, b"\n", &lines(&images[2..])].concat();
        let fault = parse_set(&content).unwrap_err();
        assert!(fault.starts_with("line 4: "), "{fault}");
    }
}

#[tokio::test]
async fn the_history_is_held_against_the_references() {
    let bench = Bench::new().await;
    bench.refer(&Pose([0.0, 0.0, 400.0, 0.0, 0.0, 0.7]).into()).await;
    let found = [record(Some(Pose([3.0, 4.0, 400.0, 0.0, 0.0, 0.7])))];
    bench.keep_prepared(&found, &bench.prepared(("tolerance_m", 4.0))).await;
    // 300 m above ground a pixel is 6 m
    bench.keep_prepared(&found, &bench.prepared(("tolerance_gsd", 2.0))).await;
    bench.keep_prepared(&[record(None)], &bench.prepared(("tolerance_gsd", 2.0))).await;
    let TrainingSet { sets, images } = history(&bench.store).await.unwrap();
    assert_eq!((sets.len(), sets[0].name.as_str(), sets[0].images), (1, "history", 3));
    let named = |image: &LabelledImage| image.image == bench.image_id.to_string() && image.area == "west";
    assert!(images.iter().all(named), "{images:?}");
    let d_max_m: Vec<f64> = images.iter().filter_map(|image| image.d_max_m).collect();
    assert!(d_max_m.len() == 2 && d_max_m.iter().all(|d_max_m| (d_max_m - 5.0).abs() < 1e-5), "{d_max_m:?}");
    let right: Vec<bool> = images.iter().map(LabelledImage::right).collect();
    assert_eq!(right, [false, true, false]);
    let tolerances_m = images.iter().map(|image| image.tolerance_m).zip([4.0, 12.0, NO_TOLERANCE_M]);
    assert!(tolerances_m.clone().all(|(a, b)| (a - b).abs() < 1e-6), "{tolerances_m:?}");
    assert!((images[0].trials[0].4 - 0.5).abs() < 1e-3, "{:?}", images[0].trials);
}

#[tokio::test]
async fn a_history_is_read_over_many_pages_and_a_damaged_row_is_told() {
    let bench = Bench::new().await;
    bench.keep(&vec![record(Some(Pose([3.0, 4.0, 400.0, 0.0, 0.0, 0.7]))); 2 * PAGE as usize + 1]).await;
    assert_eq!(history(&bench.store).await.unwrap().images, [], "there is no reference yet");
    bench.refer(&Pose([0.0, 0.0, 400.0, 0.0, 0.0, 0.7]).into()).await;
    assert_eq!(history(&bench.store).await.unwrap().images.len(), 2 * PAGE as usize + 1);
    bench.keep(&["{}".to_owned()]).await;
    assert!(matches!(history(&bench.store).await, Err(TrainingError::Json(_))));
}

#[test]
fn a_reference_is_the_same_in_every_frame() {
    let truth = ExteriorOrientation::from(Pose([120.0, -80.0, 500.0, 0.05, -0.03, 1.2]));
    let frame = LocalFrame::at(16.6, 52.7, 0.0);
    let rotation = truth.camera_from_object * frame.local_from_geocentric();
    let rows = std::array::from_fn(|k| rotation.matrix()[(k / 3, k % 3)]);
    let centre_m = frame.to_geocentric(truth.projection_centre_m).into();
    let reference = given_now(Uuid::nil(), String::new(), centre_m, rows);
    let same = in_frame(&reference, &frame);
    assert!((same.projection_centre_m - truth.projection_centre_m).norm() < 1e-6);
    assert!(same.camera_from_object.angle_to(&truth.camera_from_object) < 1e-9);
    // seen from elsewhere it is turned, but looks at the same point
    let elsewhere = LocalFrame::at(17.1, 52.9, 50.0);
    let other = in_frame(&reference, &elsewhere);
    assert!(other.camera_from_object.angle_to(&truth.camera_from_object) > 1e-3);
    let looks_at = |frame: &LocalFrame, o: &ExteriorOrientation| {
        frame.to_geocentric(o.projection_centre_m + 400.0 * (o.camera_from_object.inverse() * -Vector3::z()))
    };
    assert!((looks_at(&frame, &truth) - looks_at(&elsewhere, &other)).norm() < 1e-6);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_uploaded_set_becomes_a_classifier_that_decides_if_that_was_asked_for() {
    let bench = Bench::new().await;
    let jobs = bench.jobs();
    let set = lines(&two_areas());
    let idle = bench.queue("idle", Kind::OneFeature, Some(&set), false).await;
    let working = tokio::spawn(jobs.0.clone().train());
    let stored = bench.ended(idle).await;
    assert_eq!((stored.status, stored.error.as_deref()), (ClassifierStatus::Ready, None));
    let named = stored_classifier(&stored).unwrap();
    assert_eq!(Some(named.loaded.sha256.to_vec()), stored.sha256);
    let sets = &named.loaded.description.provenance.sets;
    let sha256: String = Sha256::digest(&set).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(sets[..], [LabelledSet { name: "upload".to_owned(), images: 180, sha256 }]);
    assert_eq!(jobs.active_classifier().await.unwrap().name, SHIPPED);
    let active = bench.queue("active", Kind::OneFeature, Some(&set), true).await;
    jobs.announce_training();
    bench.ended(active).await;
    jobs.0.stopping.cancel();
    working.await.unwrap();
    assert_eq!(jobs.active_classifier().await.unwrap().name, "active");
    assert_eq!(bench.uploads(), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_trained_says_why_and_holds_nothing_up() {
    let bench = Bench::new().await;
    let all_right: Vec<LabelledImage> = two_areas().into_iter().filter(LabelledImage::right).collect();
    let broken = [lines(&two_areas()), b"{}\n".to_vec()].concat();
    let failing = [
        (bench.queue("broken", Kind::OneFeature, Some(&broken), true).await, "line 181: missing field"),
        (bench.queue("all right", Kind::EvidenceLogistic, Some(&lines(&all_right)), true).await, "0 are wrong"),
        (bench.queue("no history", Kind::Paper, None, true).await, "at least 5 of each"),
        (bench.queue("lost", Kind::Paper, Some(b""), true).await, "cannot be read"),
    ];
    std::fs::remove_file(upload_path(&bench.store, failing[3].0)).unwrap();
    let last = bench.queue("last", Kind::OneFeature, Some(&lines(&two_areas())), false).await;
    let jobs = bench.jobs();
    let working = tokio::spawn(jobs.0.clone().train());
    assert_eq!(bench.ended(last).await.status, ClassifierStatus::Ready);
    jobs.0.stopping.cancel();
    working.await.unwrap();
    // of services that share a database another one may have it, for an hour
    let failing = if bench.store.database().is_shared() { &failing[..3] } else { &failing[..] };
    for &(id, said) in failing {
        let stored = bench.ended(id).await;
        let error = stored.error.unwrap();
        assert!(stored.status == ClassifierStatus::Failed && error.contains(said), "{}: {error}", stored.name);
    }
    assert_eq!((bench.store.activations(1).await.unwrap(), bench.uploads()), (vec![], 0));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_training_that_the_end_of_the_service_has_interrupted_begins_anew() {
    let bench = Bench::new().await;
    let id = bench.queue("name", Kind::EvidenceSvm, Some(&lines(&two_areas())), false).await;
    let jobs = bench.jobs();
    let working = tokio::spawn(jobs.0.clone().train());
    bench.until(id, |stored| stored.status == ClassifierStatus::Training).await;
    jobs.0.stopping.cancel();
    working.await.unwrap();
    let stored = bench.store.classifier(id).await.unwrap().unwrap();
    assert_eq!((stored.status, bench.uploads()), (ClassifierStatus::Training, 1));
    let next = bench.jobs();
    let working = tokio::spawn(next.0.clone().train());
    assert_eq!(bench.ended(id).await.status, ClassifierStatus::Ready);
    next.0.stopping.cancel();
    working.await.unwrap();
}

async fn decide(bench: &Bench, decision: Decision, reference: Option<ReferenceOrientation>) {
    let latest = query("SELECT id FROM orientations ORDER BY id DESC LIMIT 1");
    let id: Uuid = latest.fetch_value(bench.store.database()).await.unwrap();
    let (why, who) = (String::new(), String::from("loopback"));
    let review = NewReview { id: Uuid::now_v7(), orientation_id: id, decision, why, who, corrected: None, reference };
    bench.store.add_review(&review).await.unwrap().unwrap();
}

#[tokio::test]
async fn what_staff_reject_is_learned_as_wrong() {
    let bench = Bench::new().await;
    let near = TrialRecord(9, 1, 0.5, 1.5, Pose([3.0, 4.1, 400.0, 0.0, 0.0, 0.7]));
    let found = Pose([3.0, 4.0, 400.0, 0.0, 0.0, 0.7]);
    let mut kept: Record = serde_json::from_str(&record(Some(found))).unwrap();
    kept.trials.push(near);
    bench.keep(&[serde_json::to_string(&kept).unwrap()]).await;
    assert_eq!(history(&bench.store).await.unwrap().images, []);
    decide(&bench, Decision::Rejected, None).await;
    let images = history(&bench.store).await.unwrap().images;
    assert_eq!(images.len(), 1);
    assert!(!images[0].right());
    // of the trial that leads elsewhere nothing is known
    assert_eq!(images[0].trials.len(), 1);
    assert!(images[0].trials[0].4 > images[0].tolerance_m);
}

#[tokio::test]
async fn what_staff_accept_is_learned_as_right() {
    let bench = Bench::new().await;
    let found = record(Some(Pose([3.0, 4.0, 400.0, 0.01, -0.02, 0.7])));
    bench.keep(std::slice::from_ref(&found)).await;
    let prepared = serde_json::to_string(&bench.prepared(("tolerance_m", 1.0))).unwrap();
    let kept: Record = serde_json::from_str(&found).unwrap();
    let reference = accepted(bench.image_id, &prepared, &kept).unwrap();
    assert!(reference.is_some());
    decide(&bench, Decision::Accepted, reference).await;
    let images = history(&bench.store).await.unwrap().images;
    assert_eq!(images.len(), 1);
    // held against itself, through geocentric coordinates and back
    assert!(images[0].right() && images[0].d_max_m.unwrap() < 1e-5, "{:?}", images[0].d_max_m);
    assert_eq!(accepted(bench.image_id, &prepared, &Record { estimate: None, ..kept }).unwrap(), None);
}
