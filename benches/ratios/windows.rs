//! F3: windows out of large tiled TIFFs, against GDAL.

use anyhow::{Context as _, Result};
use gable::features::{Picture as _, PixelRect};
use gable::imagery::{ImageFile, Limits};

use super::measure::compare;
use super::peer::{Peers, write_array};
use super::table::Row;

const WINDOWS: u32 = 20;
const SIDE_PX: u32 = 250;
const SIDES_PX: [u32; 2] = [4_000, 16_000];

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for side in SIDES_PX {
        let path = peers.cache.join(format!("tiles_{side}.tif"));
        let path_text = path.to_str().context("a path that is text")?;
        if !path.exists() {
            let picture = peers.images.join("boruszyn/images/img_4929.jpg");
            let picture = picture.to_str().context("a path that is text")?;
            peers.once("windows.py", &["make", path_text, &side.to_string(), picture])?;
        }
        // scattered evenly: multiples of the golden ratio and of the square root of two, modulo one
        let place = |k: u32, step: f64| ((f64::from(k) * step).fract() * f64::from(side - SIDE_PX)) as u32;
        let rects: Vec<PixelRect> = (1..=WINDOWS)
            .map(|k| PixelRect {
                x: place(k, 1.618_034),
                y: place(k, std::f64::consts::SQRT_2),
                width: SIDE_PX,
                height: SIDE_PX,
            })
            .collect();
        let folder = tempfile::tempdir()?;
        let numbers = rects.iter().flat_map(|r| [r.x, r.y, r.width, r.height].map(f64::from));
        write_array(folder.path(), "windows", numbers)?;
        let mut peer = peers.start("windows.py", folder.path())?;
        let compared = compare(&mut peer, path_text, || {
            let picture = ImageFile::open(&path, &Limits::default())?;
            let mut sum = 0.0;
            for rect in &rects {
                sum += picture.window(*rect, 1)?.grey.iter().map(|grey| f64::from(*grey)).sum::<f64>();
            }
            Ok(sum)
        })?;
        let same = compared.told["sum"].as_f64() == Some(compared.made);
        rows.push(Row {
            id: "F3",
            what: format!("{WINDOWS} windows of a tiled TIFF of {side} px a side / GDAL"),
            peer_s: compared.peer_s,
            ours_s: compared.ours_s,
            gate: 1.2,
            moonshot: 0.7,
            as_good: same,
            note: format!("the file opened once; the same grey values: {same}"),
        });
    }
    if let [small, large] = &mut rows[..] {
        // the law of growth is a part of the moonshot
        if large.ours_s > 1.1 * small.ours_s {
            large.moonshot = 0.0;
        }
        large.note += &format!("; 16 times the pixels take {:.2} times as long", large.ours_s / small.ours_s);
    }
    Ok(rows)
}
