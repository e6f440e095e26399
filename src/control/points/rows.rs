//! A row of the table, read.

use chrono::NaiveDate;
use nalgebra::Vector3;
use sqlx::FromRow;

use super::{Kept, Numbered};
use crate::control::model::{StoredControlPoint, Use, Validity};
use crate::control::{ControlError, encoding};

#[derive(FromRow)]
pub(super) struct Row {
    id: i64,
    set_id: i64,
    name: String,
    is_check: bool,
    valid_from: Option<NaiveDate>,
    valid_to: Option<NaiveDate>,
    sigma_m: f64,
    reference_x_m: f64,
    reference_y_m: f64,
    reference_z_m: f64,
    edges: Vec<u8>,
}

impl Numbered for Row {
    fn id(&self) -> i64 {
        self.id
    }
}

impl TryFrom<Row> for Kept {
    type Error = ControlError;

    fn try_from(row: Row) -> Result<Self, ControlError> {
        let reference_geocentric_m = Vector3::new(row.reference_x_m, row.reference_y_m, row.reference_z_m);
        let edges = encoding::from_bytes(&row.edges, row.sigma_m, reference_geocentric_m)
            .ok_or_else(|| ControlError::Damaged { name: row.name.clone() })?;
        let point = StoredControlPoint {
            name: row.name,
            sigma_m: row.sigma_m,
            reference_geocentric_m,
            edges,
            purpose: if row.is_check { Use::Check } else { Use::Control },
            validity: Validity { from: row.valid_from, to: row.valid_to },
        };
        Ok(Self { id: row.id, set_id: row.set_id, point })
    }
}
