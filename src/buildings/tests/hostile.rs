//! Files that are broken, or made to break the reader.

use std::io::Read;

use proptest::prelude::*;

use super::*;

fn error(format: Format, text: impl AsRef<[u8]>) -> String {
    match items(format, text.as_ref()) {
        Ok(items) => panic!("{items:?}"),
        Err(error) => error.to_string(),
    }
}

/// The details of what was refused.
fn details(format: Format, text: impl AsRef<[u8]>) -> Vec<String> {
    let detail = |item| match item {
        Item::Refused(refused) => Some(refused.detail),
        Item::Building(_) => None,
    };
    items(format, text.as_ref()).unwrap().into_iter().filter_map(detail).collect()
}

fn sample(sample: Sample, buildings: u64) -> String {
    let mut text = Vec::new();
    write(sample, Town { seed: 7, buildings }, &mut text, &mut |_| {}).unwrap();
    String::from_utf8(text).unwrap()
}

/// A CityGML file with one building whose roof has the given ring.
fn gml(ring: &str) -> String {
    let text = sample(Sample::NrwCityGml2, 1);
    let roof = text.find("RoofSurface").unwrap();
    let start = roof + text[roof..].find("<gml:posList>").unwrap() + "<gml:posList>".len();
    let end = start + text[start..].find('<').unwrap();
    format!("{}{ring}{}", &text[..start], &text[end..])
}

/// A sequence of three features of which the middle one is replaced.
fn sequence(middle: &str) -> String {
    let text = sample(Sample::CityJsonSeq, 3);
    let mut lines: Vec<&str> = text.lines().collect();
    lines[2] = middle;
    lines.join("\n")
}

#[track_caller]
fn says(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "\"{word}\" is not in \"{text}\"");
    }
}

#[test]
fn entities_and_document_types_are_refused() {
    let laughs = "<!DOCTYPE a [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;&a;&a;\">]><a>&b;</a>";
    says(&error(Format::CityGml, laughs), &["DOCTYPE", "line 1"]);
    let external = "<?xml version=\"1.0\"?>\n<!DOCTYPE a SYSTEM \"file:///etc/passwd\"><a/>";
    says(&error(Format::CityGml, external), &["DOCTYPE", "line 2"]);
    says(&error(Format::CityGml, "<a>\n&laugh;</a>"), &["&laugh;", "line 2", "&amp;"]);
    let in_attribute = sample(Sample::NrwCityGml2, 1).replace("gml:id=\"DENW", "gml:id=\"&lol;DENW");
    says(&error(Format::CityGml, in_attribute), &["&lol;"]);
    let known = sample(Sample::NrwCityGml2, 1).replace("gml:id=\"DENW", "gml:id=\"a&amp;&#x62;DENW");
    let items = items(Format::CityGml, known.as_bytes()).unwrap();
    assert!(matches!(&items[0], Item::Building(building) if building.name.starts_with("a&bDENW")), "{items:?}");
}

#[test]
fn depth_is_bounded() {
    says(&error(Format::CityGml, "<a>".repeat(100_000)), &["more than 100 elements"]);
    for text in [
        format!("{{\"x\":{}", "[".repeat(100_000)),
        format!("{{\"CityObjects\":{{\"H\":{}", "[".repeat(100_000)),
        format!("{{\"vertices\":{}", "[".repeat(100_000)),
        format!("{{\"version\":{}", "[".repeat(100_000)),
    ] {
        error(Format::CityJson, &text);
        error(Format::CityJsonSeq, &text);
    }
    let deep = format!("{{\"type\":{}", "{\"a\":".repeat(100_000));
    says(&details(Format::CityJsonSeq, sequence(&deep))[0], &["line 3"]);
}

#[test]
fn one_large_thing_is_bounded() {
    let limits = Limits { building_bytes: 10_000, ..Limits::default() };
    let large = "x".repeat(100_000);
    for text in [
        format!("<a b=\"{large}\"/>"),
        format!("<a>{large}</a>"),
        format!("<a><!--{large}--></a>"),
        format!("<{large}"),
    ] {
        let error = items_within(Format::CityGml, text.as_bytes(), &limits).unwrap_err();
        assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
    }
    for text in [format!("{{\"type\":\"{large}\"}}"), format!("{{\"CityObjects\":{{\"H\":{{\"a\":\"{large}\"}}}}}}")] {
        let error = items_within(Format::CityJson, text.as_bytes(), &limits).unwrap_err();
        assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
    }
    let items = items_within(Format::CityJsonSeq, sequence(&large).as_bytes(), &limits).unwrap();
    assert_eq!(items.len(), 3);
    let Item::Refused(refused) = &items[1] else { panic!("{items:?}") };
    says(&refused.detail, &["line 3", "10000 bytes"]);
    // many small things in one building
    let filler = "<gen:a/>".repeat(5_000);
    let text = sample(Sample::NrwCityGml2, 2);
    let text = text.replacen("<bldg:measuredHeight", &format!("{filler}<bldg:measuredHeight"), 1);
    let items = items_within(Format::CityGml, text.as_bytes(), &limits).unwrap();
    let Item::Refused(refused) = &items[0] else { panic!("{items:?}") };
    says(&refused.detail, &["larger than 10000 bytes"]);
    assert!(matches!(items[1], Item::Building(_)));
}

/// A file of a gigabyte that is never in memory: its one attribute does not end.
#[test]
fn a_gigabyte_in_one_attribute_is_refused_early() {
    let mut endless = BufReader::new("<a b=\"".as_bytes().chain(std::io::repeat(b'x')));
    let error =
        read(Format::CityGml, &mut endless, &Limits::default(), &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
    let mut endless = BufReader::new("{\"type\":\"".as_bytes().chain(std::io::repeat(b'x')));
    let error =
        read(Format::CityJson, &mut endless, &Limits::default(), &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
}

#[test]
fn what_is_cut_off_is_said_and_what_came_before_was_read() {
    for kind in [Sample::NrwCityGml2, Sample::CityJsonSeq] {
        let text = sample(kind, 3);
        let mut seen = 0;
        let cut = &text.as_bytes()[..text.len() - 300];
        let read = read(kind.format(), &mut &cut[..], &Limits::default(), &mut |item| {
            seen += usize::from(matches!(item, Item::Building(_)));
            ControlFlow::Continue(())
        });
        assert_eq!(seen, 2, "{kind:?}");
        // of a sequence the last line is lost, and said to be; the file as a whole is well
        assert_eq!(read.is_ok(), kind == Sample::CityJsonSeq);
    }
    let text = sample(Sample::NrwCityGml2, 1);
    says(&error(Format::CityGml, &text[..text.len() - 300]), &["cut off"]);
    let text = sample(Sample::CityJson, 2);
    says(&error(Format::CityJson, &text[..text.len() - 30]), &["EOF", "line 1"]);
}

#[test]
fn other_files_are_refused_with_what_they_are() {
    says(&error(Format::CityGml, "<kml xmlns=\"http://earth.google.com/kml/2.1\"/>"), &["<kml>", "CityModel"]);
    says(&error(Format::CityGml, "<CityModel xmlns=\"http://www.opengis.net/citygml/2.0\"/>"), &["no building"]);
    says(&error(Format::CityGml, "hello"), &["line 1"]);
    says(&error(Format::CityGml, ""), &["no element"]);
    says(&error(Format::CityGml, "<a><b></a>"), &["</b>"]);
    says(&error(Format::CityGml, "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><a/>"), &["ISO-8859-1", "UTF-8"]);
    says(&error(Format::CityGml, b"<a>\n\xff\xfe</a>"), &["line 2", "UTF-8"]);
    for format in [Format::CityJson, Format::CityJsonSeq] {
        says(
            &error(format, "{\"type\":\"FeatureCollection\",\"version\":\"2.0\"}"),
            &["FeatureCollection", "CityJSON"],
        );
        says(&error(format, "{\"type\":\"CityJSON\",\"version\":\"0.9\"}"), &["0.9", "2.0"]);
        says(
            &error(format, "{\"type\":\"CityJSON\",\"version\":\"2.0\",\"CityObjects\":{},\"vertices\":[]}"),
            &["no building"],
        );
        error(format, "[1,2]");
        error(format, "{\"type\":1}");
        error(format, b"{\"type\":\"\xff\"}");
    }
    assert!(matches!(items(Format::CityJsonSeq, b""), Err(ModelError::NoBuilding)));
}

#[test]
fn wrong_rings_and_coordinates_refuse_their_building() {
    for (ring, words) in [
        ("0 0 5 9 0 5 9 9 5 0 9 5", &["not closed", "[0.0, 0.0, 5.0]"][..]),
        ("0 0 5 9 0 5 0 0 5", &["2 different points", "at least three"]),
        ("0 0 5", &["one point"]),
        ("", &["no points"]),
        ("0 0 5 9 0 5 9 9 5 0 9 5 0 0", &["14 numbers"]),
        ("0 0 NaN 9 0 5 9 9 5 0 0 NaN", &["\"NaN\"", "line"]),
        ("0 0 1e400 9 0 5 9 9 5 0 0 1e400", &["\"1e400\""]),
        ("0 0 five 9 0 5 9 9 5 0 0 5", &["\"five\""]),
        ("0 0 &lt; 9 0 5 9 9 5 0 0 5", &["\"&\""]),
    ] {
        let found = details(Format::CityGml, gml(ring));
        says(&found[0], words);
        says(&found[0], &["the building that begins in line"]);
    }
    let long = "1 2 3 ".repeat(600_000);
    says(&details(Format::CityGml, gml(&long))[0], &["more than 500000 points"]);
    let flat = gml("0 0 9 0 9 9 0 0").replace("<gml:LinearRing>", "<gml:LinearRing srsDimension=\"2\">");
    says(&details(Format::CityGml, flat)[0], &["srsDimension"]);
}

#[test]
fn a_polygon_whose_ring_is_not_read_refuses_its_building() {
    let straight = gml("0 0 5 9 0 5 9 9 5 0 0 5");
    let roof = &straight[straight.find("RoofSurface").unwrap()..];
    let ring = &roof[roof.find("<gml:LinearRing").unwrap()..];
    let ring = &ring[..ring.find("</gml:LinearRing>").unwrap() + "</gml:LinearRing>".len()];
    let curves = "<gml:Ring><gml:curveMember><gml:LineString><gml:posList>0 0 5</gml:posList></gml:LineString>\
                  </gml:curveMember></gml:Ring>";
    for (instead, words) in [(curves, &["gml:Ring", "LinearRing"][..]), ("", &["no ring", "LinearRing"])] {
        says(&details(Format::CityGml, straight.replacen(ring, instead, 1))[0], words);
    }
}

#[test]
fn references_in_circles_and_to_what_is_there_twice_are_refused() {
    let circle = |inner: &str| {
        gml("0 0 5 9 0 5 9 9 5 0 9 5 0 0 5").replacen(
            "<gml:MultiSurface>",
            &format!("<gml:MultiSurface gml:id=\"m\">{inner}"),
            9,
        )
    };
    let found = details(Format::CityGml, circle("<gml:surfaceMember xlink:href=\"#m\"/>"));
    assert!(found[0].contains("itself") || found[0].contains("several"), "{found:?}");
    let found = details(Format::CityGml, circle("<gml:surfaceMember xlink:href=\"other.gml#m\"/>"));
    says(&found[0], &["other.gml#m", "within the file"]);
}

/// As a billion laughs, with references: ten to each next, and nothing at the end.
#[test]
fn references_that_multiply_are_refused() {
    let level = |at: u32| {
        let next = format!("<gml:surfaceMember xlink:href=\"#l{}\"/>", at + 1).repeat(10);
        format!(
            "<gml:surfaceMember><gml:CompositeSurface gml:id=\"l{at}\">{next}</gml:CompositeSurface></gml:surfaceMember>"
        )
    };
    let levels: String = (0..12).map(level).collect();
    let end = "<gml:surfaceMember><gml:CompositeSurface gml:id=\"l12\"/></gml:surfaceMember>";
    let text = gml("0 0 5 9 0 5 9 9 5 0 0 5").replacen(
        "<gml:CompositeSurface>",
        &format!("<gml:CompositeSurface>{levels}{end}"),
        1,
    );
    let roof = text.find("RoofSurface").unwrap();
    let (before, after) = text.split_at(roof);
    let after = after.replacen("<gml:MultiSurface>", "<gml:MultiSurface><gml:surfaceMember xlink:href=\"#l0\"/>", 1);
    says(&details(Format::CityGml, before.to_owned() + &after)[0], &["multiply"]);
}

/// Ten thousand long sides over ten thousand points: a hundred million pieces.
#[test]
fn a_comb_of_sides_does_not_fill_the_memory() {
    let mut surfaces = roof::Surfaces::default();
    for at in 0..10_000 {
        for point in [[f64::from(at), 0.0, 5.0], [20_000.0 + f64::from(at), 0.0, 5.0], [0.0, 50.0 + f64::from(at), 9.0]]
        {
            surfaces.point(point);
        }
        surfaces.end_ring();
        surfaces.end_polygon();
    }
    assert!(matches!(roof::edges(&surfaces, false), Err(error) if error.to_string().contains("too intricate")));
}

#[test]
fn a_bad_line_of_a_sequence_loses_no_other() {
    let good = sample(Sample::CityJsonSeq, 3);
    let line = good.lines().nth(2).unwrap();
    let number = |text: &str| text.replacen("\"vertices\":[[", "\"vertices\":[[1e400,1,1],[", 1);
    let (objects, vertices) = line.split_once("\"vertices\"").unwrap();
    let far = format!("{objects}\"vertices\"{}", vertices.replace("],[", "],[3e300,1,1],["));
    for (middle, words) in [
        ("{", &["line 3", "EOF"][..]),
        ("nonsense", &["line 3", "column"]),
        ("{\"type\":\"Feature\",\"CityObjects\":{},\"vertices\":[]}", &["\"Feature\"", "CityJSONFeature"]),
        ("{\"type\":\"CityJSONFeature\",\"CityObjects\":[],\"vertices\":[]}", &["CityObjects"]),
        (&*number(line), &["number out of range"]),
        (&*line.replacen("\"vertices\":[[", "\"vertices\":[[\"1\",2,3],[", 1), &["invalid type: string"]),
        (&*line.replacen("\"vertices\":[[", "\"vertices\":[[1,2],[", 1), &["array of length 3"]),
        (&*line.replacen("\"vertices\":[[", "\"vertices\":[[NaN,2,3],[", 1), &["line 3"]),
        (&*far, &["e297", "within"]),
        (&*line.replace("\"Solid\"", "\"MultiSurface\""), &["LoD 2.2", "4 deep", "3 are right"]),
        (&*line.replace("\"Solid\"", "\"MultiSolid\""), &["LoD 2.2", "at depth 4", "expected at depth 5"]),
        (&*line.replace("]],[[", "]],[[99999,"), &["vertex 99999", "there are"]),
        (&*line.replace("\"boundaries\":[[[[", "\"boundaries\":[[[[-1,"), &["a negative number"]),
        (&*line.replace("\"boundaries\":[[[[", "\"boundaries\":[[[[1.5,"), &["not whole"]),
        (&*line.replace("\"boundaries\":[[[[", "\"boundaries\":[[[[\"1\","), &["a text"]),
        (&*line.replace("\"boundaries\":[[[[", "\"boundaries\":[[[[9999999999,"), &["too large"]),
        (&*line.replace("\"values\":[[0,", "\"values\":[["), &["one value"]),
        (&*line.replace("\"values\":[[0,", "\"values\":[[17,"), &["refers to surface 17"]),
        (&*line.replace("\"values\":[[0,", "\"values\":[[{},"), &["an object"]),
        (&*line.replace("Solid", "GeometryInstance"), &["template"]),
        (&*line.replace("RoofSurface", "WallSurface"), &["no surface with the semantics RoofSurface"]),
    ] {
        let items = items(Format::CityJsonSeq, sequence(middle).as_bytes()).unwrap();
        let kinds: Vec<bool> = items.iter().map(|item| matches!(item, Item::Building(_))).collect();
        assert_eq!(kinds, [true, false, true], "{words:?}");
        let Item::Refused(refused) = &items[1] else { panic!("{middle}") };
        assert_eq!(refused.index, 1);
        says(&refused.detail, words);
    }
    let invalid = sequence("@@").replace("@@", "@").into_bytes();
    let invalid: Vec<u8> = invalid.into_iter().map(|byte| if byte == b'@' { 0xff } else { byte }).collect();
    says(&details(Format::CityJsonSeq, invalid)[0], &["UTF-8", "line 3"]);
}

#[test]
fn families_without_end_and_names_that_occur_twice_are_refused() {
    let city = |objects: &str| {
        format!("{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"CityObjects\":{{{objects}}},\"vertices\":[]}}")
    };
    let part =
        |name: &str, parent: &str| format!("\"{name}\":{{\"type\":\"BuildingPart\",\"parents\":[\"{parent}\"]}}");
    let circle = details(Format::CityJson, city(&format!("{},{}", part("a", "b"), part("b", "a"))));
    assert_eq!(circle.len(), 2);
    says(&circle[0], &["circle"]);
    says(&details(Format::CityJson, city(&part("a", "a")))[0], &["circle"]);
    says(&details(Format::CityJson, city(&part("a", "gone")))[0], &["\"gone\""]);
    let twice = "\"a\":{\"type\":\"Building\"},\"a\":{\"type\":\"Building\"}";
    says(&details(Format::CityJson, city(twice))[1], &["occurs earlier"]);
    // and one that cannot be read does not lose the others
    let bad = "\"x\":{\"type\":7},\"a\":{\"type\":\"Building\"}";
    let found = details(Format::CityJson, city(bad));
    assert_eq!(found.len(), 2);
    says(&found[0], &["line 1", "invalid type"]);
}

#[test]
fn what_strangers_write_is_cut_where_it_is_refused() {
    let long = "ä".repeat(100_000);
    let members = format!("\"{long}\":{{\"type\":\"Building\"}}");
    let bad = format!("\"x\":{{\"type\":\"Building\",\"geometry\":\"{long}\"}}");
    let of = |objects: &str| format!("\"CityObjects\":{{{objects}}},\"vertices\":[]}}");
    let whole = format!("{{\"type\":\"CityJSON\",\"version\":\"2.0\",{}", of(&format!("{members},{bad}")));
    let feature = |objects: &str| format!("{{\"type\":\"CityJSONFeature\",{}", of(objects));
    let xml = gml("0 0 5").replace("gml:id=\"DENW", &format!("gml:id=\"{long}"));
    for (format, text) in [
        (Format::CityJson, whole),
        (Format::CityJsonSeq, sequence(&feature(&members))),
        (Format::CityJsonSeq, sequence(&feature(&bad))),
        (Format::CityGml, xml),
    ] {
        let refused: Vec<Refused> = items(format, text.as_bytes())
            .unwrap()
            .into_iter()
            .filter_map(|item| if let Item::Refused(refused) = item { Some(refused) } else { None })
            .collect();
        assert!(!refused.is_empty());
        for refused in refused {
            assert!(refused.detail.chars().count() <= 300, "{}", refused.detail);
            assert!(refused.name.is_none_or(|name| name.chars().count() <= 200));
        }
    }
    let detail = &details(Format::CityJsonSeq, sequence(&feature(&members)))[0];
    says(detail, &["line 3", "more than 200 characters"]);
    assert!(error(Format::CityJson, format!("{{\"type\":{{\"{long}\":1}}}}")).chars().count() < 400);
}

#[test]
fn children_without_end_are_refused_and_of_parents_the_first_counts() {
    let city = |objects: &str| {
        format!("{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"CityObjects\":{{{objects}}},\"vertices\":[]}}")
    };
    let children = |count: usize| vec!["\"c\""; count].join(",");
    let with = |count| format!("\"a{count}\":{{\"type\":\"Building\",\"children\":[{}]}}", children(count));
    let found = details(Format::CityJson, city(&format!("{},{}", with(10_001), with(10_000))));
    assert_eq!(found.len(), 2);
    says(&found[0], &["more than 10000 children"]);
    says(&found[1], &["RoofSurface"]);
    let limits = Limits { file_objects: 15, ..Limits::default() };
    let error = items_within(Format::CityJson, city(&format!("{},{}", with(9), with(8))).as_bytes(), &limits);
    says(&error.unwrap_err().to_string(), &["more than 15 children"]);
    let part = "\"p\":{\"type\":\"BuildingPart\",\"parents\":[\"h\",\"gone\",7]},\"h\":{\"type\":\"Building\"}";
    assert_eq!(details(Format::CityJson, city(part)).len(), 1);
}

#[test]
fn files_with_too_much_are_refused() {
    let limits = Limits { file_vertices: 10, ..Limits::default() };
    let error = items_within(Format::CityJson, sample(Sample::CityJson, 3).as_bytes(), &limits).unwrap_err();
    says(&error.to_string(), &["more than 10 vertices", "CityJSONSeq"]);
    let limits = Limits { file_objects: 2, ..Limits::default() };
    let error = items_within(Format::CityJson, sample(Sample::CityJson, 3).as_bytes(), &limits).unwrap_err();
    says(&error.to_string(), &["more than 2 buildings"]);
}

/// What may be put in place of a part of a file.
fn piece() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..8),
        prop::sample::select(vec![
            "[", "]", "{", "}", "\"", "<", ">", "</", "/>", "&", "#", ",", "-1", "1e400", "null", "NaN", " 0 0 0 "
        ])
        .prop_map(|text| text.as_bytes().to_vec()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases.max(300), ..ProptestConfig::default() })]

    #[test]
    fn no_change_of_a_file_makes_the_reader_panic(
        which in prop::sample::select(Sample::ALL.to_vec()),
        changes in prop::collection::vec((any::<prop::sample::Index>(), 0_usize..40, piece()), 1..6),
    ) {
        let mut text = sample(which, 3).into_bytes();
        for (at, length, piece) in changes {
            let start = at.index(text.len());
            let end = (start + length).min(text.len());
            text.splice(start..end, piece);
        }
        for format in [which.format(), Format::CityGml, Format::CityJson, Format::CityJsonSeq] {
            let _ = items(format, &text);
        }
        let _ = Format::recognise(&text, None);
    }

    #[test]
    fn no_roof_makes_it_panic(
        points in prop::collection::vec(prop::array::uniform3(-3_i8..3), 3..40),
        cuts in prop::collection::vec(any::<bool>(), 40),
    ) {
        let mut surfaces = roof::Surfaces::default();
        for (at, point) in points.iter().enumerate() {
            surfaces.point(point.map(|value| f64::from(value) * 0.4));
            if cuts[at] && at % 3 == 2 || at + 1 == points.len() {
                surfaces.end_ring();
                if at % 2 == 0 || at + 1 == points.len() {
                    surfaces.end_polygon();
                }
            }
        }
        if let Ok(edges) = roof::edges(&surfaces, false) {
            for edge in edges {
                prop_assert!(surfaces.points().contains(&edge.start) && surfaces.points().contains(&edge.end));
            }
        }
    }
}
