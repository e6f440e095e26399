//! Which parts belong to which building, and the building that they make up.

use super::{Found, Frame, Lod, Object, Role};
use crate::buildings::model::{Building, Item, Refused};
use crate::buildings::roof::{self, Surfaces};

/// Parts within parts; more is a mistake, or made to last.
const MOST_GENERATIONS: usize = 16;

/// Objects by their names.
struct Names<'a> {
    sorted: Vec<(&'a str, usize)>,
    /// The building or part that lists an object among its children; for files that tell it in one direction only.
    listed: Vec<(&'a str, usize)>,
}

impl<'a> Names<'a> {
    fn of(objects: &'a [Object]) -> Self {
        let mut sorted: Vec<_> = objects.iter().enumerate().map(|(at, object)| (&*object.name, at)).collect();
        sorted.sort_unstable();
        let children = |object: &'a Object| object.children.iter().map(|child| &**child);
        let mut listed: Vec<_> = objects
            .iter()
            .enumerate()
            .flat_map(|(at, object)| children(object).map(move |child| (child, at)))
            .collect();
        listed.sort_unstable();
        Self { sorted, listed }
    }

    fn first(list: &[(&str, usize)], name: &str) -> Option<usize> {
        let at = list.partition_point(|(other, _)| *other < name);
        list.get(at).filter(|(other, _)| *other == name).map(|(_, object)| *object)
    }

    /// Whether an object is the first of its name.
    fn is_first(&self, objects: &[Object], at: usize) -> bool {
        Self::first(&self.sorted, &objects[at].name) == Some(at)
    }

    /// The building to which a part belongs.
    fn root(&self, objects: &[Object], part: usize) -> Result<usize, String> {
        let mut at = part;
        for _ in 0..MOST_GENERATIONS {
            let object = &objects[at];
            if object.role == Role::Building {
                return Ok(at);
            }
            at = match &object.parent {
                Some(parent) => Self::first(&self.sorted, parent)
                    .ok_or_else(|| format!("its parent \"{parent}\" is no building of the file"))?,
                None => Self::first(&self.listed, &object.name)
                    .ok_or("it is a part of a building and names no parent, nor does a building name it")?,
            };
        }
        Err("its parents lead in a circle, or through more than 16 parts".to_owned())
    }
}

/// Makes buildings of objects, in their order; items are numbered from `index`. Stops where `each` says false.
pub(in crate::buildings) fn items(
    objects: &[Object],
    vertices: &[[f64; 3]],
    frame: &Frame,
    index: usize,
    each: &mut dyn FnMut(Item) -> bool,
) {
    let names = Names::of(objects);
    let mut homeless = vec![None; objects.len()];
    let mut parts = Vec::new();
    for (at, _) in objects.iter().enumerate().filter(|(_, object)| object.role == Role::Part) {
        match names.root(objects, at) {
            Ok(root) => parts.push((root, at)),
            Err(detail) => homeless[at] = Some(detail),
        }
    }
    parts.sort_unstable();
    let mut surfaces = Surfaces::default();
    let mut index = index;
    for (at, object) in objects.iter().enumerate() {
        let made = match (object.role, homeless[at].take()) {
            (_, Some(detail)) => Err(detail),
            (Role::Part, None) => continue,
            (Role::Building, None) if !names.is_first(objects, at) => {
                Err("an object of this name occurs earlier in the file; names are unique".to_owned())
            }
            (Role::Building, None) => {
                let own = parts.partition_point(|(root, _)| *root < at)..parts.partition_point(|(root, _)| *root <= at);
                let family: Vec<&Object> = parts[own].iter().map(|(_, part)| &objects[*part]).collect();
                building(object, &family, vertices, frame, &mut surfaces)
            }
        };
        let name = &object.name;
        let item = match made {
            Ok(building) => Item::Building(Building { index, ..building }),
            Err(detail) => Item::Refused(Refused::new(index, Some(name.to_string()), detail)),
        };
        if !each(item) {
            return;
        }
        index += 1;
    }
}

fn building(
    object: &Object,
    parts: &[&Object],
    vertices: &[[f64; 3]],
    frame: &Frame,
    surfaces: &mut Surfaces,
) -> Result<Building, String> {
    let own = object.found.as_ref().map_err(Clone::clone)?;
    let mut all = Vec::with_capacity(parts.len() + 1);
    for part in parts {
        let found = part.found.as_ref().map_err(|detail| format!("its part \"{}\": {detail}", part.name))?;
        all.push(found);
    }
    // a building that is there as a whole beside better parts is the same roof once more, generalised
    let lod = |found: &Found| found.roof.as_ref().map(|roof| roof.lod);
    let best_part = all.iter().filter_map(|part| lod(part)).max();
    if best_part.is_none_or(|best| lod(own) >= Some(best)) {
        all.push(own);
    }
    surfaces.clear();
    for roof in all.iter().filter_map(|found| found.roof.as_ref()) {
        roof.resolve(vertices, &frame.transform, surfaces)?;
    }
    if surfaces.len() == 0 {
        all.push(own);
        return Err(without_roof(&all));
    }
    if let Some(system) = &frame.system {
        system.order(surfaces.points_mut());
    }
    let geographic = frame.system.as_ref().is_some_and(|system| system.geographic);
    let edges = roof::edges(surfaces, geographic).map_err(|error| error.to_string())?;
    // the attributes of the building hold for all of it; those of parts are as good as the worst
    let of_parts = parts.iter().filter_map(|part| part.roof_rmse_m).reduce(f64::max);
    let roof_rmse_m = object.roof_rmse_m.or(of_parts);
    Ok(Building { index: 0, name: object.name.to_string(), crs: frame.crs(), roof_rmse_m, edges })
}

/// Why a building has no roof that counts.
fn without_roof(all: &[&Found]) -> String {
    if all.iter().any(|found| found.instance) {
        return "its geometry is an instance of a template (GeometryInstance), which is not read; give its surfaces \
                themselves"
            .to_owned();
    }
    let below: Option<Lod> = all.iter().filter_map(|found| found.below).max();
    let has = match below {
        Some(lod) => format!("its roof surfaces are of LoD {lod} only"),
        None => "it has no surface with the semantics RoofSurface".to_owned(),
    };
    format!("{has}; roof surfaces of LoD 2 or above are needed")
}
