//! Between an attempt and those outside: a signal in, the progress out.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::watch;
use uuid::Uuid;

use super::feed::{Change, Teller, Told};
use crate::pipeline::{Observer, Stage};
use crate::store::orientations::Status;

/// Ends an attempt early, from outside.
#[derive(Debug)]
pub(super) struct Signal {
    interrupted: AtomicBool,
    deadline: Instant,
}

impl Signal {
    pub(super) fn new(timeout: Duration) -> Arc<Self> {
        Arc::new(Self { interrupted: AtomicBool::new(false), deadline: Instant::now() + timeout })
    }

    pub(super) fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Whether it is so long after the deadline.
    pub(super) fn is_later_than(&self, overtime: Duration) -> bool {
        Instant::now() >= self.deadline + overtime
    }

    pub(super) fn is_late(&self) -> bool {
        Instant::now() >= self.deadline
    }
}

/// Listens to the pipeline: passes on where it is, measures its stages, and tells it to end.
pub(super) struct Watcher {
    id: Uuid,
    signal: Arc<Signal>,
    teller: Teller,
    notes: watch::Sender<(&'static str, f64)>,
    stage: Mutex<Option<(Stage, Instant)>>,
}

impl Observer for Watcher {
    fn progress(&self, stage: Stage, fraction: f64) {
        self.measure(Some(stage));
        let at = Some(stage.name().into());
        let change = Change { stage: at, progress: fraction, ..Change::to(self.id, Status::Running) };
        self.teller.tell(Told::Change(change));
        self.notes.send_replace((stage.name(), fraction));
    }

    fn cancelled(&self) -> bool {
        self.signal.is_interrupted() || self.signal.is_late()
    }
}

impl Watcher {
    /// A watcher, and where its last note is to be read.
    pub(super) fn new(id: Uuid, signal: Arc<Signal>, teller: Teller) -> (Self, watch::Receiver<(&'static str, f64)>) {
        let (notes, noted) = watch::channel(("", 0.0));
        (Self { id, signal, teller, notes, stage: Mutex::default() }, noted)
    }

    /// Records how long the last stage has taken.
    pub(super) fn end(&self) {
        self.measure(None);
    }

    /// Records how long the last stage has taken when another one begins.
    fn measure(&self, stage: Option<Stage>) {
        let mut current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if current.map(|(stage, _)| stage) == stage {
            return;
        }
        if let Some((ended, began)) = current.take() {
            let seconds = began.elapsed().as_secs_f64();
            self.teller.tell(Told::Stage { stage: ended.name().into(), seconds });
        }
        *current = stage.map(|stage| (stage, Instant::now()));
    }
}
