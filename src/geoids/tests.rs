//! Against PROJ, on small grids that both read: `tests/expected.py` makes them and what PROJ finds.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use tiff::encoder::{Compression, TiffEncoder, colortype};
use tiff::tags::Tag;

use super::*;
use crate::geometry::CrsError;
use crate::geometry::geoid::GeoidFault;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/geoids/tests")
}

fn crs(name: &str) -> Crs {
    Crs::parse(name).unwrap().with_geoids(Arc::new(GeoidFolder::new(folder())))
}

#[test]
fn positions_with_heights_above_a_geoid_are_those_of_proj_both_ways() {
    let rows = include_str!("tests/expected.csv").lines().skip(1);
    let mut count = 0;
    for row in rows {
        let (name, numbers) = row.split_once(',').unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|number| number.parse().unwrap()).collect();
        let &[x, y, z, geocentric_x, geocentric_y, geocentric_z] = numbers.as_slice() else { panic!("{row}") };
        let (crs, geocentric_m) = (crs(name), Vector3::new(geocentric_x, geocentric_y, geocentric_z));
        let found_m = crs.geocentric_from_position([x, y, z], None).unwrap();
        assert!((found_m - geocentric_m).norm() < 2e-7, "{row}: {}", found_m - geocentric_m);
        let back = crs.position_from_geocentric(geocentric_m, None).unwrap();
        assert!((Vector3::from(back) - Vector3::new(x, y, z)).norm() < 2e-7, "{row}: {back:?}");
        count += 1;
    }
    assert_eq!(count, 56);
}

#[test]
fn what_a_compound_says_of_itself() {
    let compound = crs("epsg:25832+7837");
    assert_eq!(compound.to_string(), "EPSG:25832+7837");
    assert_eq!(compound, crs("EPSG:25832 7837"));
    assert!(!compound.assumes_ellipsoidal_heights() && compound.horizontal().assumes_ellipsoidal_heights());
    assert!((compound.accuracy_m() - 0.02).abs() < 1e-12);
    assert!((crs("EPSG:31466+7837").accuracy_m() - 3.0_f64.hypot(0.02)).abs() < 1e-12);
    assert!(crs("EPSG:9924").is_geographic());
    // up is the ellipsoid's
    let at_m = compound.geocentric_from_position([382_710.0, 5_596_412.0, 100.0], None).unwrap();
    let axes = compound.axes_from_geocentric(at_m).unwrap();
    assert_eq!(axes, Crs::parse("EPSG:25832").unwrap().axes_from_geocentric(at_m).unwrap());
}

#[test]
fn a_place_that_the_grid_does_not_reach_is_refused_and_never_taken_as_0() {
    let compound = crs("EPSG:25832+7837");
    let berlin_m = Crs::parse("EPSG:25832").unwrap().geocentric_from_position([800_000.0, 5.83e6, 80.0], None).unwrap();
    for refused in [
        compound.geocentric_from_position([800_000.0, 5.83e6, 40.0], None).unwrap_err(),
        compound.position_from_geocentric(berlin_m, None).unwrap_err(),
    ] {
        assert!(matches!(refused, CrsError::OutsideGeoidGrid { .. }), "{refused}");
    }
    assert!(compound.axes_from_geocentric(berlin_m).is_ok());
    // among nodes without a number
    let hole = crs("EPSG:9286").geocentric_from_position([5.07, 52.17, 10.0], None);
    assert!(matches!(hole, Err(CrsError::OutsideGeoidGrid { .. })), "{hole:?}");
}

#[test]
fn without_its_grid_a_compound_is_refused_and_the_file_is_named() {
    let refused =
        Crs::parse("EPSG:25832+7837").unwrap().geocentric_from_position([382_710.0, 5_596_412.0, 100.0], None);
    let refused = refused.unwrap_err().to_string();
    for named in ["EPSG:25832+7837", "DHHN2016", "de_bkg_gcg2016.tif", "geoid_folder", "https://cdn.proj.org/"] {
        assert!(refused.contains(named), "{refused}");
    }
    let without = crs("EPSG:25831+5710");
    assert!(matches!(without.check_heights(None), Err(CrsError::GeoidGridMissing { .. })));
    assert_eq!(crs("EPSG:25832+7837").check_heights(None), Ok(()));
}

#[test]
fn an_undulation_beside_a_compound_is_refused() {
    let compound = crs("EPSG:25832+7837");
    let position = [382_710.0, 5_596_412.0, 100.0];
    for refused in [
        compound.geocentric_from_position(position, Some(46.0)).unwrap_err(),
        compound.check_heights(Some(46.0)).unwrap_err(),
        compound.position_from_geocentric(Vector3::new(4e6, 5e5, 4.9e6), Some(46.0)).unwrap_err(),
    ] {
        assert!(matches!(refused, CrsError::UndulationBesideCompound { .. }), "{refused}");
    }
}

#[test]
fn what_is_no_compound_is_refused_by_name() {
    for (given, named) in [
        ("EPSG:25832+9999", "height system EPSG:9999"),
        ("EPSG:1234+7837", "EPSG:1234+7837"),
        ("EPSG:25832+", "not known"),
        ("EPSG:25832+7837+5783", "not known"),
    ] {
        let refused = Crs::parse(given).unwrap_err().to_string();
        assert!(refused.contains(named), "{given}: {refused}");
    }
}

#[test]
fn every_registered_compound_is_known() {
    for code in (5554..=5556).chain(5971..=5976).chain(10162..=10174).chain([6697, 7415, 7423, 9286, 9518, 9707, 9924])
    {
        let compound = crs(&format!("EPSG:{code}"));
        assert!(!compound.assumes_ellipsoidal_heights(), "{compound}");
        assert!(compound.accuracy_m() > 0.0, "{compound}");
    }
}

#[test]
fn the_grids_of_a_folder_are_found_with_what_they_serve() {
    let found = GeoidFolder::new(folder()).found();
    let names: Vec<&str> = found.iter().map(|found| found.name).collect();
    assert_eq!(found.len(), 6, "{names:?}");
    assert!(found.iter().all(|found| found.fault.is_none() && !found.systems.is_empty()));
    assert!(GeoidFolder::new("/nowhere").found().is_empty());
}

#[test]
fn a_system_keeps_the_grid_that_served_it_first_whatever_comes_later() {
    let [position, of_model] = [[7.1, 50.5, 100.0], [7.0, 50.0, 0.5]];
    let folder = tempfile::tempdir().unwrap();
    // a model that is level: each node as high as it says
    let put = |name: &str, undulation_m: f32| {
        let mut bytes = Vec::new();
        for number in [of_model[1], of_model[0], of_model[2], of_model[2]] {
            bytes.extend(f64::to_be_bytes(number));
        }
        bytes.extend([3_i32; 2].map(i32::to_be_bytes).concat());
        bytes.extend([undulation_m; 9].map(f32::to_be_bytes).concat());
        std::fs::write(folder.path().join(format!("{name}.gtx")), bytes).unwrap();
    };
    let navd88 = |geoids: &Arc<GeoidFolder>| Crs::parse("EPSG:4326+5703").unwrap().with_geoids(geoids.clone());
    let height_m = |geoids| {
        let ellipsoidal = Crs::parse("EPSG:4979").unwrap().geocentric_from_position(position, None).unwrap();
        navd88(geoids).position_from_geocentric(ellipsoidal, None).map(|[.., height_m]| height_m)
    };
    let service = Arc::new(GeoidFolder::new(folder.path()));
    assert!(matches!(height_m(&service), Err(CrsError::GeoidGridMissing { .. })));
    put("us_noaa_geoid09_conus", -30.0);
    assert!((height_m(&service).unwrap() - 130.0).abs() < 1e-6, "a grid that comes is found");
    put("us_noaa_g2018u0", -31.0);
    assert!((height_m(&service).unwrap() - 130.0).abs() < 1e-6, "the model must not change");
    let anew = Arc::new(GeoidFolder::new(folder.path()));
    assert!((height_m(&anew).unwrap() - 131.0).abs() < 1e-6);
    let system = Crs::height_systems().find(|system| system.code == 5703).unwrap();
    assert_eq!(first_used(system, &anew.found()), Some("us_noaa_g2018u0"));
    assert_eq!(first_used(system, &[]), None);
}

/// A folder with one file, and what comes of reading it.
fn read_as(name: &str, bytes: &[u8]) -> Result<GeoidGrid, GeoidFileError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::File::create(&file).unwrap().write_all(bytes).unwrap();
    read(&file)
}

fn gtx(rows: i32, columns: i32, numbers: &[f32]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for number in [50.0_f64, 7.0, 0.5, 1.0] {
        bytes.extend(number.to_be_bytes());
    }
    bytes.extend(rows.to_be_bytes());
    bytes.extend(columns.to_be_bytes());
    numbers.iter().for_each(|number| bytes.extend(number.to_be_bytes()));
    bytes
}

#[test]
fn a_gtx_has_gaps_and_one_of_another_length_is_none() {
    let grid = read_as("a.gtx", &gtx(2, 3, &[1.0, 2.0, 3.0, 4.0, 5.0, -88.8888])).unwrap();
    assert!((grid.undulation_m(7.5, 50.25).unwrap() - 3.0).abs() < 1e-9);
    assert_eq!(grid.undulation_m(8.5, 50.25), Err(GeoidFault::Outside));
    for bad in [
        gtx(2, 3, &[1.0; 5]),
        gtx(i32::MAX, i32::MAX, &[1.0; 5]),
        gtx(-2, -3, &[1.0; 6]),
        gtx(2, 3, &[])[..20].to_vec(),
        Vec::new(),
    ] {
        assert!(matches!(read_as("a.gtx", &bad), Err(GeoidFileError::NoGrid(_))));
    }
}

/// A GeoTIFF of 4 x 3 numbers at these doubles and keys.
fn tif(doubles: &[(Tag, &[f64])], keys: &[u16], metadata: Option<&str>) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap().with_compression(Compression::Uncompressed);
    let mut image = encoder.new_image::<colortype::Gray32Float>(4, 3).unwrap();
    for (tag, numbers) in doubles {
        image.encoder().write_tag(*tag, *numbers).unwrap();
    }
    image.encoder().write_tag(Tag::GeoKeyDirectoryTag, keys).unwrap();
    if let Some(metadata) = metadata {
        image.encoder().write_tag(Tag::Unknown(42112), metadata).unwrap();
    }
    image.write_data(&std::array::from_fn::<f32, 12, _>(|k| k as f32)).unwrap();
    file.into_inner()
}

const GEOGRAPHIC_POINTS: [u16; 12] = [1, 1, 0, 2, 1024, 0, 1, 2, 1025, 0, 1, 2];

#[test]
fn a_transformation_says_where_a_tiff_lies_too() {
    let transformation = [0.5, 0.0, 0.0, 7.0, 0.0, -0.25, 0.0, 51.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0].as_slice();
    let file = tif(&[(Tag::ModelTransformationTag, transformation)], &GEOGRAPHIC_POINTS, None);
    let grid = read_as("a.tif", &file).unwrap();
    // the second number of the second row
    assert!((grid.undulation_m(7.5, 50.75).unwrap() - 5.0).abs() < 1e-9);
    assert_eq!(grid.undulation_m(7.5, 50.4), Err(GeoidFault::Outside));
}

#[test]
fn a_tiff_with_more_pages_than_are_read_is_refused() {
    let with_pages = |count: usize| {
        let mut file = std::io::Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut file).unwrap();
        for _ in 0..count {
            let mut image = encoder.new_image::<colortype::Gray32Float>(2, 2).unwrap();
            image.encoder().write_tag(Tag::ModelPixelScaleTag, [0.5, 0.5, 0.0].as_slice()).unwrap();
            image.encoder().write_tag(Tag::ModelTiepointTag, [0.0, 0.0, 0.0, 7.0, 51.0, 0.0].as_slice()).unwrap();
            image.write_data(&[0.0; 4]).unwrap();
        }
        read_as("a.tif", &file.into_inner())
    };
    assert_eq!(with_pages(256).unwrap().places().count(), 256);
    let refused = with_pages(257).unwrap_err().to_string();
    assert!(refused.contains("more than 256 pages"), "{refused}");
}

#[test]
fn tiffs_that_are_no_geoid_grid_are_refused_by_what_they_are() {
    let scale = (Tag::ModelPixelScaleTag, [0.5, 0.25, 0.0].as_slice());
    let tie = (Tag::ModelTiepointTag, [0.0, 0.0, 0.0, 7.0, 51.0, 0.0].as_slice());
    let in_metres = (Tag::ModelTiepointTag, [0.0, 0.0, 0.0, 365_000.0, 5_620_000.0, 0.0].as_slice());
    let projected = [1, 1, 0, 1, 1024, 0, 1, 1];
    let other = "<GDALMetadata><Item name=\"TYPE\">HORIZONTAL_OFFSET</Item></GDALMetadata>";
    assert!(read_as("a.tif", &tif(&[scale, tie], &GEOGRAPHIC_POINTS, None)).is_ok());
    for (file, named) in [
        (tif(&[scale, tie], &projected, None), "longitude and latitude"),
        (tif(&[scale, in_metres], &GEOGRAPHIC_POINTS, None), "longitudes and latitudes"),
        (tif(&[scale], &GEOGRAPHIC_POINTS, None), "where on Earth"),
        (tif(&[], &GEOGRAPHIC_POINTS, None), "where on Earth"),
        (tif(&[scale, tie], &GEOGRAPHIC_POINTS, Some(other)), "HORIZONTAL_OFFSET"),
        (b"no tiff at all".to_vec(), "TIFF"),
    ] {
        let refused = read_as("a.tif", &file).unwrap_err().to_string();
        assert!(refused.contains(named), "{refused}");
    }
}

#[test]
fn a_damaged_file_is_an_error_wherever_it_was_cut_and_whatever_was_written_over_it() {
    let whole = std::fs::read(folder().join("de_bkg_gcg2016.tif")).unwrap();
    let look = |bytes: &[u8]| {
        if let Ok(grid) = read_as("a.tif", bytes) {
            for place in [(6.95, 50.45), (7.3, 50.6), (7.55, 50.75)] {
                // an error, or a number: no panic
                let _ = grid.undulation_m(place.0, place.1);
            }
        }
    };
    for length in (0..whole.len()).step_by(97) {
        look(&whole[..length]);
    }
    for at in (0..whole.len()).step_by(13) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0xff;
        look(&damaged);
    }
}
