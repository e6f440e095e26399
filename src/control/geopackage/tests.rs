//! GeoPackages made by SQLite, and what strangers make of them.

mod hostile;

use std::path::PathBuf;

use serde_json::{Value, json};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode};

use super::*;
use crate::buildings::EdgeKind;
use crate::control::points::Import;
use crate::control::tests::{collection, database, reading as geojson_reading};
use crate::control::{FileFormat, Rejection, StoredControlPoint, Use, points};
use crate::geometry::Crs;

type Point = [f64; 3];

/// How a geometry is written.
#[derive(Debug, Clone, Copy)]
struct Written {
    little_endian: bool,
    /// With the flags of EWKB, and a number of a CRS.
    extended: bool,
    /// Of the header: its code and its bytes.
    envelope: (u8, usize),
    /// Numbers of a position.
    dimensions: u32,
}

const LITTLE: Written = Written { little_endian: true, extended: false, envelope: (0, 0), dimensions: 3 };
const BIG: Written = Written { little_endian: false, envelope: (2, 48), ..LITTLE };
const EXTENDED: Written = Written { extended: true, envelope: (1, 32), ..LITTLE };

impl Written {
    fn number(self, number: u32) -> [u8; 4] {
        if self.little_endian { number.to_le_bytes() } else { number.to_be_bytes() }
    }

    fn blob(self, wkb: &[u8]) -> Vec<u8> {
        let mut blob = vec![b'G', b'P', 0, u8::from(self.little_endian) | self.envelope.0 << 1];
        blob.extend(self.number(25832));
        blob.extend(vec![0; self.envelope.1]);
        blob.extend(wkb);
        blob
    }

    fn head(self, kind: u32) -> Vec<u8> {
        let mut bytes = vec![u8::from(self.little_endian)];
        let iso = match self.dimensions {
            2 => 0,
            3 => 1_000,
            _ => 3_000,
        };
        match self.extended {
            false => bytes.extend(self.number(iso + kind)),
            true => {
                bytes.extend(self.number(0xa000_0000 | kind));
                bytes.extend(self.number(25832));
            }
        }
        bytes
    }

    fn positions(self, points: &[Point]) -> Vec<u8> {
        let mut bytes = self.number(points.len() as u32).to_vec();
        for value in points.iter().flat_map(|[x, y, z]| [*x, *y, *z, 7.0].into_iter().take(self.dimensions as usize)) {
            bytes.extend(if self.little_endian { value.to_le_bytes() } else { value.to_be_bytes() });
        }
        bytes
    }

    fn many(self, kind: u32, parts: &[Vec<u8>]) -> Vec<u8> {
        [self.head(kind), self.number(parts.len() as u32).to_vec(), parts.concat()].concat()
    }

    fn line_wkb(self, points: &[Point]) -> Vec<u8> {
        [self.head(2), self.positions(points)].concat()
    }

    fn line(self, points: &[Point]) -> Vec<u8> {
        self.blob(&self.line_wkb(points))
    }

    fn lines(self, lines: &[&[Point]]) -> Vec<u8> {
        self.blob(&self.many(5, &lines.iter().map(|line| self.line_wkb(line)).collect::<Vec<_>>()))
    }

    fn polygon_wkb(self, ring: &[Point]) -> Vec<u8> {
        let closed = [ring, &ring[..1]].concat();
        self.many(3, &[self.positions(&closed)])
    }

    fn polygon(self, ring: &[Point]) -> Vec<u8> {
        self.blob(&self.polygon_wkb(ring))
    }

    fn polygons(self, rings: &[&[Point]]) -> Vec<u8> {
        self.blob(&self.many(6, &rings.iter().map(|ring| self.polygon_wkb(ring)).collect::<Vec<_>>()))
    }
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// A file that goes at the end of the test.
struct Package {
    folder: tempfile::TempDir,
}

impl Package {
    fn path(&self) -> PathBuf {
        self.folder.path().join("roofs and more?.gpkg")
    }

    async fn connection(&self) -> SqliteConnection {
        let options = SqliteConnectOptions::new()
            .filename(self.path())
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Delete);
        options.connect().await.unwrap()
    }

    async fn run(&self, sql: &str) {
        sqlx::raw_sql(AssertSqlSafe(sql.to_owned())).execute(&mut self.connection().await).await.unwrap();
    }

    async fn new() -> Self {
        let package = Self { folder: tempfile::tempdir().unwrap() };
        package
            .run(
                "CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY,
                     organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL,
                     description TEXT);
                 INSERT INTO gpkg_spatial_ref_sys VALUES ('undefined', -1, 'NONE', -1, 'undefined', NULL),
                     ('UTM', 25832, 'epsg', 25832, 'x', NULL), ('own', 100001, 'ACME', 7, 'x', NULL);
                 CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
                     identifier TEXT UNIQUE, srs_id INTEGER);
                 CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
                     geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
                     PRIMARY KEY (table_name, column_name));",
            )
            .await;
        package
    }

    async fn list(&self, table: &str, kind: &str, srs_id: i64) {
        self.run(&format!(
            "INSERT INTO gpkg_contents VALUES ('{table}', 'features', '{table}', {srs_id});
             INSERT INTO gpkg_geometry_columns VALUES ('{table}', 'geom', '{kind}', {srs_id}, 1, 0)"
        ))
        .await;
    }

    async fn table(&self, table: &str, kind: &str, columns: &str) {
        self.list(table, kind, 25832).await;
        self.run(&format!("CREATE TABLE {} (fid INTEGER PRIMARY KEY, geom BLOB {columns})", quoted(table))).await;
    }

    /// A row with a geometry, and what else is written as SQL writes it.
    async fn row(&self, table: &str, geometry: Vec<u8>, values: &str) {
        let sql = format!("INSERT INTO {} VALUES (NULL, $1 {values})", quoted(table));
        sqlx::query(AssertSqlSafe(sql)).bind(geometry).execute(&mut self.connection().await).await.unwrap();
    }
}

fn reading(crs: Option<&str>) -> Reading {
    let crs = crs.map(|crs| Crs::parse(crs).unwrap());
    Reading { format: FileFormat::GeoPackage, crs, ..geojson_reading() }
}

type Read = (Vec<StoredControlPoint>, Vec<Rejection>);

async fn read_as(reading: Reading, path: PathBuf) -> Result<Read, ReadError> {
    let read = move || {
        let (mut points, mut rejected, mut next) = (Vec::new(), Vec::new(), 0);
        reading.read_geopackage(&path, &mut |_| {}, &mut |index, raw| {
            assert_eq!(index, next);
            next += 1;
            match reading.control_point(index, raw) {
                Ok(point) => points.push(point),
                Err(rejection) => rejected.push(rejection),
            }
            ControlFlow::Continue(())
        })?;
        Ok((points, rejected))
    };
    tokio::task::spawn_blocking(read).await.unwrap()
}

async fn read_all(package: &Package) -> Read {
    read_as(reading(None), package.path()).await.unwrap()
}

fn of_geojson(features: &[Value]) -> Vec<StoredControlPoint> {
    let reading = Reading { crs: Some(Crs::parse("EPSG:25832").unwrap()), ..geojson_reading() };
    let mut points = Vec::new();
    let mut each = |index, raw| {
        points.push(reading.control_point(index, raw).unwrap());
        ControlFlow::Continue(())
    };
    reading.read(&mut &collection(features)[..], &mut each).unwrap();
    points
}

fn feature(properties: &Value, lines: &[[Point; 2]]) -> Value {
    json!({"type": "Feature", "properties": properties,
        "geometry": {"type": "MultiLineString", "coordinates": lines}})
}

/// Eaves at 5 m over 12 m by 8 m, the ridge at 9 m in the middle, along x.
fn roof(east_m: f64) -> [[Point; 4]; 2] {
    let at = |x: f64, y: f64, z: f64| [565_000.0 + east_m + x, 5_934_000.0 + y, z];
    let (e, f) = (at(0.0, 4.0, 9.0), at(12.0, 4.0, 9.0));
    [[at(0.0, 0.0, 5.0), at(12.0, 0.0, 5.0), f, e], [at(12.0, 8.0, 5.0), at(0.0, 8.0, 5.0), e, f]]
}

#[tokio::test]
async fn lines_are_the_control_points_that_geojson_makes_of_them() {
    let package = Package::new().await;
    let columns = ", cp_id TEXT, sigma_m REAL, edge_type TEXT, \"use\" TEXT, valid_from DATE, valid_to DATETIME";
    package.table("edges", "LINESTRING", columns).await;
    package.table("many \"of\" them", "MULTILINESTRING", ", NAME TEXT, Sigma_XY REAL, sigma_z TEXT").await;
    let [[a, b, f, e], [c, d, ..]] = roof(0.0);
    let [[g, h, j, i], _] = roof(40.0);
    // two buildings, their rows among each other
    package.row("edges", BIG.line(&[a, b]), ", 'x', 0.1, 'eave', 'check', '2020-01-01', '2024-12-31T12:00:00Z'").await;
    package.row("edges", LITTLE.line(&[g, h]), ", 'w', 0.3, NULL, NULL, NULL, NULL").await;
    package.row("edges", EXTENDED.line(&[e, f]), ", 'x', 0.1, 'Ridge', NULL, NULL, NULL").await;
    package.row("edges", LITTLE.line(&[g, i, j, h]), ", 'w', 0.3, NULL, NULL, NULL, NULL").await;
    // rows that belong to none are each by itself
    package.row("edges", LITTLE.line(&[c, d]), ", NULL, 0.1, NULL, NULL, NULL, NULL").await;
    let with_measure = Written { dimensions: 4, ..BIG };
    package.row("many \"of\" them", with_measure.lines(&[&[a, b], &[e, f, c]]), ", ' v ', 0.2, '0.35'").await;
    let (points, rejected) = read_all(&package).await;
    assert_eq!(rejected, []);
    let properties = json!({"name": "x", "sigma_m": 0.1, "edge_kinds": ["eave", "ridge"], "use": "check",
        "valid_from": "2020-01-01", "valid_to": "2024-12-31"});
    let expected = of_geojson(&[
        feature(&json!({"name": "edges:fid:5", "sigma_m": 0.1}), &[[c, d]]),
        feature(&json!({"name": "w", "sigma_m": 0.3}), &[[g, h], [g, i], [i, j], [j, h]]),
        feature(&properties, &[[a, b], [e, f]]),
        feature(&json!({"name": "v", "sigma_m": 0.35}), &[[a, b], [e, f], [f, c]]),
    ]);
    assert_eq!(points, expected);
    assert_eq!(points[2].purpose, Use::Check);
}

#[tokio::test]
async fn surfaces_have_the_edges_of_a_building_model() {
    let package = Package::new().await;
    package.table("a", "POLYGON", ", building_id INTEGER, name TEXT, sigma_m REAL").await;
    package.table("b", "MULTIPOLYGON", ", gml_id TEXT").await;
    let roofs = [0.0, 30.0, 60.0].map(roof);
    for face in [0, 1] {
        for (building, roof) in roofs.iter().enumerate().take(2) {
            let written = if face == 0 { BIG } else { EXTENDED };
            package.row("a", written.polygon(&roof[face]), &format!(", {building}, 'face {face}', 0.2")).await;
        }
    }
    package.row("b", BIG.polygons(&[&roofs[2][0], &roofs[2][1]]), ", 'DENW7'").await;
    let (points, rejected) = read_all(&package).await;
    assert_eq!(rejected, []);
    let of = |roof: &[[Point; 4]; 2], name: &str, sigma_m: f64| {
        let edges = crate::buildings::roof_edges(&roof.map(|ring| vec![ring.to_vec()]), false).unwrap();
        let kinds: Vec<&str> = edges.iter().map(|edge| edge.kind.name()).collect();
        let lines: Vec<[Point; 2]> = edges.iter().map(|edge| [edge.start, edge.end]).collect();
        feature(&json!({"name": name, "sigma_m": sigma_m, "edge_kinds": kinds}), &lines)
    };
    // what parts are called is not what the building is called; a model that does not say how good it is is good to 0.15 m
    let expected = [of(&roofs[0], "0", 0.2), of(&roofs[1], "1", 0.2), of(&roofs[2], "DENW7", 0.15)];
    assert_eq!(points, of_geojson(&expected));
    let of_kind = |kind| points[2].edges.iter().filter(|edge| edge.kind == Some(kind)).count();
    assert_eq!([EdgeKind::Eave, EdgeKind::Ridge, EdgeKind::Gable].map(of_kind), [2, 1, 4]);
}

#[tokio::test]
async fn rows_without_a_name_are_called_by_their_table_and_number() {
    let package = Package::new().await;
    package.table("a", "LINESTRING", ", sigma_m REAL").await;
    package.table("b", "LINESTRING", ", sigma_m REAL, id INTEGER").await;
    let [[from, to, ..], _] = roof(0.0);
    package.row("a", LITTLE.line(&[from, to]), ", 0.1").await;
    package.row("b", LITTLE.line(&[from, to]), ", 0.1, 17").await;
    package.row("b", LITTLE.line(&[from, to]), ", 0.1, NULL").await;
    let (points, rejected) = read_all(&package).await;
    assert_eq!(rejected, []);
    let names: Vec<&str> = points.iter().map(|point| &*point.name).collect();
    assert_eq!(names, ["a:fid:1", "b:17", "b:fid:2"]);
}

#[tokio::test]
async fn a_sigma_that_was_given_stands_for_one_that_rows_do_not_have() {
    let package = Package::new().await;
    package.table("lines", "LINESTRING", ", name TEXT, sigma_m REAL").await;
    package.table("roofs", "POLYGON", ", building_id TEXT").await;
    let faces = roof(0.0);
    package.row("lines", LITTLE.line(&faces[0][..2]), ", 'own', 0.2").await;
    package.row("lines", LITTLE.line(&faces[0][..2]), ", 'given', NULL").await;
    for face in &faces {
        package.row("roofs", LITTLE.polygon(face), ", 'roof'").await;
    }
    let defaults = crate::control::geojson::Defaults { sigma_m: Some(0.4), ..Default::default() };
    let (points, rejected) = read_as(Reading { defaults, ..reading(None) }, package.path()).await.unwrap();
    assert_eq!(rejected, []);
    let sigmas: Vec<(&str, f64)> = points.iter().map(|point| (&*point.name, point.sigma_m)).collect();
    assert_eq!(sigmas, [("own", 0.2), ("given", 0.4), ("roof", 0.4)]);
}

#[tokio::test]
async fn an_import_takes_the_good_rows_and_says_why_of_the_others() {
    let package = Package::new().await;
    package.table("edges", "GEOMETRY", ", name TEXT, cp_id TEXT, sigma_m REAL, edge_type TEXT, valid_from TEXT").await;
    let [[a, b, f, e], _] = roof(0.0);
    let line = || LITTLE.line(&[a, b]);
    package.row("edges", line(), ", 'good', NULL, 0.1, NULL, NULL").await;
    for (geometry, values, _) in refusals(a, b, f, e) {
        package.row("edges", geometry, values).await;
    }
    package.run("INSERT INTO edges (name) VALUES ('nothing')").await;
    package.run("INSERT INTO edges (name, geom) VALUES ('text', 'LINESTRING')").await;
    let pool = database().await;
    let path = package.path();
    let mut told = Vec::new();
    let plan = Import::default();
    let read = points::import(
        &pool,
        &plan,
        reading(None),
        move |reading, each| reading.read_geopackage(&path, &mut |_| {}, each),
        |step| told.push(step.items_done),
    );
    let report = read.await.unwrap();
    assert_eq!((report.imported, report.updated), (1, 0));
    // the two of one building are one
    let refused = refusals(a, b, f, e).len() - 1 + 2;
    assert_eq!((report.rejected_count, told), (refused, vec![refused + 1]));
    for detail in refusals(a, b, f, e).map(|(.., detail)| detail).into_iter().chain(["has no geometry", "no blob"]) {
        assert!(report.rejected.iter().any(|rejection| rejection.detail.contains(detail)), "{detail}: {report:?}");
    }
    assert!(report.rejected.iter().all(|rejection| rejection.name.is_some()));
}

/// Rows that become no control point, and why.
fn refusals(a: Point, b: Point, f: Point, e: Point) -> [(Vec<u8>, &'static str, &'static str); 11] {
    let line = || LITTLE.line(&[a, b]);
    let flat = Written { dimensions: 2, ..LITTLE };
    [
        (
            flat.line(&[a, b]),
            ", 'flat', NULL, 0.1, NULL, NULL",
            "LineString has two dimensions: the heights are missing",
        ),
        (line(), ", 'unsure', NULL, NULL, NULL, NULL", "sigma_m is missing"),
        (line(), ", 'wild', NULL, 'much', NULL, NULL", "sigma_m is 0"),
        (line(), ", 'gutter', NULL, 0.1, 'gutter', NULL", "it may be eave"),
        (line(), ", 'undated', NULL, 0.1, NULL, 'May'", "is no day"),
        (line(), ", NULL, 'mixed', 0.1, NULL, '2020-01-01'", "is another one than in an earlier row"),
        (line(), ", NULL, 'mixed', 0.1, NULL, '2020-01-02'", "is another one than in an earlier row"),
        (LITTLE.line(&[a, a]), ", 'short', NULL, 0.1, NULL, NULL", "a line needs a length"),
        (LITTLE.line(&[a; 3_000]), ", 'long', NULL, 0.1, NULL, NULL", "at most 2000"),
        (LITTLE.lines(&[]), ", 'none', NULL, 0.1, NULL, NULL", "no geometry"),
        (BIG.polygon(&[f, e]), ", 'spike', NULL, 0.1, NULL, NULL", "a ring needs at least three"),
    ]
}
