//! What lists show of a diagnosis.

use serde::{Deserialize, Serialize};
use uuid::Uuid;

use crate::database::{Transaction, query};
use crate::store::StoreError;

/// What lists show of a diagnosis.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DiagnosisInShort {
    /// The larger the better; none of an image that could not be oriented.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Probability that the largest error on the ground is within the tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability_correct: Option<f64>,
    /// The one that decided first.
    pub reasons: Vec<ReasonInShort>,
}

/// Why a verdict is what it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReasonInShort {
    /// A stable word for programs.
    pub code: String,
    /// A sentence for staff.
    pub detail: String,
}

impl DiagnosisInShort {
    pub(super) fn to_text(&self) -> Result<String, StoreError> {
        let text = serde_json::to_string(self);
        text.map_err(|error| StoreError::Unknown { what: "diagnosis", value: error.to_string() })
    }

    pub(super) fn stored(text: String) -> Result<Self, StoreError> {
        serde_json::from_str(&text).map_err(|_| StoreError::Unknown { what: "diagnosis", value: text })
    }
}

/// Notes the reasons of an orientation that has succeeded, so that it is found by them.
pub(super) async fn note_reasons(
    transaction: &mut Transaction,
    orientation_id: Uuid,
    diagnosis: &DiagnosisInShort,
) -> Result<(), StoreError> {
    for reason in &diagnosis.reasons {
        query("INSERT INTO orientation_reasons (code, orientation_id) VALUES ($1, $2) ON CONFLICT DO NOTHING")
            .bind(&reason.code)
            .bind(orientation_id)
            .execute(&mut *transaction)
            .await?;
    }
    Ok(())
}
