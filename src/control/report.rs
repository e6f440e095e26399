//! What an import did, and why some of it was not done.

use std::borrow::Cow;

use serde::Serialize;
use utoipa::ToSchema;

use super::geojson::Rejection;

/// Rejections that are told one by one.
pub const REJECTIONS_TOLD: usize = 1_000;
/// Reasons that are counted each by itself.
const MOST_REASONS: usize = 100;

/// What an import did.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, ToSchema)]
pub struct ImportReport {
    /// Control points that are new.
    pub imported: usize,
    /// Control points whose name was known and that were given their new content.
    pub updated: usize,
    /// What did not become a control point, the first thousand; it never loses the others.
    pub rejected: Vec<Rejection>,
    /// How many were rejected in all.
    pub rejected_count: usize,
    /// How many for which reason, the most frequent first.
    pub rejected_by_reason: Vec<ReasonCount>,
    /// Of an import that was interrupted before: where it went on in the file. What was rejected before is only counted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resumed_at: Option<usize>,
}

/// How often something was rejected for a reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct ReasonCount {
    /// The reason, `…` standing for what differs: numbers and names.
    pub reason: String,
    /// How often.
    pub count: usize,
}

impl ImportReport {
    /// Notes a rejection.
    pub fn reject(&mut self, rejection: Rejection) {
        self.rejected_count += 1;
        let reason = reason(&rejection.detail);
        let known = self.rejected_by_reason.iter().position(|known| known.reason == reason);
        match known {
            Some(place) => self.rejected_by_reason[place].count += 1,
            None if self.rejected_by_reason.len() < MOST_REASONS => {
                self.rejected_by_reason.push(ReasonCount { reason: reason.into_owned(), count: 1 });
            }
            // the last one counts all that are left
            None => {
                if let Some(last) = self.rejected_by_reason.last_mut() {
                    "other reasons".clone_into(&mut last.reason);
                    last.count += 1;
                }
            }
        }
        if self.rejected.len() < REJECTIONS_TOLD {
            self.rejected.push(rejection);
        }
    }

    /// The same in the order in which it is told.
    #[must_use]
    pub fn sorted(mut self) -> Self {
        self.rejected.sort_by_key(|rejection| rejection.index);
        self.rejected_by_reason.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.reason.cmp(&b.reason)));
        self
    }
}

/// The text without what differs from one to the next: numbers, and what is quoted.
fn reason(detail: &str) -> Cow<'_, str> {
    if !detail.contains(|c: char| c.is_ascii_digit() || c == '"') {
        return Cow::Borrowed(detail);
    }
    let (mut told, mut quoted) = (String::with_capacity(detail.len()), false);
    for character in detail.chars() {
        let differs = quoted || character.is_ascii_digit();
        if character == '"' {
            quoted = !quoted;
        }
        let within_number = matches!(character, '.' | '-') && told.ends_with('…');
        if !differs && !within_number {
            told.push(character);
        } else if !told.ends_with('…') {
            told.push('…');
        }
    }
    Cow::Owned(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_counted_whatever_their_numbers() {
        let mut report = ImportReport::default();
        for (index, detail) in ["it has 2001 lines", "it has 7 lines", "x is -1.5 m", "the geometry is a \"Point\""]
            .into_iter()
            .enumerate()
        {
            report.reject(Rejection { index, name: None, detail: detail.to_owned() });
        }
        let told: Vec<(&str, usize)> =
            report.rejected_by_reason.iter().map(|known| (known.reason.as_str(), known.count)).collect();
        assert_eq!(told, [("it has … lines", 2), ("x is -… m", 1), ("the geometry is a \"…", 1)]);
    }

    #[test]
    fn of_many_rejections_some_are_told_and_all_are_counted() {
        let mut report = ImportReport::default();
        for index in 0..5_000 {
            let detail = "x".repeat(1 + index % 200);
            report.reject(Rejection { index, name: None, detail });
        }
        assert_eq!((report.rejected.len(), report.rejected_count), (REJECTIONS_TOLD, 5_000));
        assert_eq!(report.rejected_by_reason.len(), MOST_REASONS);
        assert_eq!(report.rejected_by_reason.iter().map(|known| known.count).sum::<usize>(), 5_000);
    }
}
