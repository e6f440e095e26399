//! The place of a scene's reference to a part of a pixel: least-squares matching of the picture around it with the image
//! (Ackermann 1984; Förstner 1982), with its covariance.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::rendering::Rendering;
use super::resample::bilinear;
use super::{Scene, View};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};

/// The reference of a scene, measured in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Where it is, reduced pixels.
    pub at_px: Vector2<f64>,
    /// Covariance of that.
    pub covariance: Matrix2<f64>,
    /// Correlation coefficient of the two pictures there.
    pub correlation: f64,
}

/// Half the side of the patch around the reference: what is farther away may lie at another height.
const HALF_CELLS: usize = 24;
/// How far from where it is expected the patch is looked for.
pub const SEARCH_CELLS: usize = 8;
/// At least so much of the patch must lie in the scene.
const LEAST_SHARE: f64 = 0.6;
/// Pictures that resemble each other less were not taken of the same thing.
const LEAST_CORRELATION: f64 = 0.5;
const ITERATIONS: usize = 15;
const SETTLED_CELLS: f64 = 0.003;
/// Standard deviation of the affine part of the map: what turn, scale and perspective of the prediction leave open.
const SIGMA_AFFINE: f64 = 0.05;

type Normal = SMatrix<f64, 8, 8>;
type Parameters = SVector<f64, 8>;

/// Measures the reference of a scene near `start_px` (reduced); `None` if nothing there resembles it.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read there.
pub fn measure(
    picture: &dyn Picture,
    scene: &Scene,
    view: &View,
    start_px: Vector2<f64>,
    reduction: u32,
) -> Result<Option<Measured>, PictureError> {
    let side = 2 * HALF_CELLS + 1;
    let middle = Vector2::repeat(side as f64 / 2.0);
    let by_scene = view.file_by_scene(scene).map(|file_by_scene| file_by_scene / f64::from(reduction));
    let Some(patch) = by_scene.and_then(|by_scene| Rendering::part(scene, &by_scene, middle, [side; 2])) else {
        return Ok(None);
    };
    let pixel = view.camera.pixel_from_reduced(start_px);
    let Some(window) = window_about(picture, pixel, reduction)? else { return Ok(None) };
    let origin = Vector2::from(window.origin_px.map(f64::from));
    let start = (pixel - origin) / f64::from(reduction);
    let matching = Matching::new(&patch, scene, &window, middle);
    let fitted = matching.and_then(|matching| matching.fitted(matching.most_alike(start)?));
    Ok(fitted.and_then(|fitted| {
        let at_px = view.camera.reduced_from_pixel(origin + fitted.at * f64::from(reduction))?;
        // beyond the distortion, pixels are reduced pixels, turned and reflected
        let back = view.camera.pixel_by_reduced().try_inverse()? * f64::from(reduction);
        Some(Measured {
            at_px,
            covariance: back * fitted.covariance * back.transpose(),
            correlation: fitted.correlation,
        })
    }))
}

fn window_about(
    picture: &dyn Picture,
    pixel: Vector2<f64>,
    reduction: u32,
) -> Result<Option<GreyWindow>, PictureError> {
    let reach_px = (HALF_CELLS + SEARCH_CELLS + 6) as f64 * f64::from(reduction);
    let [width, height] = picture.size_px().map(f64::from);
    if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height) {
        return Ok(None);
    }
    let least = (pixel - Vector2::repeat(reach_px)).map(|v| v.floor().max(0.0));
    let largest = (pixel + Vector2::repeat(reach_px)).map(f64::ceil).inf(&Vector2::new(width, height));
    let size = largest - least;
    let rect = PixelRect { x: least.x as u32, y: least.y as u32, width: size.x as u32, height: size.y as u32 };
    picture.window(rect, reduction).map(Some)
}

/// A cell of the patch that lies in the scene: its place from the reference, its grey value and how that changes. The
/// patch is smoother than the image: gradients taken from noise would shorten all steps.
#[derive(Clone, Copy)]
struct Cell {
    from: Vector2<f64>,
    grey: f64,
    gradient: Vector2<f64>,
}

struct Matching<'a> {
    cells: Vec<Cell>,
    window: &'a GreyWindow,
}

struct Fitted {
    at: Vector2<f64>,
    covariance: Matrix2<f64>,
    correlation: f64,
}

impl<'a> Matching<'a> {
    fn new(patch: &Rendering, scene: &Scene, window: &'a GreyWindow, middle: Vector2<f64>) -> Option<Self> {
        let mut cells = Vec::with_capacity(patch.grey.len());
        for (k, grey) in patch.grey.iter().enumerate() {
            let (column, row) = (k % patch.width, k / patch.width);
            if column == 0 || row == 0 || column + 1 == patch.width || row + 1 == patch.height {
                continue;
            }
            let change = |step: usize| f64::from(patch.grey[k + step] - patch.grey[k - step]) / 2.0;
            let gradient = Vector2::new(change(1), change(patch.width));
            let cell = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
            let at = patch.scene_px(cell);
            let inside = |v: f64, size: usize| v >= 0.5 && v <= size as f64 - 0.5;
            if inside(at.x, scene.width) && inside(at.y, scene.height) {
                cells.push(Cell { from: cell - middle, grey: f64::from(*grey), gradient });
            }
        }
        let enough = cells.len() as f64 >= LEAST_SHARE * patch.grey.len() as f64;
        (enough && window.width > 2 && window.height > 2).then_some(Self { cells, window })
    }

    fn seen(&self, at: Vector2<f64>) -> Option<f64> {
        let inside = |v: f64, size: usize| v >= 1.0 && v <= size as f64 - 1.0;
        let on = inside(at.x, self.window.width) && inside(at.y, self.window.height);
        on.then(|| bilinear(&self.window.grey, [self.window.width, self.window.height], at))
    }

    /// The place around `start`, to a cell, where the two are most alike.
    fn most_alike(&self, start: Vector2<f64>) -> Option<Vector2<f64>> {
        let reach = SEARCH_CELLS as i32;
        let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| Vector2::new(x, y).cast::<f64>()));
        let alike = places.filter_map(|step| {
            // every second cell of every second row tells enough
            let some = self.cells.iter().step_by(3);
            let correlation = self.correlation(some, |cell| start + step + cell.from)?;
            Some((start + step, correlation))
        });
        alike.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
    }

    fn correlation<'c>(
        &self,
        cells: impl Iterator<Item = &'c Cell>,
        at: impl Fn(&Cell) -> Vector2<f64>,
    ) -> Option<f64> {
        let mut sums = [0.0; 5];
        let (mut count, mut all) = (0.0, 0.0);
        for cell in cells {
            all += 1.0;
            let Some(seen) = self.seen(at(cell)) else { continue };
            count += 1.0;
            let terms = [cell.grey, seen, cell.grey * cell.grey, seen * seen, cell.grey * seen];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        let [a, b, aa, bb, ab] = sums.map(|sum| sum / f64::max(count, 1.0));
        let variances = (aa - a * a) * (bb - b * b);
        (count >= LEAST_SHARE * all && variances > 0.0).then(|| (ab - a * b) / variances.sqrt())
    }

    /// Gauss and Newton over shift, the four other parameters of an affine map, gain and offset of the grey values.
    fn fitted(&self, start: Vector2<f64>) -> Option<Fitted> {
        let mut shift = start;
        let mut affine = Matrix2::identity();
        let (mut gain, mut offset) = self.radiometry(start)?;
        let mut last = None;
        for _ in 0..ITERATIONS {
            let place = |cell: &Cell| shift + affine * cell.from;
            let (normal, side, squares, count, neighbours) = self.equations(&place, &affine, gain, offset)?;
            let covariance = normal.try_inverse()?;
            let step: Parameters = covariance * side;
            shift += Vector2::new(step[0], step[1]);
            affine += Matrix2::new(step[2], step[3], step[4], step[5]);
            gain += step[6];
            offset += step[7];
            if (shift - start).amax() > (SEARCH_CELLS + 3) as f64 || !gain.is_finite() {
                return None;
            }
            last = Some((covariance, squares, count, neighbours));
            if step.fixed_rows::<2>(0).amax() < SETTLED_CELLS {
                break;
            }
        }
        let (covariance, squares, count, neighbours) = last?;
        let correlation = self.correlation(self.cells.iter(), |cell| shift + affine * cell.from)?;
        if correlation < LEAST_CORRELATION || gain <= 0.0 || count <= 8.0 {
            return None;
        }
        // residuals of neighbours are alike: fewer of them are independent, along both axes
        let alike = (neighbours / squares.max(f64::MIN_POSITIVE)).clamp(0.0, 0.9);
        let inflation = ((1.0 + alike) / (1.0 - alike)).powi(2);
        // the equations are in units of the prior's weights, which take the variance of a grey value as 1
        let variance = squares / (count - 8.0) * inflation;
        let covariance = covariance.fixed_view::<2, 2>(0, 0) * variance;
        Some(Fitted { at: shift, covariance, correlation })
    }

    /// Gain and offset by which the patch comes nearest to the image.
    fn radiometry(&self, start: Vector2<f64>) -> Option<(f64, f64)> {
        let (mut count, mut sums) = (0.0, [0.0; 4]);
        for cell in &self.cells {
            let Some(seen) = self.seen(start + cell.from) else { continue };
            count += 1.0;
            let terms = [cell.grey, seen, cell.grey * cell.grey, cell.grey * seen];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        let [a, b, aa, ab] = sums.map(|sum| sum / f64::max(count, 1.0));
        let variance = aa - a * a;
        (count > 8.0 && variance > 0.0).then(|| {
            let gain = (ab - a * b) / variance;
            (gain, b - gain * a)
        })
    }

    /// Normal equations of `gain patch + offset - image`, with the sum of squares, the number of cells and the sum of
    /// products of neighbouring residuals.
    #[allow(clippy::type_complexity, reason = "the sums of one pass")]
    fn equations(
        &self,
        place: &impl Fn(&Cell) -> Vector2<f64>,
        affine: &Matrix2<f64>,
        gain: f64,
        offset: f64,
    ) -> Option<(Normal, Parameters, f64, f64, f64)> {
        let (mut normal, mut side) = (Normal::zeros(), Parameters::zeros());
        let (mut squares, mut count, mut neighbours) = (0.0, 0.0, 0.0);
        let mut before: Option<(Vector2<f64>, f64)> = None;
        for cell in &self.cells {
            let at = place(cell);
            let Some(seen) = self.seen(at) else { continue };
            let [by_x, by_y]: [f64; 2] = (cell.gradient * gain).into();
            let residual = gain * cell.grey + offset - seen;
            let (x, y) = (cell.from.x, cell.from.y);
            let row = Parameters::from([by_x, by_y, by_x * x, by_x * y, by_y * x, by_y * y, -cell.grey, -1.0]);
            normal.syger(1.0, &row, &row, 1.0);
            side += row * residual;
            squares += residual * residual;
            count += 1.0;
            if let Some((from, other)) = before
                && (cell.from - from).norm() < 1.5
            {
                neighbours += residual * other;
            }
            before = Some((cell.from, residual));
        }
        if count <= 8.0 {
            return None;
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let weight = SIGMA_AFFINE.powi(-2) * (squares / count).max(1e-6);
        for (k, (value, expected)) in affine.transpose().iter().zip([1.0, 0.0, 0.0, 1.0]).enumerate() {
            normal[(2 + k, 2 + k)] += weight;
            side[2 + k] += weight * (expected - value);
        }
        Some((normal, side, squares, count, neighbours))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::geometry::{Brown, Camera, ExteriorOrientation, rotation};
    use crate::scenes::tests::{Country, Drawn};

    fn orientation(east_m: f64) -> ExteriorOrientation {
        ExteriorOrientation {
            projection_centre_m: Vector3::new(east_m, 0.0, 100.0),
            camera_from_object: rotation::camera_from_object(0.05, -0.04, 0.7),
        }
    }

    /// The scatter of a measured reference over many noises is what its covariance claims.
    #[test]
    fn the_covariance_is_the_scatter() {
        const RUNS: u64 = 60;
        let camera = Camera::new([400, 300], 1000.0, Vector2::new(200.0, 150.0), Brown::default()).unwrap();
        let country = Country::new(3);
        let reference_m = Vector3::new(-3.2, 4.1, 0.0);
        let scene = country.scene(reference_m.xy(), 0.05, 12.0, 0.4);
        let (mut squares, mut claimed) = (0.0, 0.0);
        for run in 0..RUNS {
            let truth = orientation(run as f64 * 0.013);
            let picture = Drawn::photograph(&country, &camera, &truth, 20.0, run);
            // seen from where it is thought to be
            let thought =
                ExteriorOrientation { camera_from_object: rotation::camera_from_object(0.052, -0.037, 0.71), ..truth };
            let view = View { camera: &camera, orientation: &thought, reference_m };
            let true_px = truth.reduced_px(1000.0, reference_m).unwrap();
            let start_px = true_px + Vector2::new(3.3, -2.4);
            let measured = measure(&picture, &scene, &view, start_px, 1).unwrap().unwrap();
            assert!(measured.correlation > 0.8, "{measured:?}");
            let away = measured.at_px - true_px;
            assert!(away.norm() < 0.3, "{away} {measured:?}");
            squares += away.norm_squared() / RUNS as f64;
            claimed += measured.covariance.trace() / RUNS as f64;
        }
        assert!(squares < 2.0 * claimed && squares > claimed / 4.0, "{squares} {claimed}");
    }

    #[test]
    fn another_place_does_not_resemble_it() {
        let camera = Camera::new([400, 300], 1000.0, Vector2::new(200.0, 150.0), Brown::default()).unwrap();
        let (here, elsewhere) = (Country::new(3), Country::new(4));
        let truth = orientation(0.0);
        let picture = Drawn::photograph(&here, &camera, &truth, 4.0, 1);
        for k in 0..20 {
            let reference_m = Vector3::new(f64::from(k % 5) * 3.0 - 6.0, f64::from(k / 5) * 3.0 - 4.0, 0.0);
            let scene = elsewhere.scene(reference_m.xy(), 0.05, 12.0, 0.0);
            let view = View { camera: &camera, orientation: &truth, reference_m };
            let start_px = truth.reduced_px(1000.0, reference_m).unwrap();
            let measured = measure(&picture, &scene, &view, start_px, 1).unwrap();
            assert!(measured.is_none_or(|m| m.correlation < 0.7), "{measured:?}");
        }
    }

    #[test]
    fn outside_of_the_picture_nothing_is_measured() {
        let camera = Camera::new([400, 300], 1000.0, Vector2::new(200.0, 150.0), Brown::default()).unwrap();
        let country = Country::new(3);
        let truth = orientation(0.0);
        let picture = Drawn::photograph(&country, &camera, &truth, 4.0, 1);
        let scene = country.scene(Vector2::new(60.0, 0.0), 0.05, 12.0, 0.0);
        let view = View { camera: &camera, orientation: &truth, reference_m: Vector3::new(60.0, 0.0, 0.0) };
        let start_px = truth.reduced_px(1000.0, view.reference_m).unwrap();
        assert_eq!(measure(&picture, &scene, &view, start_px, 1).unwrap(), None);
    }
}
