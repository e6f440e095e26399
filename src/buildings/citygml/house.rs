//! One building while it is read.
//!
//! Kept of it are the polygons of its roof surfaces and of its own solids, because a roof may refer to those; the
//! polygons of walls are passed over. Every polygon and every reference is an *entry*; what has an identifier is a span
//! of entries, and so is what a roof surface holds.

mod polygons;

use std::collections::HashMap;
use std::ops::Range;

use self::polygons::Polygons;
use super::{Attributes, Tag};
use crate::buildings::model::{Building, Item, Limits};
use crate::buildings::reference_system::ReferenceSystem;
use crate::buildings::roof::{self, Surfaces};

/// References to what refers; more is a mistake.
const MOST_STEPS: usize = 16;

/// The lowest LoD whose roofs are roofs.
const LEAST_LOD: u8 = 2;

#[derive(Debug)]
enum Entry {
    /// The number of a polygon.
    Polygon(usize),
    /// What an `xlink:href` says.
    Reference(String),
}

/// The surfaces that one roof surface has in one LoD.
#[derive(Debug)]
struct Roof {
    /// 0 the building itself, then its parts.
    owner: usize,
    lod: u8,
    entries: Range<usize>,
}

/// Something with an identifier, open or closed.
#[derive(Debug)]
struct Named {
    id: String,
    depth: usize,
    entries: Range<usize>,
}

/// A property of geometry that is open.
#[derive(Debug)]
struct Geometry {
    depth: usize,
    lod: u8,
    of_roof: bool,
    first_entry: usize,
}

/// A building, from its start tag to its end tag.
#[derive(Debug)]
pub(super) struct House {
    name: Option<String>,
    depth: usize,
    line: u64,
    bytes_before: u64,
    /// Of the building or part, the roof surface and what is passed over: at which depth it was opened.
    owners: Vec<(usize, usize)>,
    parts: usize,
    roof: Option<usize>,
    aside: Option<usize>,
    geometry: Option<Geometry>,
    open: Vec<Named>,
    named: Vec<Named>,
    entries: Vec<Entry>,
    roofs: Vec<Roof>,
    polygons: Polygons,
    /// Names of the CRS on its envelope and on its geometries.
    envelope_srs: Option<String>,
    geometry_srs: Option<String>,
    /// The first thing that is wrong with it.
    fault: Option<String>,
}

impl House {
    pub(super) fn new(id: Option<String>, depth: usize, bytes_before: u64, line: u64) -> Self {
        Self {
            name: id,
            depth,
            line,
            bytes_before,
            owners: vec![(depth, 0)],
            parts: 0,
            roof: None,
            aside: None,
            geometry: None,
            open: Vec::new(),
            named: Vec::new(),
            entries: Vec::new(),
            roofs: Vec::new(),
            polygons: Polygons::default(),
            envelope_srs: None,
            geometry_srs: None,
            fault: None,
        }
    }

    pub(super) fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    pub(super) fn line(&self) -> u64 {
        self.line
    }

    pub(super) fn bytes_before(&self) -> u64 {
        self.bytes_before
    }

    /// Whether what is opened now has no meaning.
    pub(super) fn passes_over(&self) -> bool {
        self.aside.is_some() || self.fault.is_some()
    }

    /// Whether coordinates are being read.
    pub(super) fn takes_text(&self) -> bool {
        self.fault.is_none() && self.polygons.takes_text()
    }

    /// Whether the attributes of an element have a meaning.
    pub(super) fn wants_attributes(&self, tag: Tag, depth: usize) -> bool {
        match tag {
            Tag::Envelope => depth == self.depth + 2,
            Tag::Geometry(_) => true,
            Tag::Polygon | Tag::Container | Tag::Member | Tag::Positions | Tag::Ring => self.geometry.is_some(),
            _ => false,
        }
    }

    /// Remembers what is wrong, and forgets what was kept.
    pub(super) fn refuse(&mut self, detail: String) {
        if self.fault.is_none() {
            self.fault = Some(detail);
            self.entries = Vec::new();
            self.named = Vec::new();
            self.open = Vec::new();
            self.roofs = Vec::new();
            self.polygons = Polygons::default();
        }
    }

    /// An element begins.
    pub(super) fn open(&mut self, tag: Tag, depth: usize, attributes: Attributes, line: u64) {
        match tag {
            Tag::Aside => self.aside = Some(depth),
            Tag::Building | Tag::Part => {
                self.parts += 1;
                self.owners.push((depth, self.parts));
            }
            Tag::Roof if self.geometry.is_none() => self.roof = Some(depth),
            Tag::Envelope if depth == self.depth + 2 => self.envelope_srs = attributes.srs_name,
            Tag::Geometry(lod) if self.geometry.is_none() => self.open_geometry(lod, depth, attributes),
            _ if self.geometry.is_some() => self.open_in_geometry(tag, depth, attributes, line),
            _ => {}
        }
    }

    fn open_geometry(&mut self, lod: u8, depth: usize, attributes: Attributes) {
        let owner_depth = self.owners.last().map_or(self.depth, |(depth, _)| *depth);
        let of_roof = self.roof.is_some_and(|roof| roof + 1 == depth);
        // not that of a window in the roof, nor of a block
        if lod < LEAST_LOD || !(of_roof || owner_depth + 1 == depth) {
            self.aside = Some(depth);
            return;
        }
        self.geometry = Some(Geometry { depth, lod, of_roof, first_entry: self.entries.len() });
        self.refer(attributes.href);
    }

    fn open_in_geometry(&mut self, tag: Tag, depth: usize, attributes: Attributes, line: u64) {
        self.take_srs(attributes.srs_name);
        if attributes.srs_dimension.is_some_and(|dimension| dimension.trim() != "3") {
            self.refuse(format!("line {line}: srsDimension is not 3; a roof needs heights"));
            return;
        }
        match tag {
            Tag::Polygon | Tag::Container => {
                let first = self.entries.len();
                if let Some(id) = attributes.id {
                    self.open.push(Named { id, depth, entries: first..first });
                }
                if tag == Tag::Polygon {
                    self.polygons.open_polygon(depth);
                }
            }
            Tag::Ring => self.polygons.open_ring(depth),
            Tag::RingOfCurves => {
                self.refuse(format!("line {line}: a polygon has a gml:Ring of curves; only gml:LinearRing is read"));
            }
            Tag::Positions => self.polygons.open_positions(depth),
            Tag::Member => self.refer(attributes.href),
            _ => {}
        }
    }

    fn refer(&mut self, href: Option<String>) {
        self.entries.extend(href.map(Entry::Reference));
    }

    fn take_srs(&mut self, name: Option<String>) {
        match (&self.geometry_srs, name) {
            (None, name) => self.geometry_srs = name,
            (Some(_), None) => {}
            (Some(first), Some(name)) if *first == name => {}
            (Some(first), Some(name)) => {
                self.refuse(format!("its surfaces have different CRSs, \"{first}\" and \"{name}\"; give it in one"));
            }
        }
    }

    /// Text of coordinates.
    pub(super) fn text(&mut self, text: &[u8], limits: &Limits, line: u64) {
        if let Err(detail) = self.polygons.text(text, limits) {
            self.refuse(format!("line {line}: {detail}"));
        }
    }

    /// An element ends that was opened at this depth. Whether it was the building.
    pub(super) fn close(&mut self, depth: usize, limits: &Limits) -> bool {
        if depth == self.depth {
            return true;
        }
        if self.aside == Some(depth) {
            self.aside = None;
        }
        if self.roof == Some(depth) {
            self.roof = None;
        }
        self.owners.pop_if(|(owner, _)| *owner == depth);
        if self.fault.is_none() && self.geometry.is_some() {
            self.close_in_geometry(depth, limits);
        }
        false
    }

    fn close_in_geometry(&mut self, depth: usize, limits: &Limits) {
        match self.polygons.close(depth, limits) {
            Ok(Some(polygon)) => self.entries.push(Entry::Polygon(polygon)),
            Ok(None) => {}
            Err(detail) => return self.refuse(detail),
        }
        if self.entries.len() > limits.building_polygons {
            return self.refuse(format!("it has more than {} surfaces", limits.building_polygons));
        }
        if let Some(mut named) = self.open.pop_if(|named| named.depth == depth) {
            named.entries.end = self.entries.len();
            self.named.push(named);
        }
        // one that is empty must not hide a good one of a lower LoD
        if let Some(Geometry { lod, of_roof, first_entry, .. }) = self.geometry.take_if(|open| open.depth == depth)
            && of_roof
            && first_entry < self.entries.len()
        {
            let owner = self.owners.last().map_or(0, |(_, owner)| *owner);
            self.roofs.push(Roof { owner, lod, entries: first_entry..self.entries.len() });
        }
    }

    /// The building, numbered; or what is wrong with it.
    pub(super) fn finish(
        mut self,
        index: usize,
        system: Option<&ReferenceSystem>,
        limits: &Limits,
    ) -> Result<Item, String> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let name = self.name.take().filter(|name| !name.trim().is_empty());
        let name = name.ok_or("it has no gml:id, by which it could be named")?;
        let mut surfaces = Surfaces::default();
        self.gather(&mut surfaces, limits)?;
        if surfaces.len() == 0 {
            return Err("it has no RoofSurface with surfaces of LoD 2 or above (lod2MultiSurface)".to_owned());
        }
        let own = self.geometry_srs.as_deref().or(self.envelope_srs.as_deref()).and_then(ReferenceSystem::parse);
        let system = own.as_ref().or(system);
        if let Some(system) = system {
            system.order(surfaces.points_mut());
        }
        let geographic = system.is_some_and(|system| system.geographic);
        let edges = roof::edges(&surfaces, geographic).map_err(|error| error.to_string())?;
        let crs = system.map(|system| system.text.clone());
        Ok(Item::Building(Building { index, name, crs, roof_rmse_m: None, edges }))
    }

    /// The polygons of the roofs of the highest LoD that the building, and each part, has.
    fn gather(&self, surfaces: &mut Surfaces, limits: &Limits) -> Result<(), String> {
        let of_parts = self.roofs.iter().filter(|roof| roof.owner > 0).map(|roof| roof.lod).max();
        let mut best_of = vec![None; self.parts + 1];
        for roof in &self.roofs {
            best_of[roof.owner] = best_of[roof.owner].max(Some(roof.lod));
        }
        let mut resolver = Resolver { house: self, surfaces, ids: HashMap::new(), references: 0, limits };
        for roof in &self.roofs {
            // a building that is there as a whole beside better parts is the same roof once more, generalised
            let generalised = roof.owner == 0 && of_parts.is_some_and(|of_parts| of_parts > roof.lod);
            if Some(roof.lod) == best_of[roof.owner] && !generalised {
                resolver.resolve(roof.entries.clone(), 0)?;
            }
        }
        Ok(())
    }
}

/// Follows references.
struct Resolver<'a> {
    house: &'a House,
    surfaces: &'a mut Surfaces,
    /// What has an identifier; `None` if several have it.
    ids: HashMap<&'a str, Option<&'a Named>>,
    /// How many references have been followed.
    references: usize,
    limits: &'a Limits,
}

impl<'a> Resolver<'a> {
    /// Gathers the polygons of entries, and of those to which they refer; `steps` references lie before them.
    fn resolve(&mut self, entries: Range<usize>, steps: usize) -> Result<(), String> {
        for entry in &self.house.entries[entries] {
            match entry {
                Entry::Polygon(polygon) => self.house.polygons.copy(*polygon, self.surfaces),
                Entry::Reference(href) if steps == MOST_STEPS => {
                    return Err(format!("the reference \"{href}\" leads back to itself"));
                }
                Entry::Reference(href) => {
                    let target = self.target(href)?;
                    self.references += 1;
                    self.resolve(target.entries.clone(), steps + 1)?;
                }
            }
            let points = self.surfaces.points().len();
            let most = self.references.max(self.surfaces.len());
            if most > self.limits.building_polygons || points > self.limits.building_vertices {
                return Err("its references multiply its surfaces without end".to_owned());
            }
        }
        Ok(())
    }

    /// What an `xlink:href` points to.
    fn target(&mut self, href: &str) -> Result<&'a Named, String> {
        if self.ids.is_empty() {
            for named in &self.house.named {
                self.ids.entry(&named.id).and_modify(|twice| *twice = None).or_insert(Some(named));
            }
        }
        let shown: String = href.chars().take(100).collect();
        let Some(id) = href.strip_prefix('#') else {
            return Err(format!(
                "a roof surface refers to \"{shown}\"; only references within the file (\"#id\") are read"
            ));
        };
        match self.ids.get(id) {
            Some(Some(named)) => Ok(named),
            Some(None) => Err(format!("a roof surface refers to \"{shown}\", of which there are several")),
            None => {
                Err(format!("a roof surface refers to \"{shown}\", which is not among the surfaces of the building"))
            }
        }
    }
}
