//! What the client wants of the verdict: costs and threshold.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Faults, FieldFault, within};
use crate::diagnosis::Policy;
use crate::learning::Costs;
use crate::learning::classifier::LARGEST_CAUTION;

/// What decisions cost. The first letter is the decision (c: accepted as correct, w: rejected as wrong), the second is
/// reality.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CostsRequest {
    /// Accepted and right.
    #[schema(example = 0)]
    pub cc: f64,
    /// Accepted though wrong.
    #[schema(example = 40)]
    pub cw: f64,
    /// Rejected though right.
    #[schema(example = 5)]
    pub wc: f64,
    /// Rejected and wrong.
    #[schema(example = 10)]
    pub ww: f64,
}

/// Larger costs than this are a mistake.
const LARGEST_COST: f64 = 1e9;
/// Scores beyond this are.
const LARGEST_THRESHOLD: f64 = 1e6;

impl CostsRequest {
    /// What is wrong with them.
    #[must_use]
    pub fn faults(&self) -> Vec<FieldFault> {
        let mut faults = Faults::default();
        self.check(&mut faults);
        faults.0
    }

    /// Adds what is wrong with them, if anything is.
    pub(super) fn check(&self, faults: &mut Faults) {
        let costs = [("cc", self.cc), ("cw", self.cw), ("wc", self.wc), ("ww", self.ww)];
        for (name, cost) in costs {
            faults.check(&format!("/costs/{name}"), within(cost, 0.0, LARGEST_COST, "of any unit"));
        }
        if Costs::from(*self).least_probability().is_none() {
            faults.add("/costs/cw", "accepting what is wrong (cw) must cost more than rejecting it (ww)");
        }
    }
}

pub(super) fn check_caution(caution: f64, faults: &mut Faults) {
    faults.check("/caution", within(caution, 1.0, LARGEST_CAUTION, "times"));
}

pub(super) fn check_threshold(threshold: f64, faults: &mut Faults) {
    faults.check("/threshold", within(threshold, -LARGEST_THRESHOLD, LARGEST_THRESHOLD, "score"));
}

impl From<CostsRequest> for Costs {
    fn from(CostsRequest { cc, cw, wc, ww }: CostsRequest) -> Self {
        Self { cc, cw, wc, ww }
    }
}

impl From<Costs> for CostsRequest {
    fn from(Costs { cc, cw, wc, ww }: Costs) -> Self {
        Self { cc, cw, wc, ww }
    }
}

/// What was given; what was not, the configuration says when the request is accepted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PolicyGiven {
    /// The costs.
    pub costs: Option<CostsRequest>,
    /// By how many times the odds of being wrong may be larger than the classifier says.
    pub caution: Option<f64>,
    /// T_d.
    pub threshold: Option<f64>,
}

impl PolicyGiven {
    /// With what it leaves open filled in. Costs and caution that were given without a threshold are not overruled by a
    /// configured threshold.
    #[must_use]
    pub fn or(self, configured: &Policy) -> Self {
        let given = self.costs.is_some() || self.caution.is_some();
        let configured_threshold = if given { None } else { configured.threshold };
        Self {
            costs: Some(self.costs.unwrap_or(configured.costs.into())),
            caution: self.caution.or(configured.caution),
            threshold: self.threshold.or(configured_threshold),
        }
    }

    /// For the judge.
    #[must_use]
    pub fn policy(&self) -> Policy {
        Policy {
            costs: self.costs.map_or_else(Costs::default, Costs::from),
            caution: self.caution,
            threshold: self.threshold,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configured_threshold_holds_until_a_request_weighs_for_itself() {
        let configured = Policy { threshold: Some(2.0), ..Policy::default() };
        let threshold = |given: PolicyGiven| given.or(&configured).threshold;
        assert_eq!(threshold(PolicyGiven::default()), Some(2.0));
        assert_eq!(threshold(PolicyGiven { threshold: Some(1.0), ..PolicyGiven::default() }), Some(1.0));
        assert_eq!(threshold(PolicyGiven { caution: Some(3.0), ..PolicyGiven::default() }), None);
        let costs = Some(Costs { cw: 80.0, ..Costs::default() }.into());
        assert_eq!(threshold(PolicyGiven { costs, ..PolicyGiven::default() }), None);
    }
}
