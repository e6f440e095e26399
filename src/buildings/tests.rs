//! Every dialect against the towns of `samples`, whose edges are known.

mod dialects;
mod hostile;
mod speed;

use std::io::BufReader;

use super::samples::{Sample, Town, write};
use super::*;

/// All items of a text.
fn items(format: Format, text: &[u8]) -> Result<Vec<Item>, ModelError> {
    items_within(format, text, &Limits::default())
}

fn items_within(format: Format, text: &[u8], limits: &Limits) -> Result<Vec<Item>, ModelError> {
    let mut items = Vec::new();
    // a buffer that ends everywhere
    let mut input = BufReader::with_capacity(777, text);
    read(format, &mut input, limits, &mut |item| {
        items.push(item);
        ControlFlow::Continue(())
    })?;
    Ok(items)
}

/// Edges with the smaller end first, in one order.
fn in_order(edges: &[RoofEdge]) -> Vec<RoofEdge> {
    let mut edges: Vec<RoofEdge> = edges
        .iter()
        .map(|edge| if edge.start > edge.end { RoofEdge { start: edge.end, end: edge.start, ..*edge } } else { *edge })
        .collect();
    edges.sort_by(|a, b| (a.kind, a.start, a.end).partial_cmp(&(b.kind, b.start, b.end)).unwrap());
    edges
}

#[test]
fn no_building_and_no_edge_is_lost_in_any_dialect() {
    for sample in Sample::ALL {
        let (mut text, mut truth) = (Vec::new(), Vec::new());
        let town = Town { seed: 7, buildings: 400 };
        write(sample, town, &mut text, &mut |building| truth.push(building.clone())).unwrap();
        assert_eq!(Format::recognise(&text[..2000], None), Some(sample.format()), "{sample:?}");
        let items = items(sample.format(), &text).unwrap();
        assert_eq!(items.len(), 400, "{sample:?}");
        for (index, (item, truth)) in items.iter().zip(&truth).enumerate() {
            let Item::Building(building) = item else { panic!("{sample:?}: {item:?}") };
            assert_eq!((building.index, &building.name), (index, &truth.name));
            assert_eq!(building.crs.as_deref(), Some(sample.crs()), "{sample:?}");
            let (found, expected) = (in_order(&building.edges), in_order(&truth.edges));
            assert_eq!(found.len(), expected.len(), "{sample:?} {index}: {found:?} {expected:?}");
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(found.kind, expected.kind, "{sample:?} {index}");
                let ends = found.start.iter().chain(&found.end).zip(expected.start.iter().chain(&expected.end));
                assert!(ends.into_iter().all(|(a, b)| (a - b).abs() < 1e-7), "{sample:?}: {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn reading_ends_where_it_is_told_to() {
    for sample in Sample::ALL {
        let mut text = Vec::new();
        write(sample, Town { seed: 1, buildings: 5 }, &mut text, &mut |_| {}).unwrap();
        let mut seen = 0;
        let read = read(sample.format(), &mut &text[..], &Limits::default(), &mut |_| {
            seen += 1;
            if seen == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert!(read.is_ok());
        assert_eq!(seen, 2, "{sample:?}");
    }
}

#[test]
fn codes_and_words_of_kinds_never_move() {
    let codes: Vec<u8> = EdgeKind::ALL.iter().map(|kind| kind.code()).collect();
    assert_eq!(codes, [1, 2, 3, 4, 5, 6]);
    for kind in EdgeKind::ALL {
        assert_eq!(EdgeKind::from_code(kind.code()), Some(kind));
    }
    assert_eq!(EdgeKind::from_code(0), None);
    assert_eq!(EdgeKind::ALL.map(EdgeKind::name), ["eave", "ridge", "gable", "hip", "valley", "rim"]);
    assert_eq!(EdgeKind::ALL.map(|kind| EdgeKind::from_name(kind.name())), EdgeKind::ALL.map(Some));
    assert_eq!(EdgeKind::from_name("Eave"), None);
}

#[test]
fn formats_are_recognised_by_what_they_hold() {
    let of = |text: &str, name| Format::recognise(text.as_bytes(), name);
    assert_eq!(of("\u{feff}<?xml version=\"1.0\"?>", None), Some(Format::CityGml));
    assert_eq!(of("{\n  \"type\": \"CityJSON\"", Some("a.city.json")), Some(Format::CityJson));
    assert_eq!(of("{\"type\":\"CityJSON\"}\n{\"type\":", None), Some(Format::CityJsonSeq));
    assert_eq!(of("{\"type\":\"CityJSON\"", Some("a.city.jsonl")), Some(Format::CityJsonSeq));
    assert_eq!(of("PK\u{3}\u{4}", Some("a.gml")), None);
    assert_eq!(of("", None), None);
}
