//! Training of classifiers in the service: one at a time, out of its own history or an uploaded labelled set.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::Inner;
use super::active::SHIPPED;
use super::request::{CostsRequest, Prepared, ToleranceGiven};
use crate::classifiers::{
    ClassifierError, LabelledImage, LabelledSet, Record, Reference, Training, TrainingSet, trained,
};
use crate::geometry::{Camera, CrsError, ExteriorOrientation, LocalFrame};
use crate::learning::svm::SvmError;
use crate::learning::{Costs, Kind};
use crate::store::cameras::NamedCamera;
use crate::store::classifiers::{ClassifierTexts, StoredClassifier};
use crate::store::references::{ReferenceOrientation, ReferencedRecord, RejectedRecord, given_now};
use crate::store::{Store, StoreError, TRAINING, now};

/// What is to be trained: kept with the classifier.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingPlan {
    /// The kinds that are compared, by their names.
    pub kinds: Vec<String>,
    /// What decisions cost.
    pub costs: CostsRequest,
    /// Where the labelled images come from.
    pub source: Source,
    /// Whether it decides as soon as it is ready.
    pub activate: bool,
}

const NAME_MAX_CHARACTERS: usize = 200;

/// What is wrong with the name of a new classifier, if anything is.
#[must_use]
pub fn name_fault(name: &str) -> Option<String> {
    if name.trim().is_empty() || name.chars().count() > NAME_MAX_CHARACTERS || name.chars().any(char::is_control) {
        return Some(format!("a name has 1 to {NAME_MAX_CHARACTERS} characters, none of them a control character"));
    }
    (name == SHIPPED).then(|| format!("{SHIPPED} is the name of the classifier that Gable brings along"))
}

/// Where labelled images come from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The orientations of this service whose images have references.
    History,
    /// A labelled set that was uploaded with the request.
    Upload,
}

/// Rows of the history that are read at a time.
const PAGE: u32 = 200;
/// Between two looks at how far a training is.
const NOTE_INTERVAL: Duration = Duration::from_millis(500);
/// The lock that the one holds who trains.
const TRAINING_LOCK: i64 = 0x6761_626c_6503;
/// After so long without the service that has received it, an uploaded set is taken for lost, and its training fails.
const UPLOAD_LOST_AFTER: Duration = Duration::from_secs(3600);
/// How often it is looked for what other services have left.
const LOOK_INTERVAL: Duration = Duration::from_secs(30);
/// After an error of the store, before the next try.
const PAUSE: Duration = Duration::from_secs(5);
/// The area of what staff have decided.
const REVIEWED_AREA: &str = "reviewed";
/// Where the tolerance of the request is in ground sample distances and the ground cannot be seen, it is nothing.
const NO_TOLERANCE_M: f64 = 0.0;

/// Why a training has no classifier.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There is nothing to learn.
    #[error(transparent)]
    Classifier(#[from] ClassifierError),
    /// The labelled set is not one.
    #[error("the labelled set cannot be read: {detail}")]
    Set {
        /// The line, and what is wrong with it.
        detail: String,
    },
    /// A row is not what was written.
    #[error("a stored row cannot be read: {0}")]
    Json(#[from] serde_json::Error),
    /// A row is in a CRS that is not known any more.
    #[error("a coordinate system of a stored row is not known: {0}")]
    Crs(#[from] CrsError),
    /// The training panicked.
    #[error("the training has panicked: {detail}")]
    Panic {
        /// Its last words.
        detail: String,
    },
    /// The service ends.
    #[error("interrupted")]
    Interrupted,
}

/// Where an uploaded labelled set is kept until its classifier is trained.
#[must_use]
pub fn upload_path(store: &Store, id: Uuid) -> PathBuf {
    store.folder().join(TRAINING).join(format!("{id}.jsonl"))
}

/// Whether what has this UUIDv7 is so old.
fn asked_for_before(id: Uuid, age: Duration) -> bool {
    let now_ms = u64::try_from(now().timestamp_millis()).unwrap_or_default();
    let made_ms = id.get_timestamp().map_or(0, |made| made.to_unix().0 * 1000);
    Duration::from_millis(now_ms.saturating_sub(made_ms)) > age
}

impl Inner {
    /// Trains what waits, one after the other, until the service ends. What is interrupted begins anew with the next start.
    pub(super) async fn train(self: Arc<Self>) {
        while !self.stopping.is_cancelled() {
            let trained = match self.train_next().await {
                Ok(true) => Ok(()),
                Ok(false) => {
                    tokio::select! {
                        () = self.stopping.cancelled() => {}
                        () = self.to_train.notified() => {}
                        // another service of the same database may have ended in the middle of one
                        () = tokio::time::sleep(LOOK_INTERVAL), if self.store.database().is_shared() => {}
                    }
                    Ok(())
                }
                Err(error) => Err(error),
            };
            if let Err(error) = trained {
                tracing::error!(%error, "no classifier can be trained at present");
                let _ = tokio::time::timeout(PAUSE, self.stopping.cancelled()).await;
            }
        }
    }

    /// Trains the next one that waits; `false` if none does, or another service is at it.
    async fn train_next(&self) -> Result<bool, StoreError> {
        let Some(_turn) = self.store.database().try_lock(TRAINING_LOCK).await? else { return Ok(false) };
        // an uploaded set lies in the data folder of the service that has received it
        let can = |id: Uuid, plan: &str| {
            let plan = serde_json::from_str::<TrainingPlan>(plan);
            !self.store.database().is_shared()
                || plan.is_ok_and(|plan| plan.source == Source::History)
                || upload_path(&self.store, id).exists()
                || asked_for_before(id, UPLOAD_LOST_AFTER)
        };
        match self.store.begin_training(can).await? {
            Some(stored) => self.train_one(&stored).await.map(|()| true),
            None => Ok(false),
        }
    }

    /// An error leaves the classifier waiting.
    async fn train_one(&self, stored: &StoredClassifier) -> Result<(), StoreError> {
        tracing::info!(id = %stored.id, name = stored.name, "training a classifier");
        match self.trained(stored).await {
            Err(TrainingError::Interrupted) => return Ok(()),
            Err(TrainingError::Store(error)) => return Err(error),
            Err(error) => {
                tracing::warn!(id = %stored.id, %error, "a classifier could not be trained");
                self.store.end_training(stored.id, Err(&error.to_string())).await?;
            }
            Ok((texts, sha256)) => self.finished(stored, &texts, sha256).await?,
        }
        // the set is of no more use; it may not be there at all
        let _ = tokio::fs::remove_file(upload_path(&self.store, stored.id)).await;
        Ok(())
    }

    async fn finished(
        &self,
        stored: &StoredClassifier,
        texts: &ClassifierTexts,
        sha256: [u8; 32],
    ) -> Result<(), StoreError> {
        self.store.end_training(stored.id, Ok((texts, sha256))).await?;
        tracing::info!(id = %stored.id, name = stored.name, "a classifier is ready");
        let plan: Option<TrainingPlan> = serde_json::from_str(&stored.plan).ok();
        if plan.is_some_and(|plan| plan.activate) {
            self.store.activate_classifier(Some(stored.id)).await?;
            tracing::info!(id = %stored.id, name = stored.name, "it decides from now on");
        }
        Ok(())
    }

    async fn trained(&self, stored: &StoredClassifier) -> Result<(ClassifierTexts, [u8; 32]), TrainingError> {
        let plan: TrainingPlan = serde_json::from_str(&stored.plan)?;
        let set = match plan.source {
            Source::History => history(&self.store).await?,
            Source::Upload => uploaded(&self.store, stored).await?,
        };
        let kinds: Vec<Kind> = plan.kinds.iter().filter_map(|name| Kind::from_name(name)).collect();
        let costs = Costs::from(plan.costs);
        let (stopping, done) = (self.stopping.clone(), Arc::new(AtomicU64::new(0)));
        let reached = done.clone();
        let mut blocking = tokio::task::spawn_blocking(move || {
            let progress = |share: f64| {
                reached.store((share * 1e6) as u64, Ordering::Relaxed);
                !stopping.is_cancelled()
            };
            let nothing = TrainingSet::default();
            let training = Training { set: &set, not_trained_on: &nothing, kinds: &kinds, costs };
            trained(&training, &progress)
        });
        let joined = loop {
            tokio::select! {
                joined = &mut blocking => break joined,
                () = tokio::time::sleep(NOTE_INTERVAL) => {
                    let share = done.load(Ordering::Relaxed) as f64 / 1e6;
                    if let Err(error) = self.store.note_training(stored.id, share).await {
                        tracing::warn!(id = %stored.id, %error, "the progress of a training could not be noted");
                    }
                }
            }
        };
        let texts = match joined.map_err(|error| TrainingError::Panic { detail: error.to_string() })? {
            Err(ClassifierError::Training { source: SvmError::Stopped, .. }) => return Err(TrainingError::Interrupted),
            texts => texts?,
        };
        let sha256 = texts.sha256();
        let crate::classifiers::Texts { model, scaling, description } = texts;
        Ok((ClassifierTexts { model, scaling, description }, sha256))
    }
}

async fn uploaded(store: &Store, stored: &StoredClassifier) -> Result<TrainingSet, TrainingError> {
    let path = upload_path(store, stored.id);
    let content = tokio::fs::read(&path).await.map_err(|error| TrainingError::Set { detail: error.to_string() })?;
    let images = parse_set(&content).map_err(|detail| TrainingError::Set { detail })?;
    Ok(of_images("upload", images, &content))
}

fn of_images(name: &str, images: Vec<LabelledImage>, content: &[u8]) -> TrainingSet {
    let sha256 = Sha256::digest(content).iter().map(|byte| format!("{byte:02x}")).collect();
    let set = LabelledSet { name: name.to_owned(), images: images.len(), sha256 };
    TrainingSet { sets: vec![set], images }
}

/// The labelled images of JSON Lines.
///
/// # Errors
/// The line that is at fault.
pub fn parse_set(content: &[u8]) -> Result<Vec<LabelledImage>, String> {
    let lines = content.split(|byte| *byte == b'\n').enumerate();
    let filled = lines.filter(|(_, line)| !line.trim_ascii().is_empty());
    let image = |(number, line): (usize, &[u8])| {
        serde_json::from_slice(line).map_err(|error| format!("line {}: {error}", number + 1))
    };
    filled.map(image).collect()
}

/// The labelled images of the service's own history.
///
/// # Errors
/// [`TrainingError`] if a row cannot be read.
pub async fn history(store: &Store) -> Result<TrainingSet, TrainingError> {
    let (mut images, mut after, mut content) = (Vec::new(), Uuid::nil(), Vec::new());
    loop {
        let page = store.referenced_records(after, PAGE).await?;
        let Some(last) = page.last() else { break };
        after = last.orientation_id;
        for row in &page {
            let camera = store.camera(&row.camera_id.to_string()).await?;
            // of film nothing is learned yet: its features are not those of digital images
            if let Some(camera) = camera.as_ref().and_then(NamedCamera::digital) {
                let image = labelled(row, camera)?;
                serde_json::to_writer(&mut content, &image)?;
                images.push(image);
            }
        }
    }
    for image in rejected(store).await? {
        serde_json::to_writer(&mut content, &image)?;
        images.push(image);
    }
    Ok(of_images("history", images, &content))
}

/// What staff have rejected without saying what would be right.
async fn rejected(store: &Store) -> Result<Vec<LabelledImage>, TrainingError> {
    let (mut images, mut after) = (Vec::new(), Uuid::nil());
    loop {
        let page = store.rejected_records(after, PAGE).await?;
        let Some(last) = page.last() else { return Ok(images) };
        after = last.orientation_id;
        for row in &page {
            let camera = store.camera(&row.camera_id.to_string()).await?;
            if let Some(camera) = camera.as_ref().and_then(NamedCamera::digital) {
                images.extend(labelled_as_wrong(row, camera)?);
            }
        }
    }
}

/// An orientation that is known to be wrong; `None` if there was none to reject.
fn labelled_as_wrong(row: &RejectedRecord, camera: &Camera) -> Result<Option<LabelledImage>, TrainingError> {
    let prepared: Prepared = serde_json::from_str(&row.prepared)?;
    let record: Record = serde_json::from_str(&row.record)?;
    let Some(estimate) = record.estimate else { return Ok(None) };
    let orientation = ExteriorOrientation::from(estimate);
    let (ground_height_m, tolerance_m) = measures(&prepared, &record, &orientation, camera);
    let itself = Reference { camera, orientation, ground_height_m, tolerance_m };
    let image = record.labelled(row.image_id.to_string(), REVIEWED_AREA.to_owned(), &itself);
    Ok(Some(image.known_to_be_wrong()))
}

/// An orientation of the history, held against the reference of its image.
fn labelled(row: &ReferencedRecord, camera: &Camera) -> Result<LabelledImage, TrainingError> {
    let prepared: Prepared = serde_json::from_str(&row.prepared)?;
    let record: Record = serde_json::from_str(&row.record)?;
    let frame = prepared.frame()?;
    let orientation = in_frame(&row.reference, &frame);
    let (ground_height_m, tolerance_m) = measures(&prepared, &record, &orientation, camera);
    let reference = Reference { camera, orientation, ground_height_m, tolerance_m };
    Ok(record.labelled(row.reference.image_id.to_string(), row.reference.area.clone(), &reference))
}

/// The height of the plane on which errors are measured, and the largest one that is acceptable.
fn measures(prepared: &Prepared, record: &Record, truth: &ExteriorOrientation, camera: &Camera) -> (f64, f64) {
    // without an orientation nothing is measured
    let ground_height_m = record.ground_height_m.unwrap_or(0.0);
    let tolerance_m = match prepared.tolerance {
        ToleranceGiven::M(metres) => metres,
        ToleranceGiven::Gsd(gsd) if record.ground_height_m.is_some() => {
            let depth_m = truth.projection_centre_m.z - ground_height_m;
            gsd * depth_m.max(0.0) / camera.principal_distance_px
        }
        ToleranceGiven::Gsd(_) => NO_TOLERANCE_M,
    };
    (ground_height_m, tolerance_m)
}

/// The reference of an image whose orientation staff have accepted; `None` if there was none.
///
/// # Errors
/// [`TrainingError`] if what is stored cannot be read.
pub fn accepted(
    image_id: Uuid,
    prepared: &str,
    record: &Record,
) -> Result<Option<ReferenceOrientation>, TrainingError> {
    let prepared: Prepared = serde_json::from_str(prepared)?;
    let Some(estimate) = record.estimate else { return Ok(None) };
    let frame = prepared.frame()?;
    let orientation = ExteriorOrientation::from(estimate);
    let centre_m = frame.to_geocentric(orientation.projection_centre_m);
    let rotation = orientation.camera_from_object * frame.local_from_geocentric();
    // row by row
    let rows = std::array::from_fn(|k| rotation.matrix()[(k / 3, k % 3)]);
    Ok(Some(given_now(image_id, REVIEWED_AREA.to_owned(), centre_m.into(), rows)))
}

/// A reference in a local frame.
#[must_use]
pub fn in_frame(reference: &ReferenceOrientation, frame: &LocalFrame) -> ExteriorOrientation {
    let rows = nalgebra::Matrix3::from_row_slice(&reference.camera_from_geocentric);
    let camera_from_geocentric = nalgebra::Rotation3::from_matrix_unchecked(rows);
    ExteriorOrientation {
        projection_centre_m: frame.from_geocentric(reference.centre_geocentric_m.into()),
        camera_from_object: camera_from_geocentric * frame.local_from_geocentric().inverse(),
    }
}

#[cfg(test)]
pub(super) mod tests;
