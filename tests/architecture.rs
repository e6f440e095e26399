//! Data flows through the rooms one way. This reads the paths in the sources and holds the direction.
//!
//! Tests within the rooms are left out: a test may know whatever shows that its room is right.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]

use std::fs::read_dir;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};

/// A room, and which of the rooms before it it may use.
struct Room(&'static str, &'static [&'static str]);

/// All rooms, in the order of `src/lib.rs`. `main.rs` only calls the last of them.
const ROOMS: &[Room] = &[
    Room("geometry", &[]),
    Room("estimation", &["geometry"]),
    Room("features", &["geometry"]),
    Room("scenes", &["geometry", "estimation", "features"]),
    Room("orientation", &["geometry", "estimation", "features", "scenes"]),
    Room("learning", &[]),
    Room("diagnosis", &["geometry", "estimation", "features", "orientation", "learning"]),
    Room("interior", &["geometry", "estimation", "features", "diagnosis"]),
    Room(
        "pipeline",
        &["geometry", "estimation", "features", "scenes", "orientation", "learning", "diagnosis", "interior"],
    ),
    Room("classifiers", &["geometry", "learning", "diagnosis", "pipeline"]),
    Room("simulation", &["geometry", "features", "scenes", "interior", "orientation", "pipeline"]),
    Room(
        "study",
        &[
            "geometry",
            "estimation",
            "features",
            "orientation",
            "learning",
            "diagnosis",
            "interior",
            "pipeline",
            "classifiers",
            "simulation",
        ],
    ),
    Room("imagery", &["features"]),
    Room("buildings", &[]),
    Room("geoids", &["geometry"]),
    Room("cameras", &["geometry"]),
    Room("database", &[]),
    Room("control", &["geometry", "scenes", "orientation", "pipeline", "buildings", "database"]),
    Room("flight", &["geometry"]),
    Room("exports", &["geometry"]),
    Room("orthos", &["features"]),
    Room("store", &["geometry", "database"]),
    Room("report", &["geometry", "features", "orientation", "diagnosis", "interior", "pipeline", "classifiers"]),
    Room(
        "jobs",
        &[
            "geometry",
            "estimation",
            "features",
            "scenes",
            "interior",
            "orientation",
            "learning",
            "diagnosis",
            "interior",
            "pipeline",
            "classifiers",
            "imagery",
            "cameras",
            "database",
            "control",
            "store",
            "exports",
            "report",
        ],
    ),
    Room("webhooks", &["store"]),
    Room("configuration", &["learning", "diagnosis", "imagery", "store", "webhooks"]),
    Room("web", &[]),
    Room(
        "http",
        &[
            "web",
            "exports",
            "geometry",
            "features",
            "scenes",
            "interior",
            "learning",
            "diagnosis",
            "interior",
            "pipeline",
            "classifiers",
            "imagery",
            "cameras",
            "database",
            "buildings",
            "control",
            "flight",
            "store",
            "report",
            "jobs",
            "webhooks",
            "configuration",
        ],
    ),
    Room("service", &["store", "jobs", "webhooks", "configuration", "http"]),
    Room(
        "cli",
        &[
            "geometry",
            "features",
            "scenes",
            "orientation",
            "learning",
            "diagnosis",
            "interior",
            "pipeline",
            "classifiers",
            "simulation",
            "study",
            "imagery",
            "buildings",
            "geoids",
            "cameras",
            "database",
            "control",
            "exports",
            "orthos",
            "store",
            "report",
            "jobs",
            "webhooks",
            "configuration",
            "http",
            "service",
        ],
    ),
];

/// The rooms that are nothing but computing: the same input always gives the same output.
const PURE: &[&str] =
    &["geometry", "estimation", "features", "scenes", "interior", "orientation", "learning", "diagnosis"];

/// What a pure room does not know: files, clocks, the process, databases, HTTP, asynchrony and forms of exchange.
const IMPURE: &[&[&str]] = &[
    &["std", "fs"],
    &["std", "time"],
    &["std", "net"],
    &["std", "env"],
    &["std", "process"],
    &["tokio"],
    &["sqlx"],
    &["axum"],
    &["chrono"],
    &["serde"],
    &["serde_json"],
    &["utoipa"],
];

type Name = Vec<String>;

/// All paths in a source, such as `crate::geometry::Camera`, wherever they stand; the braces of `use` multiplied out,
/// comments, strings and `#[cfg(test)]` modules left out. `depth` is the number of modules around the tokens.
/// A path that leads up to the crate by `super` is given as one that begins with `crate`.
fn paths(tokens: TokenStream, depth: usize) -> Vec<Name> {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        match &tokens[at] {
            TokenTree::Ident(word) if word == "mod" => {
                if let Some(TokenTree::Group(body)) = tokens.get(at + 2) {
                    if !for_tests_only(&tokens[..at]) {
                        found.extend(paths(body.stream(), depth + 1));
                    }
                    at += 2;
                }
            }
            TokenTree::Ident(_) => {
                let (names, length) = path(&tokens[at..]);
                found.extend(names.into_iter().map(|name| from_crate(name, depth)));
                // the generic arguments and groups after a path are read on their own
                at += length - 1;
            }
            TokenTree::Group(group) => found.extend(paths(group.stream(), depth)),
            TokenTree::Punct(_) | TokenTree::Literal(_) => {}
        }
        at += 1;
    }
    found
}

/// Whether `#[cfg(test)]` is among the attributes right before.
fn for_tests_only(before: &[TokenTree]) -> bool {
    let belongs = |token: &&TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() != Delimiter::Brace,
        TokenTree::Punct(mark) => mark.as_char() == '#',
        TokenTree::Ident(word) => word == "pub",
        TokenTree::Literal(_) => false,
    };
    before.iter().rev().take_while(belongs).any(|token| token.to_string().replace(' ', "") == "[cfg(test)]")
}

/// The path or tree of paths at the beginning of `tokens`, and how many of the tokens it takes.
fn path(tokens: &[TokenTree]) -> (Vec<Name>, usize) {
    let TokenTree::Ident(first) = &tokens[0] else {
        return (Vec::new(), 1);
    };
    let first = first.to_string();
    let prefixed = |rest: Vec<Name>| rest.into_iter().map(|rest| [vec![first.clone()], rest].concat()).collect();
    match (tokens.get(1), tokens.get(2), tokens.get(3)) {
        (Some(TokenTree::Punct(a)), Some(TokenTree::Punct(b)), Some(next))
            if a.as_char() == ':' && a.spacing() == Spacing::Joint && b.as_char() == ':' =>
        {
            match next {
                TokenTree::Ident(_) => {
                    let (rest, length) = path(&tokens[3..]);
                    (prefixed(rest), length + 3)
                }
                TokenTree::Group(tree) if tree.delimiter() == Delimiter::Brace => {
                    (prefixed(branches(tree.stream())), 4)
                }
                _ => (vec![vec![first]], 1),
            }
        }
        _ => (vec![vec![first]], 1),
    }
}

/// The paths between the braces of a `use`.
fn branches(tokens: TokenStream) -> Vec<Name> {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let comma = |token: &TokenTree| matches!(token, TokenTree::Punct(mark) if mark.as_char() == ',');
    tokens.split(comma).filter(|branch| !branch.is_empty()).flat_map(|branch| path(branch).0).collect()
}

fn from_crate(name: Name, depth: usize) -> Name {
    let name = match name.first() {
        Some(first) if first == "self" => name[1..].to_vec(),
        _ => name,
    };
    let steps = name.iter().take_while(|part| *part == "super").count();
    if steps > 0 && steps >= depth {
        let mut up = vec![String::from("crate")];
        up.extend_from_slice(&name[steps..]);
        return up;
    }
    name
}

/// What a source of `room` uses that it may not, in words.
fn faults(room: &str, source: &str, depth: usize) -> Vec<String> {
    let allowed = ROOMS.iter().find(|Room(name, _)| *name == room).map(|Room(_, allowed)| *allowed);
    let Some(allowed) = allowed else {
        return vec![format!("the room {room} is not in the table of this test")];
    };
    let mut faults = Vec::new();
    for name in paths(source.parse().unwrap(), depth) {
        let written = name.join("::");
        if let [first, used, ..] = name.as_slice() {
            let own_or_allowed = used == room || allowed.contains(&used.as_str());
            if (first == "crate" || first == "gable") && !own_or_allowed {
                faults.push(format!("{room} must not use {used}: {written}"));
            }
        }
        let impure = |begin: &&[&str]| name.iter().zip(*begin).filter(|(a, b)| a == b).count() == begin.len();
        if PURE.contains(&room) && IMPURE.iter().any(impure) {
            faults.push(format!("{room} is pure and must not know {written}"));
        }
    }
    faults
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The modules that a file of `src` stands for: `store/keys.rs` is `["store", "keys"]`, `store/mod.rs` `["store"]`.
fn modules(file: &Path) -> Vec<String> {
    let mut modules: Vec<String> =
        file.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    modules.pop_if(|last| last == "mod");
    modules
}

#[test]
fn the_rooms_use_only_what_comes_before_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut all = Vec::new();
    let mut read = 0;
    for file in sources(&src) {
        let modules = modules(file.strip_prefix(&src).unwrap());
        let outside = ["main", "lib"].contains(&modules[0].as_str());
        if outside || modules.iter().any(|module| module == "tests") {
            continue;
        }
        read += 1;
        let text = std::fs::read_to_string(&file).unwrap();
        all.extend(
            faults(&modules[0], &text, modules.len()).into_iter().map(|fault| format!("{}: {fault}", file.display())),
        );
    }
    assert!(read > ROOMS.len(), "only {read} sources were found in {}", src.display());
    assert!(all.is_empty(), "{}", all.join("\n"));
}

#[test]
fn the_table_is_in_the_order_of_the_library_and_points_one_way() {
    let library = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let declared: Vec<&str> =
        library.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    let table: Vec<&str> = ROOMS.iter().map(|Room(name, _)| *name).collect();
    assert_eq!(declared, table);
    for (index, Room(name, allowed)) in ROOMS.iter().enumerate() {
        for used in *allowed {
            assert!(table[..index].contains(used), "{name} may use {used}, which does not come before it");
        }
    }
}

#[test]
fn a_violation_is_found_however_it_is_written() {
    let violations = [
        "use crate::store::Store;",
        "use crate::{geometry::Camera, store::{self, Store}};",
        "pub use crate::store;",
        "fn f(store: &crate::store::Store) {}",
        "fn f() { let a = matches!(x, Some(crate::store::StoreError::InUse { .. })); }",
        "use super::store::Store;",
        "mod inner { use super::super::store::Store; }",
        "use self::super::store::Store;",
        "use gable::store::Store;",
        "fn f(x: Vec<crate::store::Store>) {}",
    ];
    for violation in violations {
        let found = faults("estimation", violation, 1);
        let named = found.iter().all(|fault| fault.starts_with("estimation must not use store"));
        assert!(named && !found.is_empty(), "{violation}: {found:?}");
    }
    let impure = [
        "use std::fs::File;",
        "use std::{fmt, time::Instant};",
        "use serde::Serialize;",
        "fn now() -> f64 { std::time::Instant::now() }",
        "#[derive(serde::Deserialize)] struct A;",
        "#[serde(default)] struct A;",
        "use tokio;",
    ];
    for violation in impure {
        let found = faults("estimation", violation, 1);
        assert_eq!(found.len(), 1, "{violation}: {found:?}");
        assert!(found[0].starts_with("estimation is pure"), "{found:?}");
        assert_eq!(faults("http", violation, 1), Vec::<String>::new(), "not pure, and so free to");
    }
    assert_eq!(faults("parlour", "", 1), ["the room parlour is not in the table of this test"]);
}

#[test]
fn what_is_no_violation_is_none() {
    let harmless = [
        "use crate::geometry::{Camera, rotation};",
        "use super::normal::Prior;", // in a folder's file, the room itself
        "//! As crate::store does.\n/// See [`crate::store::Store`].\nstruct A;",
        "fn f() -> &'static str { \"crate::store::Store and std::fs\" }",
        "#[cfg(test)] #[allow(unused)] pub(crate) mod tests { use crate::store::Store; use std::fs; }",
        "use std::fmt; fn f(time: f64) -> Vec<f64> { Vec::<f64>::new() }",
    ];
    for source in harmless {
        assert_eq!(faults("estimation", source, 2), Vec::<String>::new(), "{source}");
    }
}
