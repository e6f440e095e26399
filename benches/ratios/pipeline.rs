//! F9: whole images, from the file to the verdict, against the plain Python pipeline of `../shared/bench/baseline`.

use anyhow::Result;
use gable::imagery::{ImageFile, Limits};
use gable::pipeline::{Observer, Stage, orient};

use super::dataset::{Dataset, Image};
use super::measure::{median, timed};
use super::peer::Peers;
use super::table::Row;

/// Runs of each image: a run takes a second.
const RUNS: usize = 5;
const LEAST_IN_VIEW: u64 = 4;

/// Nobody watches.
struct Unwatched;

impl Observer for Unwatched {
    fn progress(&self, _: Stage, _: f64) {}
}

/// Sums over the images of a dataset.
#[derive(Default)]
struct Sum {
    images: usize,
    peer_s: f64,
    ours_s: f64,
    peer_right: usize,
    ours_right: usize,
}

impl Sum {
    fn row(&self, name: &str) -> Row {
        let images = self.images as f64;
        Row {
            id: "F9",
            what: format!("{name}: an image / Python pipeline"),
            peer_s: self.peer_s / images,
            ours_s: self.ours_s / images,
            gate: 0.33,
            moonshot: 0.065,
            as_good: self.ours_right >= self.peer_right,
            note: format!(
                "within the tolerance: Python {} of {images}, ours {} of {images}",
                self.peer_right, self.ours_right
            ),
        }
    }
}

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    let mut all = Sum::default();
    for name in ["boruszyn_wire", "boruszyn", "caliterra"] {
        let folder = peers.images.join(name);
        let dataset = Dataset::read(&folder, "attitude", LEAST_IN_VIEW)?;
        let mut peer = peers.start("pipeline.py", &folder)?;
        let mut sum = Sum::default();
        for image in &dataset.images {
            let file = image.file.file_name().unwrap_or_default().to_string_lossy();
            let right = |d_max_gsd: Option<f64>| usize::from(d_max_gsd.is_some_and(|d| d <= dataset.tolerance_gsd));
            let (mut peer_s, mut ours_s) = (Vec::new(), Vec::new());
            let mut found = [None; 2];
            for _ in 0..RUNS {
                let (told, used) = peer.run(&file)?;
                peer_s.push(used);
                let (d_max, used) = timed(|| ours(&dataset, image));
                ours_s.push(used);
                found = [told["d_max_gsd"].as_f64(), d_max?];
            }
            sum.images += 1;
            sum.peer_s += median(peer_s);
            sum.ours_s += median(ours_s);
            sum.peer_right += right(found[0]);
            sum.ours_right += right(found[1]);
        }
        rows.push(sum.row(name));
        all.images += sum.images;
        all.peer_s += sum.peer_s;
        all.ours_s += sum.ours_s;
        all.peer_right += sum.peer_right;
        all.ours_right += sum.ours_right;
    }
    rows.push(all.row("all three"));
    Ok(rows)
}

/// D_max in ground sample distances.
fn ours(dataset: &Dataset, image: &Image) -> Result<Option<f64>> {
    let picture = ImageFile::open(&image.file, &Limits::default())?;
    let outcome = orient(&picture, &image.control, &image.task, &Unwatched)?;
    Ok(dataset.d_max_gsd(image, &outcome))
}
