//! `gable simulate --mixture`: the study.

use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::jobs::active::shipped_classifier;
use crate::learning::Classifier;
use crate::study::{self, Mixture, Row, paper, plot, table};
use anyhow::{Context as _, bail};
use indicatif::{ProgressBar, ProgressStyle};
use rustix::time::{ClockId, clock_gettime};

use super::super::print;
use super::rows::{Examined, Manifest, RowsFile};

/// Studies `images` images of a mixture from a first seed on, and leaves rows, table and plot in a folder.
pub(super) fn study(mixture: Mixture, seeds: std::ops::Range<u64>, folder: &Path) -> anyhow::Result<()> {
    let (file, before) = RowsFile::open(folder, &Manifest::of(mixture)?)?;
    let decides = shipped_classifier()?;
    let done: std::collections::HashSet<u64> = before.iter().map(|image| image.row.seed).collect();
    let missing: Vec<u64> = seeds.clone().filter(|seed| !done.contains(seed)).collect();
    let bar = bar(seeds.end - seeds.start, seeds.end - seeds.start - missing.len() as u64);
    let writer = Mutex::new((file, before));
    let first_error = in_parallel(&missing, |seed| {
        let image = examined(mixture, seed, &decides.loaded.classifier)?;
        let mut writer = writer.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        writer.0.append(&image)?;
        writer.1.push(image);
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    first_error?;
    let (file, mut images) = writer.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    images.sort_by_key(|image| image.row.seed);
    file.replace(&images)?;
    let asked: Vec<Row> = images.into_iter().map(|image| image.row).filter(|row| seeds.contains(&row.seed)).collect();
    let table = table::table(mixture, &asked);
    for (name, text) in [("table.md", &table), ("errors.svg", &plot::plot(&asked))] {
        let path = folder.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    print(&table)
}

/// Works through the seeds on all cores, an image on a core at a time, and ends at the first error.
///
/// Every worker is a pool of its own with one thread: what the stages would do in parallel stays within it, so that
/// its thread's clock counts one image and cores do not wait for one another.
pub(super) fn in_parallel(seeds: &[u64], work: impl Fn(u64) -> anyhow::Result<()> + Sync) -> anyhow::Result<()> {
    let next = AtomicU64::new(0);
    let stopped = AtomicBool::new(false);
    let worker = || -> anyhow::Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
        while let Some(&seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed) as usize) {
            if stopped.load(Ordering::Relaxed) {
                break;
            }
            // a panic must not let the others go on for hours
            let caught = std::panic::catch_unwind(AssertUnwindSafe(|| pool.install(|| work(seed))));
            let done = caught.unwrap_or_else(|_| Err(anyhow::anyhow!("seed {seed}: a panic; see the message above")));
            done.inspect_err(|_| stopped.store(true, Ordering::Relaxed))?;
        }
        Ok(())
    };
    let workers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        let ended = handles.into_iter().map(|handle| handle.join().unwrap_or_else(|_| bail!("a worker has panicked")));
        // all of them, before the first error counts
        ended.collect::<Vec<_>>().into_iter().collect()
    })
}

/// One image, with the times it took.
fn examined(mixture: Mixture, seed: u64, classifier: &Arc<Classifier>) -> anyhow::Result<Examined> {
    let begin = thread_seconds();
    let scene = mixture.scene(seed)?;
    let photograph = scene.picture();
    let picture = Timed::new(&photograph);
    let drawn = thread_seconds();
    let outcome = study::oriented(&scene, &picture, mixture.tolerance_gsd(seed), classifier)
        .with_context(|| format!("seed {seed}"))?;
    let (oriented, rendered_first) = (thread_seconds(), picture.seconds());
    let by_paper = paper::orient(&picture, &scene.control_points(), &scene.camera, &scene.approximation)
        .with_context(|| format!("seed {seed}"))?;
    let (end, rendered) = (thread_seconds(), picture.seconds());
    let row = Row {
        render_seconds: drawn - begin + rendered,
        pipeline_seconds: oriented - drawn - rendered_first,
        paper_seconds: end - oriented - (rendered - rendered_first),
        ..Row::new(mixture, &scene, &outcome, &by_paper)
    };
    Ok(Examined { row, labelled: study::labelled(mixture, &scene, &outcome) })
}

/// Processor time of this thread.
pub(super) fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// A picture that knows how long its windows took.
pub(super) struct Timed<'a> {
    picture: &'a dyn Picture,
    nanoseconds: AtomicU64,
}

impl<'a> Timed<'a> {
    pub(super) fn new(picture: &'a dyn Picture) -> Self {
        Self { picture, nanoseconds: AtomicU64::new(0) }
    }

    pub(super) fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 * 1e-9
    }
}

impl Picture for Timed<'_> {
    fn size_px(&self) -> [u32; 2] {
        self.picture.size_px()
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let begin = thread_seconds();
        let window = self.picture.window(rect, reduction);
        self.nanoseconds.fetch_add(((thread_seconds() - begin) * 1e9) as u64, Ordering::Relaxed);
        window
    }
}

pub(super) fn bar(images: u64, done: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{wide_bar} {pos}/{len} images, {per_sec}, {eta} to go");
    let bar = ProgressBar::new(images).with_position(done);
    bar.reset_eta();
    style.map_or(bar.clone(), |style| bar.with_style(style))
}
