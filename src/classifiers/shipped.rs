//! The classifier that the program brings along, trained on the simulator (see the README for the commands).

use std::sync::OnceLock;

use super::texts::{ClassifierError, Loaded, Texts};

/// Its texts.
#[must_use]
pub fn texts() -> Texts {
    Texts {
        model: include_str!("shipped/model.svm").to_owned(),
        scaling: include_str!("shipped/scaling.range").to_owned(),
        description: include_str!("shipped/classifier.json").to_owned(),
    }
}

/// The classifier, read once.
///
/// # Errors
/// [`ClassifierError`] if the program was built with damaged files; a test reads them.
pub fn shipped() -> Result<Loaded, &'static ClassifierError> {
    static SHIPPED: OnceLock<Result<Loaded, ClassifierError>> = OnceLock::new();
    match SHIPPED.get_or_init(|| texts().load()) {
        Ok(loaded) => Ok(loaded.clone()),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_can_be_read_and_comes_from_the_simulator() {
        let loaded = shipped().unwrap();
        assert_eq!(loaded.sha256, texts().sha256());
        assert!(loaded.classifier.is_consistent());
        assert!(
            loaded.description.provenance.areas.keys().all(|area| ["good", "poor", "wide"].contains(&area.as_str()))
        );
    }
}
