//! Geometries and files that are not what they say.

use rstest::rstest;

use super::*;
use crate::control::geopackage::blob::shape;

#[test]
fn a_damaged_geometry_is_refused_and_never_more() {
    let [south, north] = roof(0.0);
    for written in [LITTLE, BIG, EXTENDED, Written { dimensions: 4, ..BIG }] {
        for blob in [
            written.line(&south),
            written.lines(&[&south, &north]),
            written.polygon(&south),
            written.polygons(&[&south, &north]),
        ] {
            assert!(shape(&blob, 25832).is_ok());
            for length in 0..blob.len() {
                shape(&blob[..length], 25832).unwrap_err();
            }
            assert!(shape(&[&blob[..], &[0]].concat(), 25832).unwrap_err().contains("after its end"));
            for at in 0..blob.len() {
                for value in [0, 1, 0x7f, 0x80, 0xff] {
                    let mut damaged = blob.clone();
                    damaged[at] = value;
                    // refused, or another place
                    let _ = shape(&damaged, 25832);
                }
            }
        }
    }
}

/// A geometry with one thing changed.
fn changed(at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut blob = LITTLE.line(&roof(0.0)[0]);
    blob[at..at + bytes.len()].copy_from_slice(bytes);
    blob
}

#[rstest]
#[case::magic(changed(0, b"PG"), "does not begin with GP")]
#[case::version(changed(2, &[1]), "version 1")]
#[case::envelope(changed(3, &[0b1011]), "envelope of kind 5")]
#[case::empty(changed(3, &[0b1_0001]), "empty")]
#[case::extension(changed(3, &[0b10_0001]), "extension")]
#[case::another_crs(changed(4, &4326_u32.to_le_bytes()), "srs_id 4326, but its table is in that of 25832")]
#[case::byte_order(changed(8, &[2]), "byte order 2")]
#[case::kind(changed(9, &1_017_u32.to_le_bytes()), "geometry of type 17")]
#[case::dimensions(changed(9, &9_002_u32.to_le_bytes()), "type 9002")]
#[case::measures_only(changed(9, &2_002_u32.to_le_bytes()), "the heights are missing")]
#[case::point(changed(9, &1_001_u32.to_le_bytes()), "is a Point; it must be a LineString")]
#[case::huge(changed(13, &u32::MAX.to_le_bytes()), "claims 4294967295")]
#[case::one_too_many(changed(13, &5_u32.to_le_bytes()), "claims 5")]
#[case::nan(changed(17, &f64::NAN.to_le_bytes()), "coordinate NaN")]
#[case::infinite(changed(33, &f64::INFINITY.to_le_bytes()), "coordinate inf")]
#[case::far(changed(25, &1e9_f64.to_le_bytes()), "within ±1e8")]
#[case::lines_of_polygons(LITTLE.blob(&LITTLE.many(5, &[LITTLE.polygon_wkb(&roof(0.0)[0])])), "must be a LineString")]
#[case::lines_of_lines(LITTLE.blob(&LITTLE.many(5, &[LITTLE.many(5, &[])])), "must be a LineString")]
#[case::no_ring(LITTLE.blob(&LITTLE.many(3, &[])), "without a ring")]
#[case::nothing(Vec::new(), "ends too early")]
fn what_a_geometry_must_not_be(#[case] blob: Vec<u8>, #[case] told: &str) {
    let refused = shape(&blob, 25832).unwrap_err();
    assert!(refused.contains(told), "{refused}");
}

#[test]
fn parts_may_have_a_byte_order_of_their_own() {
    let line = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let mixed = LITTLE.blob(&LITTLE.many(5, &[BIG.line_wkb(&line), EXTENDED.line_wkb(&line)]));
    assert_eq!(shape(&mixed, 25832), Ok(blob::Shape::Lines(vec![line.to_vec(); 2])));
}

async fn refused(package: &Package, crs: Option<&str>) -> String {
    read_as(reading(crs), package.path()).await.unwrap_err().to_string()
}

#[tokio::test]
async fn a_file_that_is_no_geopackage_is_told_as_what_it_is() {
    let package = Package { folder: tempfile::tempdir().unwrap() };
    assert!(refused(&package, None).await.contains("cannot be read"));
    std::fs::write(package.path(), "{\"type\": \"FeatureCollection\"}".repeat(100)).unwrap();
    assert!(refused(&package, None).await.contains("no SQLite file"));
    std::fs::remove_file(package.path()).unwrap();
    package.run("CREATE TABLE roofs (geom BLOB)").await;
    assert!(refused(&package, None).await.contains("no table gpkg_contents"));
    // what is listed by a view is run by nobody
    package.run("CREATE VIEW gpkg_contents AS SELECT 'roofs' AS table_name").await;
    assert!(refused(&package, None).await.contains("no table gpkg_contents"));
    let first = std::fs::read(package.path()).unwrap();
    assert_eq!(FileFormat::recognise(&first, None), Some(FileFormat::GeoPackage));
    assert_eq!(FileFormat::recognise(b"SQLite format 2\0", Some("a.gpkg")), None);
}

#[tokio::test]
async fn what_a_geopackage_must_have_is_said() {
    let package = Package::new().await;
    assert!(refused(&package, None).await.contains("there is none of features"));
    package.table("trees", "POINT", "").await;
    assert!(refused(&package, None).await.contains("trees (POINT)"));
    package.table("edges", "LINESTRING", ", name TEXT, sigma_m REAL").await;
    assert!(refused(&package, None).await.contains("no rows"));
    package.row("edges", LITTLE.line(&roof(0.0)[0]), ", 'a', 0.1").await;
    assert_eq!(read_all(&package).await.0.len(), 1);
    assert!(refused(&package, Some("EPSG:25833")).await.contains("EPSG:25833 was given"));
    std::fs::write(package.folder.path().join("roofs and more?.gpkg-wal"), "x").unwrap();
    assert!(refused(&package, None).await.contains("another program has the GeoPackage open"));
    std::fs::remove_file(package.folder.path().join("roofs and more?.gpkg-wal")).unwrap();
    package.list("seen", "LINESTRING", 25832).await;
    package.run("CREATE VIEW seen AS SELECT * FROM edges").await;
    assert!(refused(&package, None).await.contains("table \"seen\" cannot be read: it is a view"));
    package.run("DROP VIEW seen; CREATE TABLE seen (fid INTEGER PRIMARY KEY, shape BLOB)").await;
    assert!(refused(&package, None).await.contains("no column of its geometry"));
    package.run("DROP TABLE seen; CREATE TABLE seen (x INTEGER, geom BLOB AS (zeroblob(x)))").await;
    assert!(refused(&package, None).await.contains("no column of its geometry"));
    let damaged = std::fs::read(package.path()).unwrap();
    std::fs::write(package.path(), &damaged[..damaged.len() / 2]).unwrap();
    assert!(refused(&package, None).await.contains("damaged"));
}

#[tokio::test]
async fn a_crs_that_only_the_file_knows_must_be_given() {
    let package = Package::new().await;
    package.list("edges", "LINESTRING", 100_001).await;
    package.run("CREATE TABLE edges (geom BLOB, name TEXT, sigma_m REAL)").await;
    let mut blob = LITTLE.line(&roof(0.0)[0]);
    blob[4..8].copy_from_slice(&100_001_u32.to_le_bytes());
    sqlx::query("INSERT INTO edges VALUES ($1, 'a', 0.1)")
        .bind(blob)
        .execute(&mut package.connection().await)
        .await
        .unwrap();
    assert!(refused(&package, None).await.contains("in the CRS \"ACME:7\", which is none of EPSG; give crs"));
    let (points, _) = read_as(reading(Some("EPSG:25832")), package.path()).await.unwrap();
    assert_eq!(points[0].name, "a");
    package.run("UPDATE gpkg_geometry_columns SET srs_id = -1").await;
    assert!(refused(&package, None).await.contains("\"NONE:-1\""));
}

#[tokio::test]
async fn a_building_of_rows_without_end_is_refused_and_not_held() {
    let package = Package::new().await;
    package.table("faces", "POLYGON", ", building_id TEXT").await;
    let rows = MOST_ROWS + 10_000;
    package
        .run(&format!(
            "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {rows})
             INSERT INTO faces (geom, building_id) SELECT x'4750', CASE WHEN i = 7 THEN 'other' ELSE 'huge' END FROM n"
        ))
        .await;
    let (points, rejected) = read_all(&package).await;
    assert!(points.is_empty() && rejected.len() == 2);
    assert_eq!(rejected[0].name.as_deref(), Some("huge"));
    assert!(rejected[0].detail.contains("more than 16777216 bytes"), "{}", rejected[0].detail);
    assert_eq!(rejected[1].name.as_deref(), Some("other"));
}

/// So many rows of next to nothing are those of one building at most.
const MOST_ROWS: usize = record::MOST_BYTES / 256;
