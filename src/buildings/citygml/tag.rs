//! Elements by their names and namespaces.

use quick_xml::name::{Namespace, NamespaceResolver, QName, ResolveResult};

/// What an element is to the reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tag {
    /// A building.
    Building,
    /// A part of one.
    Part,
    /// A roof surface.
    Roof,
    /// What bounds or fills a building and is no roof, with all that is in it.
    Aside,
    /// A property that holds surfaces or solids, and its LoD.
    Geometry(u8),
    /// Something that holds surfaces and may be referred to.
    Container,
    /// A polygon, or what is one within a surface.
    Polygon,
    /// Coordinates of several points, or of one.
    Positions,
    /// A ring.
    Ring,
    /// A ring of curves.
    RingOfCurves,
    /// A bounding box.
    Envelope,
    /// A property of geometry that may refer instead of holding.
    Member,
    /// Anything else: what is in it may matter.
    Other,
}

impl Tag {
    /// What an element is. The namespace is looked at only where the local name is one that matters.
    pub(super) fn of(name: QName<'_>, namespaces: &NamespaceResolver) -> Self {
        let (tag, of_gml) = match name.local_name().as_ref() {
            b"Building" => (Self::Building, false),
            b"BuildingPart" => (Self::Part, false),
            b"RoofSurface" => (Self::Roof, false),
            b"WallSurface"
            | b"GroundSurface"
            | b"ClosureSurface"
            | b"FloorSurface"
            | b"CeilingSurface"
            | b"InteriorWallSurface"
            | b"OuterFloorSurface"
            | b"OuterCeilingSurface"
            | b"BuildingInstallation"
            | b"IntBuildingInstallation"
            | b"Room"
            | b"BuildingRoom"
            | b"BuildingConstructiveElement"
            | b"BuildingFurniture"
            | b"Storey"
            | b"BuildingUnit"
            | b"Appearance" => (Self::Aside, false),
            b"Envelope" => (Self::Envelope, true),
            b"Polygon" | b"PolygonPatch" | b"Triangle" | b"Rectangle" => (Self::Polygon, true),
            b"posList" | b"pos" | b"coordinates" => (Self::Positions, true),
            b"LinearRing" => (Self::Ring, true),
            b"Ring" => (Self::RingOfCurves, true),
            b"MultiSurface"
            | b"CompositeSurface"
            | b"OrientableSurface"
            | b"Surface"
            | b"TriangulatedSurface"
            | b"Tin"
            | b"PolyhedralSurface"
            | b"Solid"
            | b"CompositeSolid"
            | b"MultiSolid"
            | b"Shell" => (Self::Container, true),
            b"surfaceMember" | b"baseSurface" | b"solidMember" => (Self::Member, true),
            other => (Self::geometry(other), false),
        };
        let known = tag == Self::Other
            || matches!(
                namespaces.resolve_prefix(name.prefix(), true),
                ResolveResult::Bound(Namespace(uri)) if if of_gml { is_gml(uri) } else { is_citygml(uri) }
            );
        if known { tag } else { Self::Other }
    }

    /// `lod2MultiSurface` and its like, but neither lines nor what stands for the thing.
    fn geometry(name: &[u8]) -> Self {
        match name {
            [b'l', b'o', b'd', lod @ b'0'..=b'4', kind @ ..]
                if [&b"MultiSurface"[..], b"Solid", b"Surface", b"Geometry", b"MultiSolid"].contains(&kind) =>
            {
                Self::Geometry(lod - b'0')
            }
            _ => Self::Other,
        }
    }
}

/// Of all versions and modules: `http://www.opengis.net/citygml/building/2.0`, `.../citygml/profiles/base/1.0`.
fn is_citygml(uri: &[u8]) -> bool {
    after_scheme(uri).starts_with(b"www.opengis.net/citygml/")
}

/// GML 3.1 and 3.2.
fn is_gml(uri: &[u8]) -> bool {
    matches!(after_scheme(uri), b"www.opengis.net/gml" | b"www.opengis.net/gml/3.2" | b"www.opengis.net/gml/3.3/ce")
}

fn after_scheme(uri: &[u8]) -> &[u8] {
    uri.strip_prefix(b"http://").or_else(|| uri.strip_prefix(b"https://")).unwrap_or(uri)
}
