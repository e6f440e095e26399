//! Checks a definition and fills in what it leaves out.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::{
    Adjustment, AsymmetricDefinition, DistanceDefinition, DistanceRequest, FORMAT_MM, FiducialDefinition,
    FiducialRequest, FilmCameraDefinition, FilmCameraRequest, FilmDistortion, FilmModel, SIGMA_ASYMMETRIC_MM,
    SIGMA_DISTANCE_MM, SIGMA_MM, Templates,
};
use crate::estimation::{Distance, TrilaterationError, trilaterate};
use crate::geometry::FilmError;
use crate::interior::Library;
use crate::jobs::request::{Faults, FieldFault, within};

const FIDUCIALS: std::ops::RangeInclusive<usize> = 2..=32;
const MOST_DISTANCES: usize = 1000;
const MOST_ROWS: usize = 200;
const NAME_MAX_CHARACTERS: usize = 40;
const LARGEST_COORDINATE_MM: f64 = 500.0;
const LARGEST_SIGMA_MM: f64 = 1.0;
const LEAST_APART_MM: f64 = 1.0;
/// No camera's image is smaller or larger.
const SIDES_MM: [f64; 2] = [10.0, 2.0 * LARGEST_COORDINATE_MM];
const PRINCIPAL_DISTANCES_MM: [f64; 2] = [5.0, 5000.0];
/// Positions that are farther from the adjusted ones are not approximate, or a distance is wrong that nothing checks.
const LARGEST_MOVE_MM: f64 = 5.0;

impl FilmCameraRequest {
    /// Checks everything (but the camera's own name) and fills in what was left out.
    ///
    /// # Errors
    /// All the faults there are, as far as they can be told apart.
    pub fn definition(&self, templates: &Templates) -> Result<FilmCameraDefinition, Vec<FieldFault>> {
        let mut faults = Faults::default();
        self.check_numbers(&mut faults);
        self.check_fiducials(templates, &mut faults);
        self.check_asymmetric(templates, &mut faults);
        let mut definition = self.filled_in();
        if faults.0.is_empty() {
            check_film(&definition, &mut faults);
            self.adjust(&mut definition, &mut faults);
        }
        if faults.0.is_empty() { Ok(definition) } else { Err(faults.0) }
    }

    fn check_numbers(&self, faults: &mut Faults) {
        let [least, most] = PRINCIPAL_DISTANCES_MM;
        faults.check("/principal_distance_mm", within(self.principal_distance_mm, least, most, "mm"));
        let [least, most] = SIDES_MM;
        for (k, side) in self.format_mm.iter().flatten().enumerate() {
            faults.check(&format!("/format_mm/{k}"), within(*side, least, most, "mm"));
        }
        check_place("/principal_point_mm", self.principal_point_mm, faults);
        if let Some(point) = self.symmetry_point_mm {
            check_place("/symmetry_point_mm", point, faults);
        }
        if let Some(distortion) = &self.distortion {
            distortion.check(faults);
        }
    }

    fn check_fiducials(&self, templates: &Templates, faults: &mut Faults) {
        let count = self.fiducials.len();
        if !FIDUCIALS.contains(&count) {
            let (least, most) = FIDUCIALS.into_inner();
            return faults
                .add("/fiducials", format!("{count} fiducials are given; there must be from {least} to {most}"));
        }
        for (k, fiducial) in self.fiducials.iter().enumerate() {
            let pointer = format!("/fiducials/{k}");
            self.check_name(k, faults);
            check_place(&format!("{pointer}/position_mm"), fiducial.position_mm, faults);
            check_sigma(&pointer, fiducial.sigma_mm, faults);
            check_look(&pointer, (&fiducial.template, fiducial.rotation_deg), templates, faults);
            if fiducial.sigma_mm.is_some() && self.fiducial_distances.is_some() {
                let detail = "with fiducial_distances it follows from these; leave it out, or give no distances";
                faults.add(format!("{pointer}/sigma_mm"), detail);
            }
        }
        self.check_apart(self.fiducials.iter().map(|fiducial| fiducial.position_mm), faults);
    }

    fn check_name(&self, index: usize, faults: &mut Faults) {
        let (name, pointer) = (&self.fiducials[index].name, format!("/fiducials/{index}/name"));
        let characters = name.chars().count();
        if !(1..=NAME_MAX_CHARACTERS).contains(&characters) {
            let detail = format!("name has {characters} characters; it must have from 1 to {NAME_MAX_CHARACTERS}");
            return faults.add(pointer, detail);
        }
        if name.trim() != name || name.chars().any(char::is_control) {
            return faults.add(pointer, "name begins or ends with a space, or contains control characters");
        }
        if let Some(first) = self.fiducials[..index].iter().position(|other| other.name == *name) {
            faults.add(pointer, format!("{name:?} is the name of fiducial {first} already; names must be unique"));
        }
    }

    fn check_apart(&self, positions: impl Iterator<Item = [f64; 2]>, faults: &mut Faults) {
        let positions: Vec<Vector2<f64>> = positions.map(Vector2::from).collect();
        for (k, position) in positions.iter().enumerate() {
            let near = positions[..k].iter().position(|other| (position - other).norm() <= LEAST_APART_MM);
            if let Some(other) = near {
                let detail = format!(
                    "it is {:.3} mm from fiducial {:?}; different marks are more than {LEAST_APART_MM} mm apart",
                    (position - positions[other]).norm(),
                    self.fiducials[other].name
                );
                faults.add(format!("/fiducials/{k}/position_mm"), detail);
            }
        }
    }

    fn check_asymmetric(&self, templates: &Templates, faults: &mut Faults) {
        if let Some(feature) = &self.asymmetric_feature {
            let pointer = "/asymmetric_feature";
            check_place(&format!("{pointer}/position_mm"), feature.position_mm, faults);
            check_sigma(pointer, feature.sigma_mm, faults);
            check_look(pointer, (&feature.template, feature.rotation_deg), templates, faults);
        }
    }

    fn filled_in(&self) -> FilmCameraDefinition {
        let fiducial = |given: &FiducialRequest| FiducialDefinition {
            name: given.name.clone(),
            position_mm: given.position_mm,
            sigma_mm: given.sigma_mm.unwrap_or(SIGMA_MM),
            approximate_position_mm: None,
            template: given.template.clone(),
            rotation_deg: given.rotation_deg.unwrap_or_default(),
        };
        let asymmetric_feature = self.asymmetric_feature.as_ref().map(|given| AsymmetricDefinition {
            position_mm: given.position_mm,
            sigma_mm: given.sigma_mm.unwrap_or(SIGMA_ASYMMETRIC_MM),
            template: given.template.clone(),
            rotation_deg: given.rotation_deg.unwrap_or_default(),
        });
        FilmCameraDefinition {
            principal_distance_mm: self.principal_distance_mm,
            principal_point_mm: self.principal_point_mm,
            symmetry_point_mm: self.symmetry_point_mm.unwrap_or(self.principal_point_mm),
            format_mm: self.format_mm.unwrap_or(FORMAT_MM),
            distortion: self.distortion.as_ref().map_or_else(FilmDistortion::none, FilmDistortion::filled_in),
            fiducials: self.fiducials.iter().map(fiducial).collect(),
            fiducial_distances: Vec::new(),
            adjustment: None,
            asymmetric_feature,
            data_strip: self.data_strip,
        }
    }

    /// Where there are distances, moves the marks to where these have them.
    fn adjust(&self, definition: &mut FilmCameraDefinition, faults: &mut Faults) {
        let Some(given) = &self.fiducial_distances else { return };
        let Some(distances) = self.distances(given, faults) else { return };
        let approximate: Vec<_> = self.fiducials.iter().map(|fiducial| Vector2::from(fiducial.position_mm)).collect();
        let adjusted = match trilaterate(&approximate, &distances) {
            Ok(adjusted) => adjusted,
            Err(error) => return self.explain(&error, faults),
        };
        for (k, fiducial) in definition.fiducials.iter_mut().enumerate() {
            let moved_mm = (adjusted.positions_mm[k] - approximate[k]).norm();
            if moved_mm > LARGEST_MOVE_MM {
                let detail = format!(
                    "the distances move it by {moved_mm:.1} mm; approximate positions must be right within \
                     {LARGEST_MOVE_MM} mm"
                );
                faults.add(format!("/fiducials/{k}/position_mm"), detail);
            }
            fiducial.approximate_position_mm = Some(fiducial.position_mm);
            fiducial.position_mm = adjusted.positions_mm[k].into();
            fiducial.sigma_mm = adjusted.sigma_mm(k);
        }
        self.check_apart(definition.fiducials.iter().map(|fiducial| fiducial.position_mm), faults);
        let kept = |(k, given): (usize, &DistanceRequest)| DistanceDefinition {
            between: given.between.clone(),
            distance_mm: given.distance_mm,
            sigma_mm: distances[k].sigma_mm,
            residual_mm: adjusted.residuals_mm[k],
        };
        definition.fiducial_distances = given.iter().enumerate().map(kept).collect();
        definition.adjustment = Some(Adjustment { sigma0: adjusted.sigma0, redundancy: adjusted.redundancy });
    }

    fn distances(&self, given: &[DistanceRequest], faults: &mut Faults) -> Option<Vec<Distance>> {
        if given.len() > MOST_DISTANCES {
            let detail = format!("{} distances are given; there may be {MOST_DISTANCES}", given.len());
            faults.add("/fiducial_distances", detail);
            return None;
        }
        let names: BTreeMap<&str, usize> =
            self.fiducials.iter().enumerate().map(|(k, fiducial)| (fiducial.name.as_str(), k)).collect();
        let distances = given.iter().enumerate().map(|(k, given)| distance(k, given, &names, faults)).collect();
        // one by one, so that all faults are told
        let distances: Vec<Option<Distance>> = distances;
        distances.into_iter().collect()
    }

    fn explain(&self, error: &TrilaterationError, faults: &mut Faults) {
        match error {
            TrilaterationError::Malformed { distance } | TrilaterationError::Contradictory { distance, .. } => {
                let detail = format!("{error}; one of the distances, or a standard deviation, is wrong");
                faults.add(format!("/fiducial_distances/{distance}/distance_mm"), detail);
            }
            TrilaterationError::Undetermined { movable, .. } => {
                let name = &self.fiducials[*movable].name;
                let detail = format!("{error}; mark {name:?} can still move, give more distances from it");
                faults.add("/fiducial_distances", detail);
            }
            TrilaterationError::Diverges => faults.add("/fiducial_distances", error.to_string()),
        }
    }
}

fn distance(
    index: usize,
    given: &DistanceRequest,
    names: &BTreeMap<&str, usize>,
    faults: &mut Faults,
) -> Option<Distance> {
    let pointer = format!("/fiducial_distances/{index}");
    let before = faults.0.len();
    let marks = given.between.each_ref().map(|name| names.get(name.as_str()).copied());
    for (k, name) in given.between.iter().enumerate() {
        if marks[k].is_none() {
            faults.add(format!("{pointer}/between/{k}"), format!("there is no fiducial {name:?}"));
        }
    }
    if marks[0].is_some() && marks[0] == marks[1] {
        faults.add(format!("{pointer}/between"), "both are the same mark; give two different ones");
    }
    let largest = 4.0 * LARGEST_COORDINATE_MM;
    faults.check(&format!("{pointer}/distance_mm"), within(given.distance_mm, LEAST_APART_MM, largest, "mm"));
    check_sigma(&pointer, given.sigma_mm, faults);
    let [Some(from), Some(to)] = marks else { return None };
    let sigma_mm = given.sigma_mm.unwrap_or(SIGMA_DISTANCE_MM);
    (faults.0.len() == before).then_some(Distance { between: [from, to], distance_mm: given.distance_mm, sigma_mm })
}

fn check_place(pointer: &str, place_mm: [f64; 2], faults: &mut Faults) {
    for (k, value) in place_mm.into_iter().enumerate() {
        let value = within(value, -LARGEST_COORDINATE_MM, LARGEST_COORDINATE_MM, "mm");
        faults.check(&format!("{pointer}/{k}"), value);
    }
}

fn check_sigma(parent: &str, sigma_mm: Option<f64>, faults: &mut Faults) {
    if let Some(sigma_mm) = sigma_mm
        && !(sigma_mm > 0.0 && sigma_mm <= LARGEST_SIGMA_MM)
    {
        let detail = format!("{sigma_mm} mm is not above 0 and at most {LARGEST_SIGMA_MM} mm");
        faults.add(format!("{parent}/sigma_mm"), detail);
    }
}

fn check_look(parent: &str, (template, rotation_deg): (&str, Option<f64>), templates: &Templates, faults: &mut Faults) {
    if Library::from_name(template).is_none() && !templates.contains_key(template) {
        let library = Library::ALL.map(Library::name).join(", ");
        let detail = format!(
            "there is no template {template:?}; use one of {library}, or upload one to /api/v1/mark-templates first"
        );
        faults.add(format!("{parent}/template"), detail);
    }
    if let Some(rotation_deg) = rotation_deg {
        faults.check(&format!("{parent}/rotation_deg"), within(rotation_deg, -360.0, 360.0, "degrees"));
    }
}

/// What only the lens as a whole shows.
fn check_film(definition: &FilmCameraDefinition, faults: &mut Faults) {
    if let Err(error) = definition.film() {
        let pointer = match &error {
            FilmError::NotPositive { name, .. } | FilmError::NotFinite { name } | FilmError::Outside { name, .. } => {
                format!("/{name}")
            }
            FilmError::Table { .. } => String::from("/distortion/radius_mm"),
            _ => String::from("/distortion"),
        };
        faults.add(pointer, error.to_string());
    }
}

impl FilmDistortion {
    fn none() -> Self {
        Self {
            model: FilmModel::Smac,
            k0: None,
            k1: None,
            k2: None,
            k3: None,
            k4: None,
            p1: None,
            p2: None,
            p3: None,
            p4: None,
            radius_mm: None,
            distortion_um: None,
        }
        .filled_in()
    }

    fn filled_in(&self) -> Self {
        let mut filled = self.clone();
        if self.model == FilmModel::Smac {
            let Self { k0, k1, k2, k3, k4, p1, p2, p3, p4, .. } = &mut filled;
            for coefficient in [k0, k1, k2, k3, k4, p1, p2, p3, p4] {
                coefficient.get_or_insert(0.0);
            }
        }
        filled
    }

    fn check(&self, faults: &mut Faults) {
        match self.model {
            FilmModel::Smac => {
                let given = [("radius_mm", self.radius_mm.is_some()), ("distortion_um", self.distortion_um.is_some())];
                foreign(&given, "smac", "table", faults);
            }
            FilmModel::Table => {
                let Self { k0, k1, k2, k3, k4, p1, p2, p3, p4, .. } = self;
                let names = ["k0", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"];
                let values = [k0, k1, k2, k3, k4, p1, p2, p3, p4].map(Option::is_some);
                let given: Vec<(&str, bool)> = names.into_iter().zip(values).collect();
                foreign(&given, "table", "smac", faults);
                self.check_table(faults);
            }
        }
    }

    fn check_table(&self, faults: &mut Faults) {
        let (Some(radii), Some(values)) = (&self.radius_mm, &self.distortion_um) else {
            let name = if self.radius_mm.is_none() { "radius_mm" } else { "distortion_um" };
            return faults.add(format!("/distortion/{name}"), format!("{name} is missing; model \"table\" needs it"));
        };
        if radii.len() > MOST_ROWS {
            let detail = format!("the table has {} rows; it may have {MOST_ROWS}", radii.len());
            return faults.add("/distortion/radius_mm", detail);
        }
        if radii.len() != values.len() {
            let detail = format!("there are {} values for {} radii; give one for each", values.len(), radii.len());
            faults.add("/distortion/distortion_um", detail);
        }
        for (k, radius) in radii.iter().enumerate() {
            let radius = within(*radius, 0.0, 2.0 * LARGEST_COORDINATE_MM, "mm");
            faults.check(&format!("/distortion/radius_mm/{k}"), radius);
        }
    }
}

/// Fields that belong to the other model of distortion.
fn foreign(given: &[(&str, bool)], model: &str, other: &str, faults: &mut Faults) {
    for (name, _) in given.iter().filter(|(_, given)| *given) {
        let detail = format!("{name} belongs to the model {other:?}, not to {model:?}");
        faults.add(format!("/distortion/{name}"), detail);
    }
}
