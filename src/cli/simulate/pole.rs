//! `gable simulate --pole`: a picture from a pole with what `gable scene rectify` needs of it.

use std::path::Path;

use crate::simulation::{TEMPLATE_M, TerrestrialView};
use anyhow::Context as _;
use image::GrayImage;
use nalgebra::Vector2;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::super::print;
use super::quoted;

/// A camera of three megapixels.
const WIDTH_PX: u32 = 2128;
/// As well as targets are measured by eye.
const SIGMA_TARGET_PX: f64 = 0.2;
/// Slabs of the yard along a side, and a side of one.
const SLABS: usize = 64;
const SLAB_M: f64 = 0.4;
const JOINT_M: f64 = 0.02;

/// Writes the picture, the camera and the targets; prints the command that rectifies it.
pub(super) fn write(seed: u64, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let view = TerrestrialView::from_a_pole(WIDTH_PX)?;
    let slabs = slabs(seed);
    let [width, height] = view.camera.size_px();
    let picture = GrayImage::from_raw(width, height, view.photograph(&|at_m| yard(&slabs, at_m), seed));
    let targets = view.targets(&TEMPLATE_M, SIGMA_TARGET_PX, seed);
    let file = |name: &str| folder.join(name);
    picture.context("a picture has as many pixels as its size says")?.save(file("pole.png"))?;
    std::fs::write(file("fisheye.json"), view.camera_body().to_string())?;
    std::fs::write(file("target.json"), TerrestrialView::targets_body(&targets).to_string())?;
    let word = |name: &str| quoted(&file(name).to_string_lossy());
    print(&format!(
        "{}: a paved yard from a pole of {} m\n\nRectify it with\n  gable scene rectify {} --camera {} --target {} \
         --crs EPSG:25832 --reference 565012.31,5934410.72,45.1 --bearing-deg {:.2} --sigma-px 0.2 --name yard --out {}",
        folder.display(),
        view.height_m,
        word("pole.png"),
        word("fisheye.json"),
        word("target.json"),
        view.azimuth_of_y_rad.to_degrees(),
        word("scenes"),
    ))
}

/// The grey of each slab.
fn slabs(seed: u64) -> Vec<f64> {
    let mut draws = ChaCha8Rng::seed_from_u64(seed);
    (0..SLABS * SLABS).map(|_| draws.random_range(90.0..200.0)).collect()
}

/// Slabs with dark joints between them.
fn yard(slabs: &[f64], at_m: Vector2<f64>) -> f64 {
    let within = at_m.map(|v| v.rem_euclid(SLAB_M));
    if within.min() < JOINT_M {
        return 60.0;
    }
    let [column, row] = [at_m.x, at_m.y].map(|v| (v / SLAB_M).floor().rem_euclid(SLABS as f64) as usize);
    slabs[(row * SLABS + column) % slabs.len()]
}
