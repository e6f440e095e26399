//! What the samples do not have: other ways in which the same may be written.

use super::*;

/// A gable roof of 12 m by 8 m as two surfaces, with x and y far from the origin; the text of the rings.
const SOUTH: &str = "356000 5645000 5 356012 5645000 5 356012 5645004 9 356000 5645004 9 356000 5645000 5";
const NORTH: &str = "356012 5645008 5 356000 5645008 5 356000 5645004 9 356012 5645004 9 356012 5645008 5";

const NAMESPACES: &str = "xmlns=\"http://www.opengis.net/citygml/2.0\" \
    xmlns:b=\"http://www.opengis.net/citygml/building/2.0\" xmlns:g=\"http://www.opengis.net/gml\" \
    xmlns:x=\"http://www.w3.org/1999/xlink\"";

fn model(inside: &str) -> String {
    format!("<CityModel {NAMESPACES}><cityObjectMember>{inside}</cityObjectMember></CityModel>")
}

fn polygon(ring: &str) -> String {
    format!(
        "<g:surfaceMember><g:Polygon><g:exterior><g:LinearRing><g:posList>{ring}</g:posList></g:LinearRing></g:exterior>\
         </g:Polygon></g:surfaceMember>"
    )
}

fn roof(lod: u8, members: &str) -> String {
    format!(
        "<b:boundedBy><b:RoofSurface><b:lod{lod}MultiSurface><g:MultiSurface>{members}</g:MultiSurface>\
         </b:lod{lod}MultiSurface></b:RoofSurface></b:boundedBy>"
    )
}

fn house(inside: &str) -> String {
    format!("<b:Building g:id=\"H\">{inside}</b:Building>")
}

fn only(format: Format, text: &str) -> Item {
    let mut items = items(format, text.as_bytes()).unwrap();
    assert_eq!(items.len(), 1, "{items:?}");
    items.remove(0)
}

fn building(format: Format, text: &str) -> Building {
    match only(format, text) {
        Item::Building(building) => building,
        Item::Refused(refused) => panic!("{refused:?}"),
    }
}

fn refused(format: Format, text: &str) -> String {
    match only(format, text) {
        Item::Refused(refused) => refused.detail,
        Item::Building(building) => panic!("{building:?}"),
    }
}

fn is_the_gable_roof(building: &Building) {
    let kinds: Vec<EdgeKind> = in_order(&building.edges).iter().map(|edge| edge.kind).collect();
    use EdgeKind::{Eave, Gable, Ridge};
    assert_eq!(kinds, [Eave, Eave, Ridge, Gable, Gable, Gable, Gable]);
    let ridge = building.edges.iter().find(|edge| edge.kind == Ridge).unwrap();
    let mut ends = [ridge.start, ridge.end];
    ends.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(ends, [[356_000.0, 5_645_004.0, 9.0], [356_012.0, 5_645_004.0, 9.0]]);
}

#[test]
fn without_a_crs_there_is_none() {
    let found = building(Format::CityGml, &model(&house(&roof(2, &(polygon(SOUTH) + &polygon(NORTH))))));
    is_the_gable_roof(&found);
    assert_eq!((found.name.as_str(), found.crs, found.roof_rmse_m), ("H", None, None));
}

#[test]
fn points_may_stand_alone_or_between_commas() {
    let words: Vec<&str> = SOUTH.split(' ').collect();
    let alone: String = words.chunks(3).map(|point| format!("<g:pos>{}</g:pos>", point.join(" "))).collect();
    let tuples: Vec<String> = NORTH.split(' ').collect::<Vec<_>>().chunks(3).map(|point| point.join(",")).collect();
    let ring = |inside: &str| {
        format!(
            "<g:surfaceMember><g:Polygon><g:exterior><g:LinearRing>{inside}</g:LinearRing></g:exterior></g:Polygon></g:surfaceMember>"
        )
    };
    let both = ring(&alone) + &ring(&format!("<g:coordinates>\n{}\n</g:coordinates>", tuples.join("\n")));
    is_the_gable_roof(&building(Format::CityGml, &model(&house(&roof(2, &both)))));
}

#[test]
fn a_roof_may_refer_to_the_surfaces_of_the_solid() {
    let named = |id: &str, ring: &str| polygon(ring).replace("<g:Polygon>", &format!("<g:Polygon g:id=\"{id}\">"));
    let solid = format!(
        "<b:lod2Solid><g:Solid><g:exterior><g:CompositeSurface>{}<g:surfaceMember><g:CompositeSurface g:id=\"c\">{}\
         </g:CompositeSurface></g:surfaceMember></g:CompositeSurface></g:exterior></g:Solid></b:lod2Solid>",
        named("s", SOUTH),
        named("n", NORTH)
    );
    let turned = "<g:surfaceMember><g:OrientableSurface orientation=\"-\"><g:baseSurface x:href=\"#s\"/>\
                  </g:OrientableSurface></g:surfaceMember>";
    let whole = "<g:surfaceMember x:href=\"#c\"/>";
    for (before, after) in [(&*solid, ""), ("", &*solid)] {
        let text = model(&house(&format!("{before}{}{}{after}", roof(2, turned), roof(2, whole))));
        is_the_gable_roof(&building(Format::CityGml, &text));
    }
    let detail = refused(Format::CityGml, &model(&house(&(solid + &roof(2, "<g:surfaceMember x:href=\"#gone\"/>")))));
    assert!(detail.contains("\"#gone\"") && detail.contains("line 1"), "{detail}");
}

#[test]
fn the_higher_lod_is_taken_and_blocks_are_not() {
    let block = polygon("0 0 7 9 0 7 9 9 7 0 9 7 0 0 7");
    let text = model(&house(&(roof(2, &block) + &roof(3, &(polygon(SOUTH) + &polygon(NORTH))))));
    is_the_gable_roof(&building(Format::CityGml, &text));
    let detail = refused(Format::CityGml, &model(&house(&roof(1, &block))));
    assert!(detail.contains("LoD 2 or above"), "{detail}");
}

#[test]
fn windows_installations_and_other_namespaces_are_no_roof() {
    let other = polygon("0 0 7 9 0 7 9 9 7 0 9 7 0 0 7");
    let window = format!(
        "<b:opening><b:Window><b:lod3MultiSurface><g:MultiSurface>{other}</g:MultiSurface></b:lod3MultiSurface>\
         </b:Window></b:opening></b:RoofSurface>"
    );
    let own = roof(2, &(polygon(SOUTH) + &polygon(NORTH))).replace("</b:RoofSurface>", &window);
    let chimney = format!(
        "<b:outerBuildingInstallation><b:BuildingInstallation>{}</b:BuildingInstallation></b:outerBuildingInstallation>",
        roof(2, &other)
    );
    let foreign =
        format!("<f:RoofSurface xmlns:f=\"urn:f\">{}</f:RoofSurface>", roof(2, &other).replace("b:Roof", "f:Roof"));
    is_the_gable_roof(&building(Format::CityGml, &model(&house(&(own + &chimney + &foreign)))));
}

#[test]
fn the_crs_may_stand_on_the_building_or_on_its_surfaces() {
    let members = polygon(SOUTH) + &polygon(NORTH);
    let envelope = "<g:boundedBy><g:Envelope srsName=\"EPSG:25832\"><g:lowerCorner>0 0 0</g:lowerCorner></g:Envelope>\
                    </g:boundedBy>";
    let found = building(Format::CityGml, &model(&house(&(envelope.to_owned() + &roof(2, &members)))));
    assert_eq!(found.crs.as_deref(), Some("EPSG:25832"));
    let on_surface = roof(2, &members)
        .replace("<g:MultiSurface>", "<g:MultiSurface srsName=\"urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783\">");
    let found = building(Format::CityGml, &model(&house(&(envelope.to_owned() + &on_surface))));
    assert_eq!(found.crs.as_deref(), Some("EPSG:25832+5783"));
    let two = on_surface + &roof(2, &members).replace("<g:MultiSurface>", "<g:MultiSurface srsName=\"EPSG:4326\">");
    let detail = refused(Format::CityGml, &model(&house(&two)));
    assert!(detail.contains("different CRSs"), "{detail}");
}

/// The same roof in CityJSON: the south slope is surface 1, the north slope surface 2, surface 0 the ground.
const VERTICES: &str = "[[0,0,5],[12,0,5],[12,8,5],[0,8,5],[0,4,9],[12,4,9],[0,0,0],[12,0,0],[12,8,0],[0,8,0]]";
const SURFACES: &str = "[[6,9,8,7]],[[0,1,5,4]],[[2,3,4,5]]";
const SEMANTICS: &str = r#""surfaces":[{"type":"RoofSurface"},{"type":"+Solar"},{"type":"GroundSurface"}]"#;

fn geometry(kind: &str, lod: &str, boundaries: &str, values: &str) -> String {
    format!(
        r#"{{"type":"{kind}","lod":{lod},"boundaries":{boundaries},"semantics":{{{SEMANTICS},"values":{values}}}}}"#
    )
}

fn city(version: &str, objects: &str) -> String {
    format!(
        r#"{{"CityObjects":{{{objects}}},"type":"CityJSON","version":"{version}","appearance":{{"a":[[1.5,null,"x"]]}},
        "vertices":{VERTICES},"transform":{{"scale":[1,1,1],"translate":[356000,5645000,0]}}}}"#
    )
}

fn object(kind: &str, more: &str, geometries: &str) -> String {
    format!(r#"{{"type":"{kind}"{more},"geometry":[{geometries}]}}"#)
}

#[test]
fn every_type_of_geometry_holds_roofs() {
    for (kind, boundaries, values) in [
        ("MultiSurface", format!("[{SURFACES}]"), "[2,0,0]".to_owned()),
        ("CompositeSurface", format!("[ {SURFACES} ]"), "[null,0,0]".to_owned()),
        ("Solid", format!("[[{SURFACES}]]"), "[[2,0,0]]".to_owned()),
        ("Solid", format!("[[{SURFACES}],[[[6,7,8]]]]"), "[[2,0,0],null]".to_owned()),
        ("MultiSolid", format!("[[[[[6,7,8]]]],[[{SURFACES}]]]"), "[null,[[2,0,0]]]".to_owned()),
        ("CompositeSolid", format!("[[[{SURFACES}],[[[6,7,8]]]]]"), "[[[2,0,0],null]]".to_owned()),
    ] {
        for lod in ["2", "\"2.2\"", "2.2"] {
            let text =
                city("1.1", &format!(r#""H":{}"#, object("Building", "", &geometry(kind, lod, &boundaries, &values))));
            is_the_gable_roof(&building(Format::CityJson, &text));
        }
    }
}

#[test]
fn parts_come_before_or_after_their_building_and_tell_it_either_way() {
    let whole = |values: &str| geometry("MultiSurface", "\"2\"", &format!("[{SURFACES}]"), values);
    let (south, north) = (whole("[null,0,null]"), whole("[null,null,0]"));
    let by_parents = format!(
        r#""P":{},"H":{},"Q":{}"#,
        object("BuildingPart", r#","parents":["H"]"#, &south),
        object("Building", "", ""),
        object("BuildingPart", r#","parents":["P"]"#, &north)
    );
    let by_children = format!(
        r#""P":{},"H":{}"#,
        object("BuildingPart", "", &south),
        object("Building", r#","children":["P"]"#, &north)
    );
    for objects in [by_parents, by_children] {
        let found = building(Format::CityJson, &city("2.0", &objects));
        is_the_gable_roof(&found);
        assert_eq!(found.name, "H");
    }
}

#[test]
fn a_roof_of_lod_1_is_a_block_and_a_better_part_goes_before_the_whole() {
    let block = geometry("MultiSurface", "\"1.3\"", "[[[6,7,8,9]]]", "[0]");
    let detail = refused(Format::CityJson, &city("2.0", &format!(r#""H":{}"#, object("Building", "", &block))));
    assert!(detail.contains("LoD 1.3 only"), "{detail}");
    let coarse = geometry("MultiSurface", "\"2.0\"", "[[[6,7,8,9]]]", "[0]");
    let fine = geometry("MultiSurface", "\"2.2\"", &format!("[{SURFACES}]"), "[2,0,0]");
    let objects = format!(
        r#""H":{},"P":{}"#,
        object("Building", "", &coarse),
        object("BuildingPart", r#","parents":["H"]"#, &(coarse.clone() + "," + &fine))
    );
    is_the_gable_roof(&building(Format::CityJson, &city("2.0", &objects)));
}

#[test]
fn other_objects_are_passed_over() {
    let roof = geometry("MultiSurface", "\"2\"", &format!("[{SURFACES}]"), "[2,0,0]");
    let objects = format!(
        r#""R":{},"H":{},"S":{}"#,
        object("Road", "", &roof),
        object("Building", "", &roof),
        object("+Shed", "", &roof)
    );
    let found = building(Format::CityJson, &city("1.0", &objects));
    assert_eq!((found.index, found.name.as_str()), (0, "H"));
}

#[test]
fn an_empty_surface_of_a_roof_refuses_its_building() {
    let of = |values: &str| {
        let roof = geometry("MultiSurface", "\"2\"", &format!("[[],{SURFACES}]"), values);
        city("2.0", &format!(r#""H":{}"#, object("Building", "", &roof)))
    };
    let detail = refused(Format::CityJson, &of("[0,2,0,0]"));
    assert!(detail.contains("surface 0") && detail.contains("empty"), "{detail}");
    // what is no roof may be as it likes
    is_the_gable_roof(&building(Format::CityJson, &of("[2,2,0,0]")));
}

#[test]
fn the_halves_of_a_roof_may_be_in_two_geometries_of_one_lod() {
    let half = |lod: &str, values: &str| geometry("MultiSurface", lod, &format!("[{SURFACES}]"), values);
    let coarse = geometry("MultiSurface", "\"2.0\"", "[[[6,7,8,9]]]", "[0]");
    let both = [half("\"2.2\"", "[2,0,2]"), coarse, half("\"2.2\"", "[2,2,0]"), half("\"3\"", "[2,2,2]")].join(",");
    let text = city("2.0", &format!(r#""H":{}"#, object("Building", "", &both)));
    is_the_gable_roof(&building(Format::CityJson, &text));
}

#[test]
fn an_empty_roof_of_a_higher_lod_does_not_hide_a_good_one() {
    let text = model(&house(&(roof(2, &(polygon(SOUTH) + &polygon(NORTH))) + &roof(3, ""))));
    is_the_gable_roof(&building(Format::CityGml, &text));
}

#[test]
fn how_far_a_roof_is_off_its_points_is_read_where_it_is_stated() {
    let roof = geometry("MultiSurface", "\"2.2\"", &format!("[{SURFACES}]"), "[2,0,0]");
    for (attributes, expected) in [
        (r#"{"b3_rmse_lod12":2.5,"b3_rmse_lod22":0.31}"#, Some(0.31)),
        (r#"{"rf_rmse_lod22":0.4}"#, Some(0.4)),
        (r#"{"b3_rmse_lod22":null}"#, None),
        (r#"{"b3_rmse_lod22":"good"}"#, None),
        (r#"{"b3_rmse_lod22":-1}"#, None),
        ("null", None),
    ] {
        let more = format!(r#","attributes":{attributes}"#);
        let of_building = city("2.0", &format!(r#""H":{}"#, object("Building", &more, &roof)));
        assert_eq!(building(Format::CityJson, &of_building).roof_rmse_m, expected, "{attributes}");
        let more = format!(r#"{more},"parents":["H"]"#);
        let of_part = format!(r#""P":{},"H":{}"#, object("BuildingPart", &more, &roof), object("Building", "", ""));
        assert_eq!(building(Format::CityJson, &city("2.0", &of_part)).roof_rmse_m, expected, "{attributes}");
    }
}

#[test]
fn sequences_may_follow_each_other_in_one_file() {
    let lines = |east: u32, epsg: u32, name: &str, objects: bool| {
        let roof = geometry("MultiSurface", "\"2\"", &format!("[{SURFACES}]"), "[2,0,0]");
        let house = format!(r#""{name}":{}"#, object("Building", "", &roof));
        let header = format!(
            r#""type":"CityJSON","version":"2.0","transform":{{"scale":[1,1,1],"translate":[{east},5645000,0]}},"metadata":{{"referenceSystem":"EPSG:{epsg}"}}"#
        );
        let content = format!(r#""CityObjects":{{{house}}},"vertices":{VERTICES}"#);
        match objects {
            true => format!("{{{header},{content}}}\n"),
            false => format!(
                "{{{header},\"CityObjects\":{{}},\"vertices\":[]}}\n{{\"type\":\"CityJSONFeature\",{content}}}\n"
            ),
        }
    };
    // the last one is a whole CityJSON in one line
    let text = [lines(356_000, 25832, "a", false), lines(156_000, 25833, "b", false), lines(56_000, 7415, "c", true)];
    let found: Vec<(String, String, f64)> = items(Format::CityJsonSeq, text.concat().as_bytes())
        .unwrap()
        .into_iter()
        .map(|item| match item {
            Item::Building(found) => {
                let west = found.edges.iter().flat_map(|edge| [edge.start[0], edge.end[0]]).fold(f64::MAX, f64::min);
                (found.name, found.crs.unwrap().to_string(), west)
            }
            Item::Refused(refused) => panic!("{refused:?}"),
        })
        .collect();
    let expected = [("a", "EPSG:25832", 356e3), ("b", "EPSG:25833", 156e3), ("c", "EPSG:7415", 56e3)];
    assert_eq!(found, expected.map(|(name, crs, west)| (name.to_owned(), crs.to_owned(), west)));
    // of a header that cannot be read nothing after it can be
    let bad = text[0].clone() + "{\"type\":\"CityJSON\",\"version\":\"0.9\"}\n" + &text[1];
    assert!(items(Format::CityJsonSeq, bad.as_bytes()).unwrap_err().to_string().contains("0.9"));
}
