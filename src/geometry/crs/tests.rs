//! Against PROJ, and against themselves there and back.

use super::*;
use approx::assert_abs_diff_eq;
use proptest::prelude::*;
use rstest::rstest;

/// System, position, geocentric coordinates in metres, convergence of the meridians in degrees (grid north east of
/// true north positive).
type Reference = (&'static str, [f64; 3], [f64; 3], f64);

/// pyproj 3.7.2 (PROJ 9.5.1, EPSG 11.022). With D = CRS(code).to_proj4() or the string itself:
/// Transformer.from_pipeline(f"+proj=pipeline +step +inv {D} +step +proj=cart +ellps=ELLPS").transform(*position), and
/// Proj(D).get_factors(longitude, latitude).meridian_convergence.
#[rustfmt::skip]
const PROJ_GRIDS: &[Reference] = &[
    ("EPSG:32601", [472279.841, 6673790.033, 123.456], [-3174824.4588143746, -138615.82922521565, 5511691.959983307], -0.4338854639307978),
    ("EPSG:32614", [587628.097, 3336864.503, 123.456], [-776746.9050623326, -5464545.136321131, 3185783.7112386683], 0.4572281421074238),
    ("EPSG:32632", [365910.342, 5621522.061, 123.456], [4014386.3694096897, 500018.25482412556, 4914682.788398328], -1.471144092786367),
    ("EPSG:32660", [815461.277, 1361429.199, 123.456], [-6232788.486132486, 10878.278907916803, 1349872.4466246811], 0.6183020019510943),
    ("EPSG:32701", [298944.76, 7997714.841, 123.456], [-6063478.841587451, -116424.74185532276, -1968946.2237195913], 0.5904843660624661),
    ("EPSG:32733", [814420.331, 6243724.84, 123.456], [5028621.017674108, 1672799.5670382543, -3537314.2049461007], -1.8978894471261436),
    ("EPSG:32760", [483725.14, 1174109.248, 123.456], [-1163561.552545294, 77283.67261927389, -6249729.951847999], 0.786605604036335),
    ("EPSG:32633", [1075730.792, 7803604.912, 123.456], [1922048.1523501792, 1109695.0181568624, 5959626.770501291], 14.106769160032966),
    ("EPSG:25828", [490252.554, 7108172.819, 123.456], [2695882.016118605, -732454.9329551738, 5714704.123999792], -0.17991170019324654),
    ("EPSG:25832", [295652.067, 5631593.679, 123.456], [4016503.981152843, 429240.44879895484, 4919608.221391755], -2.24811190305706),
    ("EPSG:25833", [610358.471, 5848496.327, 123.456], [3704871.9269734276, 1107005.4841012347, 5055533.775911184], 1.3028217638130937),
    ("EPSG:25838", [601832.661, 4472846.047, 123.456], [3366676.741607166, 3510738.0450342903, 4111989.8160024146], 0.7778106124074683),
    ("EPSG:2176", [5473396.071, 5918755.169, 123.456], [3688044.200323122, 960663.5574640931, 5097308.702295596], -0.32112886339037006),
    ("EPSG:2177", [6429959.466, 5663250.277, 123.456], [3838087.4370701606, 1173421.0874963752, 4940634.29151735], -0.7782745606222433),
    ("EPSG:2178", [7500683.202, 5788489.842, 123.456], [3654570.976232718, 1403590.2401491515, 5018616.418712898], 0.007904755067027931),
    ("EPSG:2179", [8446419.008, 5885595.037, 123.456], [3527512.9576978004, 1511893.9852249373, 5077331.901020734], -0.6397628195280219),
    ("EPSG:2180", [340838.975, 547541.266, 123.456], [3705219.125741247, 1107390.9984931215, 5055197.151520338], -1.8794551350070623),
    ("EPSG:2180", [821677.29, 257783.807, 123.456], [3759411.0464738454, 1634638.4459675797, 4870026.037973372], 3.4551890311808178),
    ("EPSG:3857", [1491681.177, 6891041.724, 123.456], [3785114.6353056324, 901741.5019147036, 5036962.52910234], 0.0),
    ("EPSG:3857", [-13625505.673, -4551210.92, 123.456], [-2703869.5241156137, -4260616.616402395, -3888002.832515602], 0.0),
    ("+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs", [686121.756, 5330438.13, -12.5], [4181769.7284727963, 850790.6671145317, 4724299.96123808], 1.8613103690015582),
    ("+proj=utm +zone=19 +south +ellps=GRS80", [351205.065, 6303223.751, -12.5], [1770476.2100082147, -5027539.69672428, -3491073.2338364264], 0.8809310350473826),
    ("+proj=tmerc +lat_0=49 +lon_0=-2 +k=0.9996012717 +x_0=400000 +y_0=-100000 +ellps=WGS84", [530490.87, 179649.45, -12.5], [3978632.023391336, -8332.839841465173, 4968352.67445648], 1.4715095662254458),
    ("+proj=tmerc +lon_0=10 +k_0=1.00007 +x_0=300000", [326043.107, 6019803.544, -12.5], [3668860.8095082263, 673361.963910852, 5156290.3895768225], 0.3248352184395186),
];

/// pyproj: the pipeline of TransformerGroup(code, "EPSG:4258") that is called "DHDN to ETRS89 (2)", with
/// "+step +proj=cart +ellps=GRS80" behind it; the convergence is the mean azimuth by Geod(ellps="GRS80") of the 100 m
/// of the grid line about the position, in ETRS89.
#[rustfmt::skip]
const PROJ_DHDN: &[Reference] = &[
    ("EPSG:31466", [2541750.159, 5696172.171, 150.25], [3961136.3736221013, 458270.8596813566, 4961455.321548803], 0.4688780060707721),
    ("EPSG:31466", [2507049.042, 5629263.596, 150.25], [4016631.9851720813, 429210.6322237833, 4919541.572329477], 0.07751145752647395),
    ("EPSG:31467", [3417447.831, 5285118.911, 150.25], [4259815.584390795, 591032.55668215, 4694536.600663348], -0.8138153705359419),
    ("EPSG:31467", [3559644.833, 5935594.783, 150.25], [3741308.3114371826, 652881.0695926254, 5107163.959326148], 0.7234962847888158),
    ("EPSG:31468", [4468001.936, 5333539.744, 150.25], [4177684.8226506067, 855170.7956521116, 4727321.953249413], -0.32082070798177353),
    ("EPSG:31469", [5397163.811, 5407779.092, 150.25], [4091378.8123712875, 989681.2420518749, 4775978.914145745], -1.0542662321268246),
];

/// pyproj: the one pipeline that TransformerGroup("EPSG:28992", "EPSG:4937") has without the network, "Amersfoort to ETRS89
/// (8)", the rest as for DHDN.
#[rustfmt::skip]
const PROJ_RD: &[Reference] = &[
    ("EPSG:28992", [155000.0, 463000.0, 150.25], [3904111.4699827824, 368167.4691887796, 5013533.470488082], 0.00012944390735665116),
    ("EPSG:28992", [121786.432, 487035.118, 150.25], [3888251.5723710805, 333307.54610612174, 5028177.233926758], -0.3855536497841928),
    ("EPSG:28992", [277412.905, 582114.22, 150.25], [3797584.0235968945, 481069.8722697215, 5084803.683925276], 1.457597688196389),
    ("EPSG:28992", [13914.236, 377120.655, 150.25], [3983565.508903144, 233956.0013613835, 4959160.845309889], -1.591323697296872),
    ("EPSG:28992", [199327.11, 308415.87, 150.25], [4020237.7513201353, 423639.8343205154, 4917095.0218970645], 0.4915669015810151),
    ("EPSG:28992", [-51250.5, 731020.25, 150.25], [3707403.277296618, 142574.09686511208, 5170801.762482477], -2.5555346743809677),
];

fn crs(text: &str) -> Crs {
    text.parse().unwrap()
}

fn every_reference() -> impl Iterator<Item = &'static Reference> {
    PROJ_GRIDS.iter().chain(PROJ_DHDN).chain(PROJ_RD)
}

#[test]
fn geocentric_coordinates_are_those_of_proj() {
    for (name, position, geocentric_m, _) in every_reference() {
        let found = crs(name).geocentric_from_position(*position, None).unwrap();
        assert!((found - Vector3::from(*geocentric_m)).norm() < 5e-8, "{name} {position:?}: {found}");
    }
}

#[test]
fn many_positions_are_transformed_as_each_of_them() {
    for (name, position, ..) in every_reference() {
        let crs = crs(name);
        let [x, y, z] = *position;
        let near: Vec<[f64; 3]> = (0..5).map(|i| [x + 1e-3 * f64::from(i), y - 1e-3 * f64::from(i), z]).collect();
        let one_by_one: Vec<_> = near.iter().map(|p| crs.geocentric_from_position(*p, None).unwrap()).collect();
        assert_eq!(crs.geocentric_from_positions(&near, None).unwrap(), one_by_one);
        let wrong = [*position, [f64::NAN, y, z]];
        assert_eq!(
            crs.geocentric_from_positions(&wrong, None).unwrap_err().to_string(),
            crs.geocentric_from_position(wrong[1], None).unwrap_err().to_string()
        );
    }
}

#[test]
fn positions_are_those_of_proj() {
    for (name, position, geocentric_m, _) in every_reference() {
        let found = crs(name).position_from_geocentric(Vector3::from(*geocentric_m), None).unwrap();
        assert_abs_diff_eq!(Vector3::from(found), Vector3::from(*position), epsilon = 5e-8);
    }
}

#[test]
fn grid_axes_are_local_axes_turned_by_the_convergence_of_proj() {
    for (name, _, geocentric_m, convergence_deg) in every_reference() {
        let geocentric_m = Vector3::from(*geocentric_m);
        let axes = crs(name).axes_from_geocentric(geocentric_m).unwrap();
        let grid_from_local = axes * LocalFrame::about(geocentric_m).local_from_geocentric().inverse();
        let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), convergence_deg.to_radians());
        let difference_rad = (grid_from_local.matrix() - turned.matrix()).norm();
        assert!(difference_rad < 1e-9, "{name}: {difference_rad}");
    }
}

#[test]
fn geographic_systems_take_degrees_and_have_local_axes() {
    let geocentric_m = LocalFrame::at(-98.09, 30.16, 317.3).to_geocentric(Vector3::zeros());
    for name in ["EPSG:4326", "EPSG:4979", "+proj=longlat +datum=WGS84 +no_defs"] {
        let crs = crs(name);
        assert!(crs.is_geographic() && !crs.assumes_ellipsoidal_heights());
        let found = crs.geocentric_from_position([-98.09, 30.16, 317.3], None).unwrap();
        assert_abs_diff_eq!(found, geocentric_m, epsilon = 2e-9);
        let axes = crs.axes_from_geocentric(geocentric_m).unwrap();
        assert_abs_diff_eq!(axes.matrix() * geocentric_m.normalize(), Vector3::z(), epsilon = 4e-3);
    }
    // the pole of GRS 80, 0.1 mm below that of WGS 84
    let [_, _, height_m] = crs("EPSG:4258").position_from_geocentric(Vector3::z() * 6_356_752.314_140_3, None).unwrap();
    assert_abs_diff_eq!(height_m, 0.0, epsilon = 1e-7);
}

#[test]
fn topocentric_frames_are_read_in_any_order_and_give_their_own_axes() {
    let frame = LocalFrame::at(16.636_187_76, 52.774_949_613, 40.0);
    let here = frame.to_geocentric(Vector3::new(100.0, -200.0, 30.0));
    for text in [
        frame.proj_string().as_str(),
        "+h_0=40 +lat_0=52.774949613   +lon_0=16.63618776 +datum=WGS84 +proj=topocentric +type=crs",
        " proj=topocentric ellps=WGS84 lon_0=16.63618776 lat_0=52.774949613 h_0=40.0 ",
    ] {
        let crs = crs(text);
        assert!(!crs.is_geographic() && !crs.assumes_ellipsoidal_heights());
        assert_eq!(crs.geocentric_from_position([100.0, -200.0, 30.0], None).unwrap(), here);
        assert_eq!(crs.axes_from_geocentric(here).unwrap(), frame.local_from_geocentric());
    }
    let low = crs("+proj=topocentric +ellps=WGS84 +lon_0=16.63618776 +lat_0=52.774949613");
    let [_, _, up] = low.position_from_geocentric(here, None).unwrap();
    assert_abs_diff_eq!(up, 70.0, epsilon = 1e-8);
}

#[test]
fn only_the_old_datums_are_inaccurate() {
    for (name, ..) in PROJ_GRIDS {
        assert_eq!(crs(name).accuracy_m(), 0.0);
        assert!(crs(name).assumes_ellipsoidal_heights());
    }
    assert!(PROJ_DHDN.iter().all(|(name, ..)| crs(name).accuracy_m() == 3.0));
    assert_eq!(crs("EPSG:28992").accuracy_m(), 0.25);
    assert!(crs("EPSG:28992").assumes_ellipsoidal_heights());
}

#[test]
fn a_geoid_undulation_is_added_to_heights() {
    for (name, position, ..) in every_reference() {
        let (crs, [x, y, z]) = (crs(name), *position);
        let above_geoid = crs.geocentric_from_position([x, y, z], Some(43.5)).unwrap();
        assert_eq!(above_geoid, crs.geocentric_from_position([x, y, z + 43.5], None).unwrap());
        let back = crs.position_from_geocentric(above_geoid, Some(43.5)).unwrap();
        assert_abs_diff_eq!(back[2], z, epsilon = 1e-8);
    }
    let frame = crs("+proj=topocentric +ellps=WGS84 +lon_0=7 +lat_0=51 +h_0=0");
    let refused = frame.geocentric_from_position([0.0; 3], Some(40.0)).unwrap_err();
    assert!(matches!(refused, CrsError::UndulationWithoutHeight { .. }));
    for value_m in [f64::NAN, 4000.0] {
        let refused = crs("EPSG:25832").geocentric_from_position([5e5, 5e6, 0.0], Some(value_m)).unwrap_err();
        assert!(matches!(refused, CrsError::Undulation { .. }));
    }
}

#[rstest]
#[case("epsg:25832", "EPSG:25832")]
#[case(" EPSG:4979 ", "EPSG:4979")]
#[case("+proj=utm  +zone=32 +ellps=GRS80", "+proj=utm +zone=32 +ellps=GRS80")]
#[case("proj=topocentric h_0=300.0 lon_0=-98.10 lat_0=30", "+proj=topocentric +h_0=300.0 +lon_0=-98.10 +lat_0=30")]
fn it_prints_as_it_was_given(#[case] given: &str, #[case] printed: &str) {
    assert_eq!(crs(given).to_string(), printed);
    assert_eq!(crs(printed), crs(given));
}

#[test]
fn every_code_of_the_list_is_known_and_its_neighbours_are_not() {
    let utm = (32601..=32660).chain(32701..=32760).chain(25828..=25838);
    let strips = (2176..=2180).chain(31466..=31469).chain(6668..=6687);
    for code in utm.chain(strips).chain([3857, 4258, 4326, 4979, 4937, 28992]) {
        assert_eq!(crs(&format!("EPSG:{code}")).to_string(), format!("EPSG:{code}"));
    }
    for code in [32600, 32661, 32700, 32761, 25827, 25839, 6688, 2175, 2181, 31465, 31470, 0] {
        let refused = Crs::parse(&format!("EPSG:{code}")).unwrap_err();
        assert!(matches!(refused, CrsError::Unknown { .. }));
        assert!(refused.to_string().contains("25828-25838"));
    }
}

#[rstest]
#[case("")]
#[case("EPSG:")]
#[case("EPSG:+25832")]
#[case("EPSG:99999999999999999999")]
#[case("EPSG:25832;drop")]
#[case("WGS84")]
#[case("ÄÖÜ€EPSG")]
#[case("+zone=32")]
fn what_is_no_crs_is_unknown(#[case] given: &str) {
    assert!(matches!(Crs::parse(given), Err(CrsError::Unknown { .. })), "{given}");
}

#[rstest]
#[case("+proj=lcc +lat_1=49", "proj")]
#[case("+proj", "proj")]
#[case("+proj=utm +zone=32 +ellps=bessel", "ellps")]
#[case("+proj=utm +zone=32 +datum=NAD83", "datum")]
#[case("+proj=utm +zone=32 +datum=WGS84 +ellps=WGS84", "datum")]
#[case("+proj=utm +zone=61", "zone")]
#[case("+proj=utm +zone=32.5", "zone")]
#[case("+proj=utm", "zone")]
#[case("+proj=utm +zone=32 +south=yes", "south")]
#[case("+proj=utm +zone=32 +zone=33", "zone")]
#[case("+proj=utm +zone=32 +units=us-ft", "units")]
#[case("+proj=utm +zone=32 +towgs84=598.1,73.7,418.2", "towgs84")]
#[case("+proj=utm +zone=32 +geoidgrids=egm96_15.gtx", "geoidgrids")]
#[case("+proj=utm +zone=32 +lon_0=9", "lon_0")]
#[case("+proj=tmerc +k=0", "k")]
#[case("+proj=tmerc +k=1 +k_0=1", "k")]
#[case("+proj=tmerc +x_0=NaN", "x_0")]
#[case("+proj=tmerc +axis=wsu", "axis")]
#[case("+proj=topocentric +lon_0=7", "lat_0")]
#[case("+proj=topocentric +lon_0=7d30 +lat_0=51", "lon_0")]
#[case("+proj=topocentric +lon_0=7 +lat_0=91", "lat_0")]
#[case("+proj=topocentric +lon_0=7 +lat_0=51 +h_0=inf", "h_0")]
#[case("+proj=topocentric +X_0=4e6 +Y_0=4e5 +Z_0=5e6 +lon_0=7 +lat_0=51", "X_0")]
fn a_refused_proj_string_names_the_parameter(#[case] given: &str, #[case] culprit: &str) {
    let refused = Crs::parse(given).unwrap_err();
    assert!(matches!(&refused, CrsError::Parameter { parameter, .. } if parameter == culprit), "{refused}");
}

#[rstest]
#[case("EPSG:4326", [181.0, 0.0, 0.0], 0)]
#[case("EPSG:4326", [52.0, 97.0, 0.0], 1)]
#[case("EPSG:4979", [7.0, 51.0, 2e5], 2)]
#[case("EPSG:25832", [5.6e6, 3.7e5, 100.0], 0)]
#[case("EPSG:25832", [32_365_910.0, 5_621_522.0, 100.0], 0)]
#[case("EPSG:31467", [500_000.0, 5_621_522.0, 100.0], 0)]
#[case("EPSG:2177", [7_429_959.0, 5_663_250.0, 100.0], 0)]
#[case("EPSG:32632", [5e5, 1.1e7, 100.0], 1)]
#[case("EPSG:32733", [5e5, -1e5, 100.0], 1)]
#[case("EPSG:3857", [0.0, 2.1e7, 100.0], 1)]
#[case("EPSG:28992", [582_114.2, 277_412.9, 100.0], 0)]
#[case("EPSG:28992", [308_415.9, 199_327.1, 100.0], 1)]
#[case("+proj=topocentric +lon_0=7 +lat_0=51", [0.0, 0.0, -2e6], 2)]
fn implausible_coordinates_are_refused(#[case] name: &str, #[case] position: [f64; 3], #[case] culprit: usize) {
    let refused = crs(name).geocentric_from_position(position, None).unwrap_err();
    assert!(matches!(refused, CrsError::OutOfRange { index, .. } if index == culprit), "{refused}");
}

#[test]
fn coordinates_that_are_not_finite_are_refused_both_ways() {
    for (name, position, geocentric_m, _) in every_reference() {
        for (bad, index) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().zip([0, 1, 2]) {
            let (mut position, mut geocentric_m) = (*position, Vector3::from(*geocentric_m));
            (position[index], geocentric_m[index]) = (bad, bad);
            assert!(crs(name).geocentric_from_position(position, None).is_err());
            assert!(crs(name).position_from_geocentric(geocentric_m, None).is_err());
            assert!(crs(name).axes_from_geocentric(geocentric_m).is_err());
        }
    }
}

#[test]
fn a_grid_does_not_reach_the_other_side_of_the_earth() {
    for (name, _, geocentric_m, _) in every_reference().filter(|(name, ..)| *name != "EPSG:3857") {
        let here = Vector3::from(*geocentric_m);
        for there in [-here, Vector3::new(-here.x, -here.y, here.z), Vector3::new(-here.y, here.x, here.z)] {
            assert!(crs(name).position_from_geocentric(there, None).is_err(), "{name}");
        }
    }
}

#[test]
fn it_goes_between_threads() {
    fn shared<T: Clone + Send + Sync + std::fmt::Debug>(_: &T) {}
    shared(&crs("EPSG:25832"));
}

proptest! {
    #[test]
    fn there_and_back_is_the_same_place(
        which in 0..PROJ_GRIDS.len() + PROJ_DHDN.len(), offset in prop::array::uniform2(-1e5..1e5), height_m in -1e3..1e4,
    ) {
        let (name, [x, y, _], ..) = every_reference().nth(which).unwrap();
        let (crs, position) = (crs(name), [x + offset[0], y + offset[1], height_m]);
        let geocentric_m = crs.geocentric_from_position(position, None).unwrap();
        let back = crs.position_from_geocentric(geocentric_m, None).unwrap();
        prop_assert!((Vector3::from(back) - Vector3::from(position)).norm() < 2e-8, "{name} {position:?} {back:?}");
        let axes = crs.axes_from_geocentric(geocentric_m).unwrap();
        prop_assert!((axes.matrix() * axes.matrix().transpose() - Matrix3::identity()).norm() < 1e-14);
        // the axes are those along which the coordinates grow, up to the scale of the map
        let north_m = crs.geocentric_from_position([position[0], position[1] + 10.0, height_m], None).unwrap();
        let step = (axes * (north_m - geocentric_m)).normalize();
        prop_assert!(step.x.abs() < 1e-6 && step.y > 0.999_999);
    }

    #[test]
    fn rd_new_and_back_is_the_same_place(x in -150_000.0..400_000.0, y in 280_000.0..900_000.0, height_m in -1e3..1e4) {
        let (crs, position) = (crs("EPSG:28992"), Vector3::new(x, y, height_m));
        let geocentric_m = crs.geocentric_from_position(position.into(), None).unwrap();
        let back = Vector3::from(crs.position_from_geocentric(geocentric_m, None).unwrap());
        prop_assert!((back - position).norm() < 2e-8, "{position} {back}");
    }

    #[test]
    fn no_text_makes_it_panic(text in ".{0,60}", tail in "(proj|zone|ellps|lon_0|\\+|=|EPSG:|[0-9]|utm|tmerc| ){0,20}") {
        let _ = Crs::parse(&text);
        let _ = Crs::parse(&tail);
        let _ = Crs::parse(&format!("EPSG:{text}"));
        let _ = Crs::parse(&format!("+proj=tmerc {tail}"));
    }

    #[test]
    fn any_number_gives_a_finite_answer_or_an_error(
        which in 0..PROJ_GRIDS.len() + PROJ_DHDN.len() + 1, position in prop::array::uniform3(prop::num::f64::ANY),
        near in prop::array::uniform3(-4e7..4e7),
    ) {
        let crs = crs(every_reference().nth(which).unwrap().0);
        for position in [position, near] {
            if let Ok(geocentric_m) = crs.geocentric_from_position(position, None) {
                prop_assert!(geocentric_m.iter().all(|value| value.is_finite()));
            }
            if let Ok(found) = crs.position_from_geocentric(Vector3::from(position), None) {
                prop_assert!(found.iter().all(|value| value.is_finite()));
            }
        }
    }
}
