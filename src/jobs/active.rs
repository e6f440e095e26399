//! The classifier that decides at present.

use std::sync::{Arc, Mutex, PoisonError};

use uuid::Uuid;

use crate::classifiers::{ClassifierError, Loaded, Texts, shipped};
use crate::store::classifiers::StoredClassifier;
use crate::store::{Store, StoreError};

/// The name of the classifier that the program brings along.
pub const SHIPPED: &str = "shipped";

/// A classifier with its name.
#[derive(Debug, Clone)]
pub struct NamedClassifier {
    /// Its name.
    pub name: String,
    /// Itself.
    pub loaded: Loaded,
}

/// Why there is no classifier to decide.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ActiveError {
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The texts of a classifier cannot be read by this version.
    #[error("the classifier {name:?} cannot be read by this version: {detail}; activate another one")]
    Unreadable {
        /// Its name.
        name: String,
        /// What is wrong with it.
        detail: String,
    },
}

/// The active classifier, read once after each change.
#[derive(Debug, Clone, Default)]
pub struct ActiveClassifier(Arc<Mutex<Option<Known>>>);

/// A classifier with its id; the one that the program brings along has none.
type Known = (Option<Uuid>, NamedClassifier);

impl ActiveClassifier {
    /// The one that was activated last, or the one that the program brings along.
    ///
    /// # Errors
    /// [`ActiveError`].
    pub async fn get(&self, store: &Store) -> Result<NamedClassifier, ActiveError> {
        let id = store.activations(1).await?.first().and_then(|activation| activation.classifier_id);
        if let Some((known, named)) = &*self.0.lock().unwrap_or_else(PoisonError::into_inner)
            && *known == id
        {
            return Ok(named.clone());
        }
        let named = match id {
            None => shipped_classifier()?,
            Some(id) => {
                let gone = || ActiveError::Unreadable { name: id.to_string(), detail: "it is gone".to_owned() };
                stored_classifier(&store.classifier(id).await?.ok_or_else(gone)?)?
            }
        };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((id, named.clone()));
        Ok(named)
    }
}

/// The classifier that the program brings along.
///
/// # Errors
/// [`ActiveError::Unreadable`] if the program was built with damaged files.
pub fn shipped_classifier() -> Result<NamedClassifier, ActiveError> {
    let unreadable =
        |error: &ClassifierError| ActiveError::Unreadable { name: SHIPPED.to_owned(), detail: error.to_string() };
    Ok(NamedClassifier { name: SHIPPED.to_owned(), loaded: shipped().map_err(unreadable)? })
}

/// A stored classifier that is ready.
///
/// # Errors
/// [`ActiveError::Unreadable`] if it is not, or was written by another version.
pub fn stored_classifier(stored: &StoredClassifier) -> Result<NamedClassifier, ActiveError> {
    let unreadable = |detail: String| ActiveError::Unreadable { name: stored.name.clone(), detail };
    let texts = stored.texts.clone().ok_or_else(|| unreadable("it is not trained".to_owned()))?;
    let texts = Texts { model: texts.model, scaling: texts.scaling, description: texts.description };
    let loaded = texts.load().map_err(|error| unreadable(error.to_string()))?;
    Ok(NamedClassifier { name: stored.name.clone(), loaded })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classifiers::train::tests::quickly_trained;
    use crate::learning::Kind;
    use crate::store::classifiers::ClassifierTexts;

    async fn add(store: &Store, name: &str, texts: Texts) -> Uuid {
        let (id, sha256) = (Uuid::now_v7(), texts.sha256());
        let Texts { model, scaling, description } = texts;
        let texts = ClassifierTexts { model, scaling, description };
        assert!(store.add_classifier(id, name, "{}", &texts, sha256).await.unwrap());
        id
    }

    #[tokio::test]
    async fn the_one_that_was_activated_last_decides_until_it_is_rolled_back() {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        let active = ActiveClassifier::default();
        let decides = async || {
            let named = active.get(&store).await.unwrap();
            (named.name, named.loaded.sha256)
        };
        let of_program = (SHIPPED.to_owned(), shipped().unwrap().sha256);
        assert_eq!(decides().await, of_program);
        let [first, second] = [Kind::OneFeature, Kind::EvidenceLogistic].map(quickly_trained);
        let hashes = [first.sha256(), second.sha256()];
        let ids = [add(&store, "first", first).await, add(&store, "second", second).await];
        assert_eq!(decides().await, of_program, "none was activated");
        for id in [Some(ids[0]), Some(ids[1]), None] {
            store.activate_classifier(id).await.unwrap();
        }
        assert_eq!(decides().await, of_program);
        for expected in [("second".to_owned(), hashes[1]), ("first".to_owned(), hashes[0]), of_program] {
            assert!(store.roll_classifier_back().await.unwrap());
            assert_eq!(decides().await, expected);
            // once more, from memory
            assert_eq!(decides().await, expected);
        }
    }

    #[tokio::test]
    async fn a_classifier_that_cannot_be_read_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        let (waiting, active) = (Uuid::now_v7(), ActiveClassifier::default());
        assert!(store.queue_classifier(waiting, "waiting", "{}").await.unwrap());
        let texts = quickly_trained(Kind::OneFeature);
        let damaged = add(&store, "damaged", Texts { model: "svm_type nu_svr".to_owned(), ..texts }).await;
        for (id, name, said) in [(waiting, "waiting", "not trained"), (damaged, "damaged", "model.svm")] {
            store.activate_classifier(Some(id)).await.unwrap();
            let error = active.get(&store).await.unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(said), "{error}");
        }
        store.activate_classifier(None).await.unwrap();
        assert_eq!(active.get(&store).await.unwrap().name, SHIPPED);
    }
}
