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
pub struct ActiveClassifier(Arc<Mutex<Option<(Option<Uuid>, NamedClassifier)>>>);

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
