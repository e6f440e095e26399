//! Trained classifiers as texts, and which of them decides.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};

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
    /// Adds a classifier that waits to be trained; `false` if the name is taken.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn queue_classifier(&self, id: Uuid, name: &str, plan: &str) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "INSERT INTO classifiers (id, name, status, plan, created_at) VALUES (?, ?, 'queued', ?, ?)
             ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(name)
        .bind(plan)
        .bind(now())
        .execute(&self.pool)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    /// Adds a classifier that was trained elsewhere; `false` if the name is taken.
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
        let done = sqlx::query(
            "INSERT INTO classifiers
             (id, name, status, progress, plan, sha256, model, scaling, description, created_at, finished_at)
             VALUES (?, ?, 'ready', 1, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
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
        .execute(&self.pool)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    /// The classifiers, the newest first; `texts` of them are left out.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn classifiers(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<StoredClassifier>, StoreError> {
        let rows: Vec<Row> = sqlx::query_as(
            "SELECT id, name, status, progress, plan, sha256, NULL AS model, NULL AS scaling, NULL AS description, error,
             created_at, finished_at FROM classifiers WHERE id < ? ORDER BY id DESC LIMIT ?",
        )
        .bind(before.unwrap_or(Uuid::max()))
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(StoredClassifier::try_from).collect()
    }

    /// The classifier with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn classifier(&self, id: Uuid) -> Result<Option<StoredClassifier>, StoreError> {
        let row: Option<Row> =
            sqlx::query_as("SELECT * FROM classifiers WHERE id = ?").bind(id).fetch_optional(&self.pool).await?;
        row.map(StoredClassifier::try_from).transpose()
    }

    /// Begins to train the oldest classifier that waits; what was being trained when the service ended waits too.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn begin_training(&self) -> Result<Option<StoredClassifier>, StoreError> {
        let row: Option<Row> = sqlx::query_as(
            "UPDATE classifiers SET status = 'training', progress = 0
             WHERE id = (SELECT id FROM classifiers WHERE status IN ('queued', 'training') ORDER BY id LIMIT 1)
             RETURNING *",
        )
        .fetch_optional(&self.pool)
        .await?;
        row.map(StoredClassifier::try_from).transpose()
    }

    /// How many classifiers wait or are being trained.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn trainings(&self) -> Result<u32, StoreError> {
        let count = sqlx::query_scalar("SELECT count(*) FROM classifiers WHERE status IN ('queued', 'training')");
        Ok(count.fetch_one(&self.pool).await?)
    }

    /// Notes how far a training is.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_training(&self, id: Uuid, progress: f64) -> Result<(), StoreError> {
        let query = "UPDATE classifiers SET progress = ? WHERE id = ? AND status = 'training'";
        sqlx::query(query).bind(progress).bind(id).execute(&self.pool).await?;
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
        sqlx::query(
            "UPDATE classifiers SET status = ?, progress = 1, sha256 = ?, model = ?, scaling = ?, description = ?,
             error = ?, finished_at = ? WHERE id = ?",
        )
        .bind(status)
        .bind(sha256)
        .bind(texts.map(|texts| &texts.model))
        .bind(texts.map(|texts| &texts.scaling))
        .bind(texts.map(|texts| &texts.description))
        .bind(error)
        .bind(now())
        .bind(id)
        .execute(&self.pool)
        .await?;
        Ok(())
    }

    /// Makes a classifier decide from now on (`None`: the one that the program brings along).
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn activate_classifier(&self, id: Option<Uuid>) -> Result<(), StoreError> {
        sqlx::query("INSERT INTO classifier_activations (classifier_id, activated_at) VALUES (?, ?)")
            .bind(id)
            .bind(now())
            .execute(&self.pool)
            .await?;
        Ok(())
    }

    /// Takes the last activation back; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn roll_classifier_back(&self) -> Result<bool, StoreError> {
        let query =
            "DELETE FROM classifier_activations WHERE number = (SELECT max(number) FROM classifier_activations)";
        Ok(sqlx::query(query).execute(&self.pool).await?.rows_affected() == 1)
    }

    /// The last activations, the newest first; none if the classifier that the program brings along decides from the
    /// beginning.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn activations(&self, limit: u32) -> Result<Vec<Activation>, StoreError> {
        let query = "SELECT * FROM classifier_activations ORDER BY number DESC LIMIT ?";
        Ok(sqlx::query_as(query).bind(limit).fetch_all(&self.pool).await?)
    }
}
