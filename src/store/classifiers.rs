//! Trained classifiers as texts, and which of them decides.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, count_of, now};
use crate::database::{Transaction, query};

/// How far a classifier is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClassifierStatus {
    /// It waits to be trained.
    Queued,
    /// It is being trained.
    Training,
    /// It can be used.
    Ready,
    /// It could not be trained.
    Failed,
}

impl ClassifierStatus {
    const ALL: [Self; 4] = [Self::Queued, Self::Training, Self::Ready, Self::Failed];

    /// Its word in answers and in the database.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Training => "training",
            Self::Ready => "ready",
            Self::Failed => "failed",
        }
    }
}

/// The three texts of a classifier.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClassifierTexts {
    /// LIBSVM's model file.
    pub model: String,
    /// svm-scale's file of ranges.
    pub scaling: String,
    /// JSON: kind, features, calibration, domain, provenance.
    pub description: String,
}

/// A classifier.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredClassifier {
    /// UUIDv7.
    pub id: Uuid,
    /// Its unique name.
    pub name: String,
    /// How far it is.
    pub status: ClassifierStatus,
    /// 0 to 1, while it is trained.
    pub progress: f64,
    /// What was asked for: JSON.
    pub plan: String,
    /// SHA-256 of its texts, once they are there.
    pub sha256: Option<Vec<u8>>,
    /// Its texts, once they are there.
    pub texts: Option<ClassifierTexts>,
    /// Why it could not be trained.
    pub error: Option<String>,
    /// When it was asked for.
    pub created_at: DateTime<Utc>,
    /// When its training ended.
    pub finished_at: Option<DateTime<Utc>>,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    status: String,
    progress: f64,
    plan: String,
    sha256: Option<Vec<u8>>,
    model: Option<String>,
    scaling: Option<String>,
    description: Option<String>,
    error: Option<String>,
    created_at: DateTime<Utc>,
    finished_at: Option<DateTime<Utc>>,
}

impl TryFrom<Row> for StoredClassifier {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let status = ClassifierStatus::ALL.into_iter().find(|status| status.name() == row.status);
        let texts = row.model.zip(row.scaling).zip(row.description);
        Ok(Self {
            id: row.id,
            name: row.name,
            status: status.ok_or(StoreError::Unknown { what: "status of a classifier", value: row.status })?,
            progress: row.progress,
            plan: row.plan,
            sha256: row.sha256,
            texts: texts.map(|((model, scaling), description)| ClassifierTexts { model, scaling, description }),
            error: row.error,
            created_at: row.created_at,
            finished_at: row.finished_at,
        })
    }
}

/// Which classifier was made to decide, and when.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Activation {
    /// Rises with every change.
    pub number: i64,
    /// The classifier; none is the one that the program brings along.
    pub classifier_id: Option<Uuid>,
    /// When.
    pub activated_at: DateTime<Utc>,
}

impl Store {
    /// Adds a classifier that waits to be trained; `false` if the name is taken. It takes the place of a failed one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn queue_classifier(&self, id: Uuid, name: &str, plan: &str) -> Result<bool, StoreError> {
        let mut transaction = self.begin_write().await?;
        forget_failed(&mut transaction, name).await?;
        let done = query(
            "INSERT INTO classifiers (id, name, status, plan, created_at) VALUES ($1, $2, 'queued', $3, $4)
             ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(name)
        .bind(plan)
        .bind(now())
        .execute(&mut transaction)
        .await?;
        transaction.commit().await?;
        Ok(done == 1)
    }

    /// Adds a classifier that was trained elsewhere; `false` if the name is taken. It takes the place of a failed one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_classifier(
        &self,
        id: Uuid,
        name: &str,
        plan: &str,
        texts: &ClassifierTexts,
        sha256: [u8; 32],
    ) -> Result<bool, StoreError> {
        let mut transaction = self.begin_write().await?;
        forget_failed(&mut transaction, name).await?;
        let done = query(
            "INSERT INTO classifiers
             (id, name, status, progress, plan, sha256, model, scaling, description, created_at, finished_at)
             VALUES ($1, $2, 'ready', 1, $3, $4, $5, $6, $7, $8, $9) ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(name)
        .bind(plan)
        .bind(sha256.to_vec())
        .bind(&texts.model)
        .bind(&texts.scaling)
        .bind(&texts.description)
        .bind(now())
        .bind(now())
        .execute(&mut transaction)
        .await?;
        transaction.commit().await?;
        Ok(done == 1)
    }

    /// The classifiers, the newest first; `texts` of them are left out.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn classifiers(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<StoredClassifier>, StoreError> {
        let rows: Vec<Row> = query(
            "SELECT id, name, status, progress, plan, sha256, CAST(NULL AS TEXT) AS model, CAST(NULL AS TEXT) AS scaling,
             CAST(NULL AS TEXT) AS description, error,
             created_at, finished_at FROM classifiers WHERE id < $1 ORDER BY id DESC LIMIT $2",
        )
        .bind(before.unwrap_or(Uuid::max()))
        .bind(limit)
        .fetch_all(&self.database)
        .await?;
        rows.into_iter().map(StoredClassifier::try_from).collect()
    }

    /// The classifier with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn classifier(&self, id: Uuid) -> Result<Option<StoredClassifier>, StoreError> {
        let row: Option<Row> =
            query("SELECT * FROM classifiers WHERE id = $1").bind(id).fetch_optional(&self.database).await?;
        row.map(StoredClassifier::try_from).transpose()
    }

    /// Begins to train the oldest classifier that waits and that this service `can` train, by its id and plan; what was
    /// being trained when the service ended waits too.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn begin_training(
        &self,
        can: impl Fn(Uuid, &str) -> bool,
    ) -> Result<Option<StoredClassifier>, StoreError> {
        let waiting = "SELECT id, plan FROM classifiers WHERE status IN ('queued', 'training') ORDER BY id";
        let waiting: Vec<(Uuid, String)> = query(waiting).fetch_all(&self.database).await?;
        let Some((id, _)) = waiting.into_iter().find(|(id, plan)| can(*id, plan)) else { return Ok(None) };
        let begin = query("UPDATE classifiers SET status = 'training', progress = 0 WHERE id = $1 RETURNING *");
        let row: Option<Row> = begin.bind(id).fetch_optional(&self.database).await?;
        row.map(StoredClassifier::try_from).transpose()
    }

    /// How many classifiers wait or are being trained.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn trainings(&self) -> Result<u32, StoreError> {
        let count = query("SELECT count(*) FROM classifiers WHERE status IN ('queued', 'training')");
        count_of(count.fetch_value(&self.database).await?)
    }

    /// Notes how far a training is.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_training(&self, id: Uuid, progress: f64) -> Result<(), StoreError> {
        let sql = "UPDATE classifiers SET progress = $1 WHERE id = $2 AND status = 'training'";
        query(sql).bind(progress).bind(id).execute(&self.database).await?;
        Ok(())
    }

    /// Writes what a training has come to.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn end_training(
        &self,
        id: Uuid,
        ended: Result<(&ClassifierTexts, [u8; 32]), &str>,
    ) -> Result<(), StoreError> {
        let (status, texts, sha256, error) = match ended {
            Ok((texts, sha256)) => ("ready", Some(texts), Some(sha256.to_vec()), None),
            Err(error) => ("failed", None, None, Some(error)),
        };
        query(
            "UPDATE classifiers SET status = $1, progress = 1, sha256 = $2, model = $3, scaling = $4, description = $5,
             error = $6, finished_at = $7 WHERE id = $8",
        )
        .bind(status)
        .bind(sha256)
        .bind(texts.map(|texts| texts.model.as_str()))
        .bind(texts.map(|texts| texts.scaling.as_str()))
        .bind(texts.map(|texts| texts.description.as_str()))
        .bind(error)
        .bind(now())
        .bind(id)
        .execute(&self.database)
        .await?;
        Ok(())
    }

    /// Makes a classifier decide from now on (`None`: the one that the program brings along). Nothing changes if it does
    /// already, so that taking this back leads to another one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn activate_classifier(&self, id: Option<Uuid>) -> Result<(), StoreError> {
        let mut transaction = self.begin_write().await?;
        let last: Option<Option<Uuid>> =
            query("SELECT classifier_id FROM classifier_activations ORDER BY number DESC LIMIT 1")
                .fetch_optional_value(&mut transaction)
                .await?;
        if last.flatten() != id {
            query("INSERT INTO classifier_activations (classifier_id, activated_at) VALUES ($1, $2)")
                .bind(id)
                .bind(now())
                .execute(&mut transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    /// Takes the last activation back; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn roll_classifier_back(&self) -> Result<bool, StoreError> {
        let sql = "DELETE FROM classifier_activations WHERE number = (SELECT max(number) FROM classifier_activations)";
        Ok(query(sql).execute(&self.database).await? == 1)
    }

    /// The last activations, the newest first; none if the classifier that the program brings along decides from the
    /// beginning.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn activations(&self, limit: u32) -> Result<Vec<Activation>, StoreError> {
        let sql = "SELECT * FROM classifier_activations ORDER BY number DESC LIMIT $1";
        Ok(query(sql).bind(limit).fetch_all(&self.database).await?)
    }
}

async fn forget_failed(transaction: &mut Transaction, name: &str) -> Result<(), StoreError> {
    let sql = "DELETE FROM classifiers WHERE name = $1 AND status = 'failed'";
    query(sql).bind(name).execute(transaction).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        (folder, store)
    }

    async fn queued(store: &Store, name: &str) -> Uuid {
        let id = Uuid::now_v7();
        assert!(store.queue_classifier(id, name, "the plan").await.unwrap());
        id
    }

    fn texts() -> ClassifierTexts {
        ClassifierTexts { model: "model".into(), scaling: "scaling".into(), description: "description".into() }
    }

    #[tokio::test]
    async fn trainings_are_begun_in_turn_and_again_until_they_have_ended() {
        let (_folder, store) = store().await;
        let (first, second) = (queued(&store, "first").await, queued(&store, "second").await);
        let waiting = store.classifier(first).await.unwrap().unwrap();
        assert_eq!((waiting.status, waiting.plan.as_str()), (ClassifierStatus::Queued, "the plan"));
        assert_eq!((waiting.texts, waiting.sha256, waiting.finished_at), (None, None, None));
        // who was interrupted begins anew
        for _ in 0..2 {
            let begun = store.begin_training(|_, _| true).await.unwrap().unwrap();
            assert_eq!((begun.id, begun.status, begun.progress), (first, ClassifierStatus::Training, 0.0));
            store.note_training(first, 0.25).await.unwrap();
            assert_eq!(store.classifier(first).await.unwrap().unwrap().progress, 0.25);
        }
        assert_eq!(store.trainings().await.unwrap(), 2);
        store.end_training(first, Ok((&texts(), [7; 32]))).await.unwrap();
        let ready = store.classifier(first).await.unwrap().unwrap();
        assert_eq!((ready.status, ready.progress, ready.texts), (ClassifierStatus::Ready, 1.0, Some(texts())));
        assert_eq!((ready.sha256, ready.error), (Some(vec![7; 32]), None));
        assert!(ready.finished_at.is_some());
        // what has ended is not moved by one who has not heard of it
        store.note_training(first, 0.5).await.unwrap();
        assert_eq!(store.classifier(first).await.unwrap().unwrap().progress, 1.0);
        assert_eq!(store.begin_training(|_, _| true).await.unwrap().unwrap().id, second);
        store.end_training(second, Err("nothing to learn")).await.unwrap();
        let failed = store.classifier(second).await.unwrap().unwrap();
        assert_eq!((failed.status, failed.error.as_deref()), (ClassifierStatus::Failed, Some("nothing to learn")));
        assert_eq!((failed.texts, failed.sha256), (None, None));
        assert_eq!((store.begin_training(|_, _| true).await.unwrap(), store.trainings().await.unwrap()), (None, 0));
    }

    #[tokio::test]
    async fn a_name_is_given_once() {
        let (_folder, store) = store().await;
        let first = queued(&store, "name").await;
        assert!(!store.queue_classifier(Uuid::now_v7(), "name", "another plan").await.unwrap());
        assert!(!store.add_classifier(Uuid::now_v7(), "name", "another plan", &texts(), [1; 32]).await.unwrap());
        let all = store.classifiers(None, 10).await.unwrap();
        assert_eq!(all.iter().map(|c| (c.id, c.plan.as_str())).collect::<Vec<_>>(), [(first, "the plan")]);
        // one that has failed makes room
        store.end_training(first, Err("nothing to learn")).await.unwrap();
        let second = queued(&store, "name").await;
        assert_eq!(store.classifiers(None, 10).await.unwrap().iter().map(|c| c.id).collect::<Vec<_>>(), [second]);
    }

    #[tokio::test]
    async fn lists_are_the_newest_first_and_leave_the_texts_out() {
        let (_folder, store) = store().await;
        let (added, queued_later) = (Uuid::now_v7(), Uuid::now_v7());
        assert!(store.add_classifier(added, "added", "{}", &texts(), [1; 32]).await.unwrap());
        assert!(store.queue_classifier(queued_later, "queued", "{}").await.unwrap());
        let all = store.classifiers(None, 10).await.unwrap();
        assert_eq!(all.iter().map(|c| c.id).collect::<Vec<_>>(), [queued_later, added]);
        assert_eq!(
            (all[1].status, &all[1].sha256, &all[1].texts),
            (ClassifierStatus::Ready, &Some(vec![1; 32]), &None)
        );
        assert_eq!(store.classifier(added).await.unwrap().unwrap().texts, Some(texts()));
        assert_eq!(store.classifiers(None, 1).await.unwrap(), all[..1]);
        assert_eq!(store.classifiers(Some(queued_later), 10).await.unwrap(), all[1..]);
        assert_eq!(store.classifier(Uuid::now_v7()).await.unwrap(), None);
    }

    #[tokio::test]
    async fn activations_are_taken_back_one_by_one() {
        let (_folder, store) = store().await;
        assert_eq!(store.activations(5).await.unwrap(), []);
        assert!(!store.roll_classifier_back().await.unwrap());
        let id = Uuid::now_v7();
        store.add_classifier(id, "name", "{}", &texts(), [1; 32]).await.unwrap();
        // what decides already is not activated again
        for activated in [None, Some(id), Some(id), None, None, Some(id)] {
            store.activate_classifier(activated).await.unwrap();
        }
        let decided = async || store.activations(5).await.unwrap().iter().map(|a| a.classifier_id).collect::<Vec<_>>();
        assert_eq!(decided().await, [Some(id), None, Some(id)]);
        assert_eq!(store.activations(1).await.unwrap().len(), 1);
        assert!(store.roll_classifier_back().await.unwrap());
        assert_eq!(decided().await, [None, Some(id)]);
        assert!(store.roll_classifier_back().await.unwrap() && store.roll_classifier_back().await.unwrap());
        assert!(!store.roll_classifier_back().await.unwrap());
        assert!(store.activate_classifier(Some(Uuid::now_v7())).await.is_err(), "there is no such classifier");
        assert_eq!(decided().await, []);
    }
}
