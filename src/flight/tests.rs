//! Each format, as it should be and as it should not.

use super::*;

fn source(crs: &str) -> Source {
    Source { crs: Crs::parse(crs).unwrap(), geoid_undulation_m: None, angles: AngleUnit::Degrees }
}

fn table(text: &str) -> Result<Flight, LineFaults> {
    parse(text.as_bytes(), Format::Table, &source("EPSG:25832"))
}

fn places(result: Result<Flight, LineFaults>) -> Vec<String> {
    result.unwrap_err().first.into_iter().map(|fault| fault.place).collect()
}

#[track_caller]
fn fault(result: Result<Flight, LineFaults>) -> String {
    result.unwrap_err().first.remove(0).detail
}

#[test]
fn tables_are_read_with_every_separator_and_header() {
    let comma = "name,x,y,z\na,365000.5,5621000,1200\nb,365100,5621000,1200\n";
    let flight = table(comma).unwrap();
    assert_eq!(flight.images.len(), 2);
    assert_eq!((flight.images[0].number, flight.images[0].name.as_str()), (2, "a"));
    assert_eq!(flight.images[0].position, [365_000.5, 5_621_000.0, 1200.0]);
    assert_eq!(flight.images[0].kappa_deg, None);
    for text in [
        comma.replace(',', ";"),
        comma.replace(',', "\t"),
        comma.replace('\n', "\r\n"),
        format!("\u{feff}{comma}"),
        comma.replace("name,x,y,z", "Filename, Easting , NORTHING,height"),
        comma.replace("name,x,y,z", "image,X (m),Y [m],z_m"),
        comma.replace("\na,", "\n\"a\","),
    ] {
        assert_eq!(table(&text).unwrap().images, flight.images, "{text}");
    }
    let more = table("time,name,z,y,x,sigma_x,sigma_y,sigma_z,image_id\n1,a,1200,5621000,365000,1,2,3,\n").unwrap();
    assert_eq!(more.ignored, ["time"]);
    assert_eq!(more.images[0].sigma_position_m, Some([1.0, 2.0, 3.0]));
    assert_eq!(more.images[0].image, None);
}

#[test]
fn angles_about_the_axes_of_the_grid_become_those_of_the_local_frame() {
    let text = "name,x,y,z,omega,phi,kappa\na,365000,5621000,1200,1,-2,70\n";
    let image = table(text).unwrap().images.remove(0);
    // the meridian of EPSG:25832 is 9 degrees east: here, at 7.09, grid north is about 1.5 degrees west of north
    let kappa_deg = image.kappa_deg.unwrap();
    assert!((kappa_deg - 70.0).abs() > 1.0 && (kappa_deg - 70.0).abs() < 2.0, "{kappa_deg}");
    let gon = text
        .replace("omega,phi,kappa", "omega_gon,phi_gon,kappa_gon")
        .replace("1,-2,70", "1.1111111,-2.2222222,77.7777778");
    let same = table(&gon).unwrap().images.remove(0);
    assert!((same.kappa_deg.unwrap() - kappa_deg).abs() < 1e-6);
    assert!((same.omega_deg.unwrap() - image.omega_deg.unwrap()).abs() < 1e-6);
    let geographic = "name,lon,lat,height,omega,phi,kappa\na,7.09,50.72,1200,1,-2,70\n";
    let image = parse(geographic.as_bytes(), Format::Table, &source("EPSG:4979")).unwrap().images.remove(0);
    assert_eq!((image.omega_deg, image.phi_deg, image.kappa_deg), (Some(1.0), Some(-2.0), Some(70.0)));
}

#[test]
fn bad_tables_are_refused_line_by_line() {
    let header = "name,x,y,z\n";
    let bad = format!(
        "{header}a,365000,5621000,nan\nb,365000,5621000,1200\nc,1,2\nd,1e400,5621000,inf\ne,3e9,5621000,1200\n"
    );
    assert_eq!(places(table(&bad)), ["line 2", "line 4", "line 5", "line 6"]);
    let twice = format!("{header}a,365000,5621000,1\n\na,365000,5621000,1\n");
    assert!(fault(table(&twice)).contains("line 2"), "{:?}", table(&twice));
    assert!(fault(table("name,x,y\na,1,2\n")).contains("z (or height)"));
    assert!(fault(table("name,lon,lat,height\na,7,50,100\n")).contains("degrees"));
    assert!(fault(table("name,filename,x,y,z\na,b,1,2,3\n")).contains("twice"));
    assert!(fault(table("name,sigma_x,x,y,z\na,1,365000,5621000,3\n")).contains("belong together"));
    assert!(fault(table("name;x;y;z\na;365000,5;5621000;3\n")).contains("decimal point"));
    assert!(fault(table(&format!("{header},365000,5621000,1\n"))).contains("name must have"));
    assert!(fault(table(&format!("{header}{},365000,5621000,1\n", "n".repeat(256)))).contains("name must have"));
    assert!(fault(table("")).contains("empty"));
    assert!(fault(table(header)).contains("no images"));
    assert!(fault(table("name,sha256,x,y,z\na,12,365000,5621000,3\n")).contains("64 hexadecimal"));
    let binary = parse(b"name,x,y,z\na,1,\xff,3\n", Format::Table, &source("EPSG:25832"));
    assert_eq!(places(binary), ["line 2"]);
}

#[test]
fn hundred_faults_are_told_and_all_are_counted() {
    let text = format!("name,x,y,z\n{}", "a,b,c,d\n".repeat(500));
    let faults = table(&text).unwrap_err();
    assert_eq!((faults.first.len(), faults.count), (MOST_FAULTS, 500));
    let endless = format!("name,x,y,z\n{}", "a,365000,5621000,1\n".repeat(MOST_IMAGES + 1));
    assert!(fault(table(&endless)).contains("in parts"));
}

#[test]
fn text_files_of_orientations_are_read() {
    let read = |text: &str, angles| {
        let source = Source { angles, ..source("EPSG:4979") };
        parse(text.as_bytes(), Format::Text, &source)
    };
    let text = "# name X Y Z omega phi kappa\n  1001  7.09 50.72 1200.5  0.5 -0.25 100 412345.6 # first\n\n1002\t7.1 50.72 1200\n";
    let flight = read(text, AngleUnit::Gon).unwrap();
    assert_eq!(flight.images.len(), 2);
    assert_eq!((flight.images[0].number, flight.images[0].kappa_deg), (2, Some(90.0)));
    assert_eq!((flight.images[1].number, flight.images[1].kappa_deg), (4, None));
    assert_eq!(read(text, AngleUnit::Degrees).unwrap().images[0].kappa_deg, Some(100.0));
    let bad = "a 7 50\nb 7 50 1 0 0\nc 7 50 1 0 0 NaN\nd 7 95 1\ne 7 50 1 0 0 0 1 2 3 4\nf 7 50 -inf\n";
    let places = places(read(bad, AngleUnit::Degrees));
    // what cannot be read comes before what does not lie in the CRS
    assert_eq!(places, ["line 1", "line 2", "line 3", "line 5", "line 6", "line 4"]);
    assert!(fault(read("\u{0}\u{1} 7 50 1\n", AngleUnit::Degrees)).contains("control"));
}

#[test]
fn points_are_read_and_bad_features_are_named() {
    let read = |text: &str| parse(text.as_bytes(), Format::GeoJson, &source("EPSG:4979"));
    let point = r#"{"type": "Feature", "geometry": {"type": "Point", "coordinates": [7.09, 50.72, 1200]},
        "properties": {"name": "a", "kappa_deg": 12.5, "sigma_position_m": [3, 3, 5], "shutter": 1}}"#;
    let collection = |features: &str| format!(r#"{{"type": "FeatureCollection", "features": [{features}]}}"#);
    let flight = read(&collection(point)).unwrap();
    assert_eq!(flight.images[0].position, [7.09, 50.72, 1200.0]);
    assert_eq!(flight.images[0].sigma_position_m, Some([3.0, 3.0, 5.0]));
    assert_eq!(flight.ignored, ["shutter"]);
    let other = point.replace("\"a\"", "\"b\"");
    let cases = [
        (point.replace(", 1200]", "]"), "/features/1/geometry/coordinates"),
        (point.replace("1200", "\"1200\""), "/features/1/geometry/coordinates"),
        (point.replace("Point", "LineString"), "/features/1/geometry"),
        (point.replace("\"name\": \"a\", ", ""), "/features/1/properties/name"),
        (point.replace("12.5", "\"north\""), "/features/1/properties/kappa_deg"),
        (point.replace("[3, 3, 5]", "3"), "/features/1/properties/sigma_position_m"),
        (point.replace("50.72", "150"), "/features/1"),
        (other.clone(), "/features/1"),
    ];
    for (bad, pointer) in cases {
        assert_eq!(places(read(&collection(&format!("{other}, {bad}")))), [pointer], "{bad}");
    }
    assert!(fault(read("{")).contains("not JSON"));
    assert!(fault(read(r#"{"type": "Feature"}"#)).contains("FeatureCollection"));
    assert!(fault(read(&collection(&point.replace("12.5", "1e999")))).contains("JSON"));
    assert!(fault(read(&"[".repeat(10_000))).contains("JSON"));
}
