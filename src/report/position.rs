//! Positions as the contract writes them: a CRS, three coordinates, and what makes heights ellipsoidal.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A position in a coordinate reference system: always east or longitude, north or latitude, up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Position {
    /// `EPSG:<code>` or a PROJ string.
    #[schema(example = "EPSG:4979")]
    pub crs: String,
    /// `[x, y, z]`: degrees for geographic systems, metres for all others, and the height.
    #[schema(value_type = Vec<f64>, example = json!([-98.09, 30.16, 317.3]))]
    pub coordinates: [f64; 3],
    /// What makes the height ellipsoidal, if it is not already.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical: Option<Vertical>,
}

/// How a height becomes ellipsoidal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Vertical {
    /// Height above the geoid + this = ellipsoidal height.
    pub geoid_undulation_m: f64,
}

/// Something that the user should know of an answer that is otherwise complete.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// A stable word for programs.
    #[schema(example = "vertical_assumed_ellipsoidal")]
    pub code: String,
    /// A sentence for staff.
    pub detail: String,
}

impl Warning {
    /// The stated accuracy of the height allows more than was searched.
    #[must_use]
    pub fn height_cut() -> Self {
        Self {
            code: "height_cut".to_owned(),
            detail: "The standard deviation of the height allows flying heights that were not searched: search.flying_height_m \
                     says which were. Give a better height, or a smaller standard deviation."
                .to_owned(),
        }
    }

    /// It was searched a second time, wider than the stated accuracy of the approximation.
    #[must_use]
    pub fn approximation_widened() -> Self {
        Self {
            code: "approximation_widened".to_owned(),
            detail:
                "Nothing beyond doubt was found within the stated accuracy of the approximation: it was searched a \
                     second time, as if it erred three times as much. Check the approximation and its standard \
                     deviations."
                    .to_owned(),
        }
    }

    /// Heights of a CRS that says nothing about them were taken as ellipsoidal.
    #[must_use]
    pub fn vertical_assumed_ellipsoidal(crs: &str) -> Self {
        Self {
            code: "vertical_assumed_ellipsoidal".to_owned(),
            detail: format!(
                "{crs} says nothing about heights: they are taken as heights above the ellipsoid. If they are above the \
                 geoid, give its undulation: \"vertical\": {{\"geoid_undulation_m\": N}} beside \"crs\", in a URL \
                 &geoid_undulation_m=N."
            ),
        }
    }
}
