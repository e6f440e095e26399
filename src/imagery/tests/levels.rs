//! Levels and tiles against their closed forms, overviews against averages added up one by one.

use rstest::rstest;

use super::pattern::with_file;
use super::tiff_writer::{Variant, write};
use crate::features::{Picture as _, PixelRect};
use crate::imagery::levels::{Levels, enlarged, jpeg, overview};
use crate::imagery::{ImageFile, Limits};

#[rstest]
#[case([512, 512], 0, None)]
#[case([1, 1], 0, None)]
#[case([513, 1], 1, None)]
#[case([4000, 3000], 3, None)]
#[case([4096, 4096], 3, None)]
#[case([4097, 10], 4, Some(1))]
#[case([8000, 9000], 5, Some(2))]
#[case([20_000, 20_000], 6, Some(3))]
#[case([60_000, 100], 7, Some(4))]
fn levels_halve_until_one_tile_is_enough(
    #[case] size_px: [u32; 2],
    #[case] highest: u32,
    #[case] of_overview: Option<u32>,
) {
    let levels = Levels { size_px };
    assert_eq!((levels.highest(), levels.overview()), (highest, of_overview));
}

#[rstest]
#[case([1300, 700])]
#[case([512, 1024])]
#[case([1, 5000])]
fn tiles_cover_each_level_once(#[case] size_px: [u32; 2]) {
    let levels = Levels { size_px };
    for level in 0..=levels.highest() {
        let [width, height] = size_px.map(|side| (f64::from(side) / f64::from(1 << level)).ceil() as u32);
        assert_eq!(levels.level_px(level), [width, height]);
        let (columns, rows) = (width.div_ceil(512), height.div_ceil(512));
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let tile = levels.tile(level, column, row).unwrap();
            assert_eq!([tile.x, tile.y], [512 * column, 512 * row]);
            let right = if column + 1 == columns { width } else { 512 * (column + 1) };
            let bottom = if row + 1 == rows { height } else { 512 * (row + 1) };
            assert_eq!([tile.x + tile.width, tile.y + tile.height], [right, bottom]);
        }
        assert_eq!((levels.tile(level, columns, 0), levels.tile(level, 0, rows)), (None, None));
        assert_eq!(levels.tile(level, u32::MAX, 0), None);
    }
    assert_eq!(levels.tile(levels.highest() + 1, 0, 0), None);
    assert_eq!(levels.tile(u32::MAX, 0, 0), None);
}

#[test]
fn a_tile_is_a_rectangle_of_what_it_is_cut_from() {
    let tile = PixelRect { x: 512, y: 0, width: 138, height: 350 };
    let rect = enlarged(tile, 2, [1299, 699]);
    assert_eq!(rect, PixelRect { x: 1024, y: 0, width: 275, height: 699 });
}

/// Every value from 0 to 255, without a rule that averages would hide.
fn grey(x: u32, y: u32) -> u16 {
    ((x * 37 + y * 101 + x * y % 61) % 256) as u16
}

fn assert_reduced(file: &[u8], [width, height]: [u32; 2], reduction: u32) {
    with_file(file, |path| {
        let limits = Limits::default();
        let small = overview(&ImageFile::open(path, &limits).unwrap(), path, &limits, reduction).unwrap();
        let [columns, rows] = [width, height].map(|side| side.div_ceil(reduction));
        assert_eq!(small.size_px(), [columns, rows]);
        let whole = small.window(PixelRect { x: 0, y: 0, width: columns, height: rows }, 1).unwrap();
        for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
            let (mut sum, mut count) = (0.0, 0.0);
            for y in row * reduction..height.min((row + 1) * reduction) {
                for x in column * reduction..width.min((column + 1) * reduction) {
                    sum += f64::from(grey(x, y));
                    count += 1.0;
                }
            }
            let found = f64::from(whole.grey[(row * columns + column) as usize]);
            assert!((found - sum / count).abs() <= 0.501, "({column}, {row}): {found}, not {}", sum / count);
        }
    });
}

#[rstest]
#[case::strips((None, 7))]
#[case::tiles((Some(16), 32))]
#[case::one_strip((None, 200))]
fn an_overview_has_the_averages_of_squares(#[case] chunk: (Option<u32>, u32)) {
    let size_px = [103, 97];
    let variant = Variant { chunk, photometric: 1, samples: 1, ..Variant::default() };
    for reduction in [1, 2, 8, 16] {
        assert_reduced(&write(&variant, size_px, |x, y, _| grey(x, y)), size_px, reduction);
    }
    let mut png = std::io::Cursor::new(Vec::new());
    let picture = image::GrayImage::from_fn(103, 97, |x, y| image::Luma([grey(x, y) as u8]));
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    assert_reduced(png.get_ref(), size_px, 4);
}

#[test]
fn a_damaged_strip_is_told() {
    let variant = Variant { chunk: (None, 10), photometric: 1, samples: 1, ..Variant::default() };
    let whole = write(&variant, [100, 100], |x, y, _| grey(x, y));
    with_file(&whole, |path| {
        let limits = Limits::default();
        let file = ImageFile::open(path, &limits).unwrap();
        std::fs::write(path, &whole[..whole.len() / 2]).unwrap();
        assert!(overview(&file, path, &limits, 2).is_err());
    });
}

#[test]
fn a_window_is_shown_as_it_is() {
    with_file(
        &write(&Variant { photometric: 1, samples: 1, ..Variant::default() }, [40, 30], |x, _, _| 6 * x as u16),
        |path| {
            let file = ImageFile::open(path, &Limits::default()).unwrap();
            let window = file.window(PixelRect { x: 8, y: 0, width: 32, height: 16 }, 1).unwrap();
            let shown = image::load_from_memory(&jpeg(&window, 95).unwrap()).unwrap();
            assert!(matches!(shown.color(), image::ColorType::L8));
            let shown = shown.to_luma8();
            assert_eq!(shown.dimensions(), (32, 16));
            for (x, _, pixel) in shown.enumerate_pixels() {
                assert!((i32::from(pixel[0]) - 6 * (x as i32 + 8)).abs() <= 4, "{x}: {pixel:?}");
            }
            let nothing = file.window(PixelRect { x: 40, y: 0, width: 5, height: 5 }, 1).unwrap();
            assert!(jpeg(&nothing, 90).is_err());
        },
    );
}
