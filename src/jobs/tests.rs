use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Matrix6, Vector2};
use serde_json::json;

use super::*;
use crate::database::query;
use crate::diagnosis::{Diagnosis, Verdict};
use crate::features::PictureError;
use crate::geometry::{Brown, Camera};
use crate::jobs::request::{ImageFacts, OrientationRequest};
use crate::pipeline::{Estimate, Stage};
use crate::store::images::Header;
use crate::store::orientations::Finished;
use crate::store::orientations::{Abandoned, Claim, DiagnosisInShort, Priority};
use crate::store::scratch::over_sqlite;

/// A service's jobs over a fresh data folder with one camera and one image.
struct Bench {
    folder: tempfile::TempDir,
    store: Store,
    image_id: Uuid,
    camera_id: Uuid,
    prepared: String,
}

const SIZE_PX: [u32; 2] = [60, 40];

impl Bench {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        let camera = Camera::new(SIZE_PX, 50.0, Vector2::new(30.0, 20.0), Brown::default()).unwrap();
        let camera_id = Uuid::now_v7();
        store.add_camera(camera_id, "camera", &camera).await.unwrap();
        let mut png = std::io::Cursor::new(Vec::new());
        image::GrayImage::new(SIZE_PX[0], SIZE_PX[1]).write_to(&mut png, image::ImageFormat::Png).unwrap();
        let image_id = upload(&store, png.get_ref()).await;
        let request: OrientationRequest = serde_json::from_value(json!({
            "image": image_id.to_string(), "camera": "camera",
            "approximation": {"position": {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 400.0]}}}))
        .unwrap();
        let facts = ImageFacts { size_px: SIZE_PX, ..ImageFacts::default() };
        let prepared =
            serde_json::to_string(&request.prepare(Some([camera.width_px, camera.height_px]), &facts).unwrap())
                .unwrap();
        Self { folder, store, image_id, camera_id, prepared }
    }

    fn jobs(&self, orient: Orient) -> Jobs {
        self.jobs_with(orient, |_| {})
    }

    fn jobs_with(&self, orient: Orient, change: impl FnOnce(&mut Settings)) -> Jobs {
        let mut settings = Settings {
            workers: 2,
            queue_max: 100,
            max_attempts: 3,
            timeout: Duration::from_secs(60),
            limits: Limits::default(),
            reach: Reach::default(),
        };
        change(&mut settings);
        Jobs::new(self.store.clone(), settings, orient)
    }

    fn wanted(&self) -> NewOrientation {
        let (image_id, camera_id, prepared) = (self.image_id, self.camera_id, self.prepared.clone());
        let (lane, priority) = (String::new(), Priority::Normal);
        NewOrientation { id: Uuid::now_v7(), image_id, camera_id, prepared, lane, priority, webhook: None }
    }

    async fn row(&self, id: Uuid) -> Orientation {
        self.store.orientation(id).await.unwrap().unwrap()
    }
}

async fn upload(store: &Store, bytes: &[u8]) -> Uuid {
    let mut upload = store.begin_upload().unwrap();
    upload.write(bytes).await.unwrap();
    let received = upload.complete().await.unwrap();
    let header = Header {
        format: "png".into(),
        width_px: SIZE_PX[0],
        height_px: SIZE_PX[1],
        position: None,
        camera_model: None,
        taken_on: None,
    };
    store.keep_image(Uuid::now_v7(), received, &header, None).await.unwrap().0.id
}

fn outcome(task: &Task) -> Outcome {
    Outcome {
        cost: None,
        evidence: None,
        trials: vec![],
        ground_height_m: None,
        footprint_m: Vec::new(),
        check_points: Vec::new(),
        pairs: vec![],
        estimate: Some(Estimate {
            orientation: task.approximation.orientation,
            covariance: Matrix6::identity(),
            sigma0: 1.0,
            redundancy: 10,
            configuration: 2.0,
        }),
        control_points: vec![],
        edges: vec![],
        ground_precision: vec![],
        consensus: None,
        diagnosis: Diagnosis {
            verdict: Verdict::Green,
            score: 1.0,
            threshold: 0.0,
            probability_correct: 0.9,
            features: None,
            reasons: vec![],
            probably_right: vec![],
            probably_wrong: vec![],
        },
    }
}

/// A pipeline that passes its stages and succeeds at once.
fn quick() -> Orient {
    Arc::new(|_, _, task, observer| {
        observer.progress(Stage::Predict, 0.1);
        observer.progress(Stage::Adjust, 0.9);
        Ok(outcome(task))
    })
}

/// A pipeline that goes on until it is told to end.
fn endless(begun: Arc<AtomicUsize>) -> Orient {
    Arc::new(move |_, _, _, observer| {
        observer.progress(Stage::Locate, 0.3);
        begun.fetch_add(1, Ordering::SeqCst);
        while !observer.cancelled() {
            std::thread::sleep(Duration::from_millis(2));
        }
        Err(Fault::Cancelled)
    })
}

const PATIENCE: Duration = Duration::from_secs(20);

/// Works in the background until the returned token is cancelled.
async fn start(jobs: &Jobs) -> (CancellationToken, tokio::task::JoinHandle<()>) {
    jobs.prepare().await.unwrap();
    let stop = CancellationToken::new();
    let (jobs, stopped) = (jobs.clone(), stop.clone());
    (stop, tokio::spawn(async move { jobs.run(stopped).await }))
}

async fn until(condition: impl Fn() -> bool) {
    let waiting = async {
        while !condition() {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    };
    tokio::time::timeout(PATIENCE, waiting).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_orientation_that_was_accepted_comes_to_its_end() {
    let bench = Bench::new().await;
    let jobs = bench.jobs(quick());
    let mut changes = jobs.subscribe();
    let (stop, ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts, row.verdict.as_deref()), (Status::Succeeded, 1, Some("green")));
    let result: serde_json::Value = serde_json::from_str(&row.result.unwrap()).unwrap();
    let centre = &result["projection_centre"]["coordinates"];
    assert!((centre[2].as_f64().unwrap() - 400.0).abs() < 1e-6, "{centre}");
    let heard: Vec<Change> = std::iter::from_fn(|| changes.try_recv().ok()).collect();
    // services that share a database also tell each other, and hear themselves
    let mut told: Vec<(Status, Option<&str>)> = Vec::new();
    for change in heard.iter().map(|c| (c.status, c.stage.as_deref())) {
        if !told.contains(&change) {
            told.push(change);
        }
    }
    let verdict = heard.iter().rev().find(|c| c.status == Status::Succeeded).and_then(|c| c.verdict.as_deref());
    assert_eq!(verdict, Some("green"));
    assert_eq!(
        told,
        [
            (Status::Queued, None),
            (Status::Running, None),
            (Status::Running, Some("predict")),
            (Status::Running, Some("adjust")),
            (Status::Succeeded, None)
        ]
    );
    stop.cancel();
    tokio::time::timeout(PATIENCE, ended).await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_second_try_of_a_submission_is_the_same_orientation() {
    let bench = Bench::new().await;
    let runs = Arc::new(AtomicUsize::new(0));
    let counted = runs.clone();
    let jobs = bench.jobs(Arc::new(move |_, _, task, _| {
        counted.fetch_add(1, Ordering::SeqCst);
        Ok(outcome(task))
    }));
    let (_stop, _ended) = start(&jobs).await;
    let (wanted, other) = (bench.wanted(), bench.wanted());
    jobs.submit(&wanted).await.unwrap();
    jobs.submit(&wanted).await.unwrap();
    jobs.submit(&other).await.unwrap();
    for id in [wanted.id, other.id] {
        assert_eq!(jobs.wait(id, PATIENCE).await.unwrap().unwrap().status, Status::Succeeded);
    }
    assert_eq!(runs.load(Ordering::SeqCst), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn cancelling_ends_what_waits_and_what_runs() {
    let bench = Bench::new().await;
    let begun = Arc::new(AtomicUsize::new(0));
    let jobs = bench.jobs_with(endless(begun.clone()), |settings| settings.workers = 1);
    let (stop, ended) = start(&jobs).await;
    let (first, second) = (bench.wanted(), bench.wanted());
    jobs.submit(&first).await.unwrap();
    until(|| begun.load(Ordering::SeqCst) == 1).await;
    jobs.submit(&second).await.unwrap();
    assert!(jobs.cancel(second.id).await.unwrap());
    assert!(jobs.cancel(first.id).await.unwrap());
    assert!(!jobs.cancel(first.id).await.unwrap(), "it has ended already");
    // the worker is free again, and skips the one that was cancelled while it waited
    let third = bench.wanted();
    jobs.submit(&third).await.unwrap();
    until(|| begun.load(Ordering::SeqCst) == 2).await;
    for id in [first.id, second.id] {
        let row = bench.row(id).await;
        assert_eq!((row.status, row.result), (Status::Cancelled, None));
    }
    assert!(!jobs.cancel(Uuid::now_v7()).await.unwrap());
    stop.cancel();
    // the third would go on for ever
    tokio::time::timeout(PATIENCE, ended).await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_is_tried_again_and_then_given_up() {
    let bench = Bench::new().await;
    let jobs = bench.jobs(Arc::new(|_, _, _, _| panic!("out of luck")));
    let (_stop, _ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts), (Status::Failed, 3));
    let error = row.error.unwrap();
    assert_eq!(error.code, "internal");
    assert!(!error.detail.contains("luck"), "the cause is for the log");
}

/// A fault of the pipeline, which must not leave the orientation running for ever.
#[tokio::test(flavor = "multi_thread")]
async fn a_pipeline_that_ends_without_being_told_to_has_failed() {
    let bench = Bench::new().await;
    let jobs = bench.jobs(Arc::new(|_, _, _, _| Err(Fault::Cancelled)));
    let (_stop, _ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts), (Status::Failed, 3));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broken_picture_fails_at_once() {
    let bench = Bench::new().await;
    let jobs = bench.jobs(Arc::new(|_, _, _, _| Err(PictureError { detail: "cut off".into() }.into())));
    let (_stop, _ended) = start(&jobs).await;
    let broken = NewOrientation { image_id: upload(&bench.store, b"no picture at all").await, ..bench.wanted() };
    let damaged = bench.wanted();
    for (wanted, said) in [(broken, "not a JPEG"), (damaged, "cut off")] {
        jobs.submit(&wanted).await.unwrap();
        let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
        assert_eq!((row.status, row.attempts), (Status::Failed, 1));
        let error = row.error.unwrap();
        assert_eq!(error.code, "image_unusable");
        assert!(error.detail.contains(said), "{}", error.detail);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_takes_too_long_is_ended() {
    let bench = Bench::new().await;
    let endless = endless(Arc::default());
    let jobs = bench.jobs_with(endless, |settings| settings.timeout = Duration::from_millis(50));
    let (_stop, _ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.error.unwrap().code.as_str()), (Status::Failed, "timeout"));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_end_of_the_service_hands_work_back_without_counting_it() {
    let bench = Bench::new().await;
    let begun = Arc::new(AtomicUsize::new(0));
    let jobs = bench.jobs(endless(begun.clone()));
    let (stop, ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    until(|| begun.load(Ordering::SeqCst) == 1).await;
    stop.cancel();
    tokio::time::timeout(PATIENCE, ended).await.unwrap().unwrap();
    let row = bench.row(wanted.id).await;
    assert_eq!((row.status, row.attempts), (Status::Queued, 0));
    let next = bench.jobs(quick());
    let (_stop, _ended) = start(&next).await;
    assert_eq!(next.wait(wanted.id, PATIENCE).await.unwrap().unwrap().status, Status::Succeeded);
}

/// The process died in the middle: its rows say running, with a lease that nobody holds any more.
#[tokio::test(flavor = "multi_thread")]
async fn what_a_dead_process_left_is_taken_up_but_not_for_ever() {
    let bench = Bench::new().await;
    let dead = bench.jobs(quick());
    dead.prepare().await.unwrap();
    let (fresh, poison) = (bench.wanted(), bench.wanted());
    for wanted in [&fresh, &poison] {
        dead.submit(wanted).await.unwrap();
    }
    let (stale, process) = (Claim { id: fresh.id, lease: Uuid::now_v7() }, Uuid::now_v7());
    bench.store.begin_attempt(stale, process).await.unwrap().unwrap();
    for _ in 0..3 {
        bench.store.begin_attempt(Claim { id: poison.id, ..stale }, process).await.unwrap().unwrap();
        let mut transaction = bench.store.begin_write().await.unwrap();
        orientations::recover(&mut transaction, Abandoned::By(process), "killed by signal 6").await.unwrap();
        transaction.commit().await.unwrap();
    }
    bench.store.begin_attempt(stale, process).await.unwrap().unwrap();
    if bench.store.database().is_shared() {
        // where others may be at work, it is found by its process, or by its lease
        let mut transaction = bench.store.begin_write().await.unwrap();
        for (id, turn) in orientations::recover(&mut transaction, Abandoned::By(process), "killed").await.unwrap() {
            dead.0.queue.push(&mut transaction, id, turn).await.unwrap();
        }
        transaction.commit().await.unwrap();
    }
    let jobs = bench.jobs(quick());
    let (_stop, _ended) = start(&jobs).await;
    let row = jobs.wait(fresh.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts), (Status::Succeeded, 3));
    let row = jobs.wait(poison.id, PATIENCE).await.unwrap().unwrap();
    let error = row.error.unwrap();
    assert_eq!((row.status, error.code.as_str()), (Status::Failed, "given_up"));
    assert!(error.detail.contains("killed by signal 6"), "{}", error.detail);
    // the dead process comes back: too late
    let late = Finished {
        verdict: "red".into(),
        diagnosis: DiagnosisInShort::default(),
        result: "{}".into(),
        drawing: "{}".into(),
        record: "{}".into(),
        sightings: vec![],
    };
    assert!(!bench.store.finish(stale, &late).await.unwrap());
    assert_eq!(bench.row(fresh.id).await.verdict.as_deref(), Some("green"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_queue_accepts_nothing_more() {
    let bench = Bench::new().await;
    let jobs = bench.jobs_with(quick(), |settings| settings.queue_max = 2);
    jobs.prepare().await.unwrap();
    for _ in 0..2 {
        jobs.submit(&bench.wanted()).await.unwrap();
    }
    let refused = bench.wanted();
    assert!(matches!(jobs.submit(&refused).await, Err(SubmitError::QueueFull { queue_max: 2 })));
    assert!(bench.store.orientation(refused.id).await.unwrap().is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn no_more_run_at_a_time_than_there_are_workers() {
    let bench = Bench::new().await;
    let (now, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let (running, peak) = (now.clone(), most.clone());
    let jobs = bench.jobs(Arc::new(move |_, _, task, _| {
        peak.fetch_max(running.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(30));
        running.fetch_sub(1, Ordering::SeqCst);
        Ok(outcome(task))
    }));
    let (_stop, _ended) = start(&jobs).await;
    let wanted: Vec<_> = (0..8).map(|_| bench.wanted()).collect();
    for new in &wanted {
        jobs.submit(new).await.unwrap();
    }
    for new in &wanted {
        assert_eq!(jobs.wait(new.id, PATIENCE).await.unwrap().unwrap().status, Status::Succeeded);
    }
    assert_eq!(most.load(Ordering::SeqCst), 2);
}

/// A disk that is full for a while costs no result.
#[tokio::test(flavor = "multi_thread")]
async fn a_result_that_cannot_be_written_is_written_later() {
    if !over_sqlite() {
        return;
    }
    let bench = Bench::new().await;
    let jobs = bench.jobs(quick());
    let (_stop, _ended) = start(&jobs).await;
    let refuse = "CREATE TRIGGER full BEFORE UPDATE ON orientations WHEN NEW.status = 'succeeded'
                  BEGIN SELECT RAISE(ABORT, 'no room'); END";
    query(refuse).execute(bench.store.database()).await.unwrap();
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    let row = jobs.wait(wanted.id, Duration::from_millis(300)).await.unwrap().unwrap();
    assert_eq!(row.status, Status::Running);
    query("DROP TRIGGER full").execute(bench.store.database()).await.unwrap();
    let row = jobs.wait(wanted.id, PATIENCE).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts), (Status::Succeeded, 1));
}

/// The queue's own set-up would switch the syncing of commits off.
#[tokio::test(flavor = "multi_thread")]
async fn the_queue_leaves_the_database_durable() {
    if !over_sqlite() {
        return;
    }
    let bench = Bench::new().await;
    let jobs = bench.jobs(quick());
    let (_stop, _ended) = start(&jobs).await;
    let wanted = bench.wanted();
    jobs.submit(&wanted).await.unwrap();
    jobs.wait(wanted.id, PATIENCE).await.unwrap();
    for _ in 0..8 {
        let synchronous: i64 = query("PRAGMA synchronous").fetch_value(bench.store.database()).await.unwrap();
        assert_eq!(synchronous, 2);
    }
    // our migrations and the queue's, in one table, and both again
    Store::open(bench.folder.path()).await.unwrap();
}
