//! From the lens of another program to Brown's of the contract.
//!
//! A grid of pixels over the whole image is taken back to ideal coordinates by the other model, and the contract's
//! coefficients are those that bring them to the same pixels with the least squares (method 4.3: never by changing a
//! sign). Principal distance, principal point and affinity are taken over as they are, unless the coefficients alone leave
//! too much.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::geometry::{Brown, Camera, CameraError};

/// A camera of the contract in place of another one.
#[derive(Debug, Clone)]
pub struct Conversion {
    /// The camera.
    pub camera: Camera,
    /// Whether both models are the same, so that nothing was fitted.
    pub exact: bool,
    /// What is left between the two, over the image.
    pub residuals: Vec<Residual>,
    /// The largest of them.
    pub max_px: f64,
    /// Their root mean square.
    pub rms_px: f64,
}

/// What is left at a place of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// The place.
    pub position_px: [f64; 2],
    /// The camera's pixel minus that of the other model, for the same ray.
    pub residual_px: [f64; 2],
}

/// Why there is no such camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConversionError {
    /// The other model has no ray for a pixel.
    #[error("the distortion of the file cannot be inverted at ({x_px:.0}, {y_px:.0}) px")]
    NoRay {
        /// Column.
        x_px: f64,
        /// Row.
        y_px: f64,
    },
    /// The contract's model is too far from the other one.
    #[error(
        "Brown's model with k1, k2, k3, p1, p2, b1, b2 stays {max_px:.2} px from that of the file, more than {LARGEST_PX} px"
    )]
    TooFar {
        /// The largest residual.
        max_px: f64,
    },
    /// The camera makes no sense.
    #[error("{0}")]
    Camera(#[from] CameraError),
}

/// The affine part of a lens: where its axis meets the image, and how far away it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    pub(super) principal_distance_px: f64,
    pub(super) principal_point_px: Vector2<f64>,
    pub(super) b1_px: f64,
    pub(super) b2_px: f64,
}

/// How a lens bends rays. Coordinates are those of the contract: x to the right, y down, pixels from the corner.
pub(super) enum Lens {
    /// By the contract's own model; its affine terms are those of the [`Axis`].
    Brown(Brown),
    /// Ideal points to bent ones, before the affine part.
    Bent(Box<dyn Fn(Vector2<f64>) -> Vector2<f64>>),
    /// Pixels to ideal points; the axis is approximate.
    Corrected(Box<dyn Fn(Vector2<f64>) -> Vector2<f64>>),
}

/// Above this a warning is due: about the noise of measured lines.
pub const WARN_PX: f64 = 0.1;
/// What is farther away is no conversion.
pub const LARGEST_PX: f64 = 2.0;
/// As long as the coefficients alone leave no more, the axis stays as it is.
const ENOUGH_PX: f64 = 0.05;

/// Places that are told, and from which the coefficients are found, across and down.
const TOLD: [usize; 2] = [13, 9];
const FITTED: [usize; 2] = [33, 25];

impl Axis {
    fn matrix(&self) -> Matrix2<f64> {
        let c = self.principal_distance_px;
        Matrix2::new(c + self.b1_px, self.b2_px, 0.0, c)
    }
}

/// The camera of the contract that does what a lens does.
///
/// # Errors
/// [`ConversionError`].
pub(super) fn convert(size_px: [u32; 2], axis: &Axis, lens: &Lens) -> Result<Conversion, ConversionError> {
    if let Lens::Brown(brown) = lens {
        let brown = Brown { b1_px: axis.b1_px, b2_px: axis.b2_px, ..*brown };
        let camera = Camera::new(size_px, axis.principal_distance_px, axis.principal_point_px, brown)?;
        return told(camera, true, |pixel| camera.ideal_from_pixel(pixel));
    }
    // the least that must be so before anything is computed with it
    Camera::new(size_px, axis.principal_distance_px, axis.principal_point_px, Brown::default())?;
    let ideal = |pixel| ideal_from_pixel(axis, lens, pixel);
    let places = places(size_px, FITTED).map(|pixel| Ok((ideal(pixel).ok_or(no_ray(pixel))?, pixel)));
    let places: Vec<_> = places.collect::<Result<_, ConversionError>>()?;
    let axis = match lens {
        Lens::Corrected(ideal) => axis_of(axis, ideal.as_ref()),
        _ => *axis,
    };
    let alone = Parameters::with_axis(&axis, &places);
    let best = if alone.largest_px(&places) <= ENOUGH_PX { alone } else { alone.all_free(&places) };
    told(best.camera(size_px)?, false, ideal)
}

fn told(
    camera: Camera,
    exact: bool,
    ideal: impl Fn(Vector2<f64>) -> Option<Vector2<f64>>,
) -> Result<Conversion, ConversionError> {
    let at = |pixel: Vector2<f64>| {
        let residual = camera.pixel_from_ideal(ideal(pixel).ok_or(no_ray(pixel))?) - pixel;
        Ok(Residual { position_px: pixel.into(), residual_px: residual.into() })
    };
    let residuals: Vec<Residual> =
        places([camera.width_px, camera.height_px], TOLD).map(at).collect::<Result<_, ConversionError>>()?;
    let lengths_px: Vec<f64> = residuals.iter().map(|at| Vector2::from(at.residual_px).norm()).collect();
    let max_px = lengths_px.iter().fold(0.0, |max: f64, length| max.max(*length));
    let rms_px = (lengths_px.iter().map(|length| length * length).sum::<f64>() / lengths_px.len() as f64).sqrt();
    if max_px.is_nan() || max_px > LARGEST_PX {
        return Err(ConversionError::TooFar { max_px });
    }
    Ok(Conversion { camera, exact, residuals, max_px, rms_px })
}

fn no_ray(pixel: Vector2<f64>) -> ConversionError {
    ConversionError::NoRay { x_px: pixel.x, y_px: pixel.y }
}

/// A regular grid from corner to corner.
fn places([width, height]: [u32; 2], [across, down]: [usize; 2]) -> impl Iterator<Item = Vector2<f64>> {
    let share = |k: usize, of: usize| k as f64 / (of - 1) as f64;
    (0..down).flat_map(move |row| {
        (0..across).map(move |column| {
            Vector2::new(f64::from(width) * share(column, across), f64::from(height) * share(row, down))
        })
    })
}

/// The ideal point of a pixel by the other model.
fn ideal_from_pixel(axis: &Axis, lens: &Lens, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
    let bent = axis.matrix().try_inverse()? * (pixel - axis.principal_point_px);
    match lens {
        Lens::Brown(_) => None,
        Lens::Bent(bend) => inverted(bend.as_ref(), bent),
        Lens::Corrected(ideal) => Some(ideal(pixel)).filter(|ideal| ideal.iter().all(|v| v.is_finite())),
    }
}

/// The point that is bent to another one, by Newton's method.
fn inverted(bend: &dyn Fn(Vector2<f64>) -> Vector2<f64>, bent: Vector2<f64>) -> Option<Vector2<f64>> {
    const STEPS: usize = 50;
    const STEP: f64 = 1e-6;
    let mut ideal = bent;
    for _ in 0..STEPS {
        let missing = bent - bend(ideal);
        if missing.norm() < 1e-13 {
            return Some(ideal);
        }
        let along = |axis| {
            let h = Vector2::ith(axis, STEP);
            (bend(ideal + h) - bend(ideal - h)) / (2.0 * STEP)
        };
        let jacobian = Matrix2::from_columns(&[along(0), along(1)]);
        // beyond a fold the image would be mirrored
        let inverse = jacobian.try_inverse().filter(|_| jacobian.determinant() > 0.0)?;
        ideal += inverse * missing;
    }
    Some(ideal).filter(|ideal| (bent - bend(*ideal)).norm() < 1e-9)
}

/// The axis of a lens that is known from pixels to rays: where the ray is ideal zero, and the scale there.
fn axis_of(approximate: &Axis, ideal: &dyn Fn(Vector2<f64>) -> Vector2<f64>) -> Axis {
    const STEP_PX: f64 = 0.5;
    let mut axis = *approximate;
    for _ in 0..10 {
        let at = axis.principal_point_px;
        let along = |k| (ideal(at + Vector2::ith(k, STEP_PX)) - ideal(at - Vector2::ith(k, STEP_PX))) / (2.0 * STEP_PX);
        let Some(scale) = Matrix2::from_columns(&[along(0), along(1)]).try_inverse() else { return *approximate };
        axis.principal_point_px -= scale * ideal(at);
        axis.principal_distance_px = scale.m22;
        axis.b1_px = scale.m11 - scale.m22;
        axis.b2_px = scale.m12;
    }
    let finite = axis.principal_point_px.iter().all(|v| v.is_finite()) && axis.principal_distance_px > 0.0;
    if finite { axis } else { *approximate }
}

/// Axis and coefficients while they are being found.
#[derive(Debug, Clone, Copy)]
struct Parameters {
    axis: Axis,
    brown: Brown,
}

/// Ideal points and their pixels.
type Places = [(Vector2<f64>, Vector2<f64>)];

impl Parameters {
    /// The best coefficients with an axis: a linear task.
    fn with_axis(axis: &Axis, places: &Places) -> Self {
        let matrix = axis.matrix();
        let rows = places.len();
        let mut design = DMatrix::zeros(2 * rows, 5);
        let mut wanted = DVector::zeros(2 * rows);
        for (row, (ideal, pixel)) in places.iter().enumerate() {
            let missing = pixel - axis.principal_point_px - matrix * ideal;
            wanted.rows_mut(2 * row, 2).copy_from(&missing);
            for (column, by) in bends(*ideal).into_iter().enumerate() {
                design.view_mut((2 * row, column), (2, 1)).copy_from(&(matrix * by));
            }
        }
        let [k1, k2, k3, p1, p2] = solved(design, &wanted).map_or([0.0; 5], |found| std::array::from_fn(|k| found[k]));
        let brown = Brown { k1, k2, k3, p1, p2, b1_px: axis.b1_px, b2_px: axis.b2_px };
        Self { axis: *axis, brown }
    }

    /// The best axis and coefficients, from here on by Gauss and Newton.
    fn all_free(self, places: &Places) -> Self {
        let mut best = self;
        for _ in 0..20 {
            let mut design = DMatrix::zeros(2 * places.len(), 10);
            let mut wanted = DVector::zeros(2 * places.len());
            let matrix = best.axis.matrix();
            for (row, (ideal, pixel)) in places.iter().enumerate() {
                let bent = best.bent(*ideal);
                wanted.rows_mut(2 * row, 2).copy_from(&(pixel - best.axis.principal_point_px - matrix * bent));
                let affine = [bent, Vector2::x(), Vector2::y(), Vector2::new(bent.x, 0.0), Vector2::new(bent.y, 0.0)];
                let by = affine.into_iter().chain(bends(*ideal).into_iter().map(|by| matrix * by));
                for (column, by) in by.enumerate() {
                    design.view_mut((2 * row, column), (2, 1)).copy_from(&by);
                }
            }
            let Some(step) = solved(design, &wanted) else { break };
            let next = best.moved(&step);
            let better = next.sum_px2(places) < best.sum_px2(places) * (1.0 - 1e-9);
            if !better {
                break;
            }
            best = next;
        }
        best
    }

    fn moved(mut self, step: &DVector<f64>) -> Self {
        self.axis.principal_distance_px += step[0];
        self.axis.principal_point_px += Vector2::new(step[1], step[2]);
        self.axis.b1_px += step[3];
        self.axis.b2_px += step[4];
        let Brown { k1, k2, k3, p1, p2, .. } = self.brown;
        self.brown = Brown {
            k1: k1 + step[5],
            k2: k2 + step[6],
            k3: k3 + step[7],
            p1: p1 + step[8],
            p2: p2 + step[9],
            b1_px: self.axis.b1_px,
            b2_px: self.axis.b2_px,
        };
        self
    }

    fn bent(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let Brown { k1, k2, k3, p1, p2, .. } = self.brown;
        let terms = bends(ideal).into_iter().zip([k1, k2, k3, p1, p2]);
        ideal + terms.map(|(by, coefficient)| by * coefficient).sum::<Vector2<f64>>()
    }

    fn residual_px(&self, (ideal, pixel): &(Vector2<f64>, Vector2<f64>)) -> Vector2<f64> {
        self.axis.principal_point_px + self.axis.matrix() * self.bent(*ideal) - pixel
    }

    fn largest_px(&self, places: &Places) -> f64 {
        places.iter().map(|place| self.residual_px(place).norm()).fold(0.0, f64::max)
    }

    fn sum_px2(&self, places: &Places) -> f64 {
        places.iter().map(|place| self.residual_px(place).norm_squared()).sum()
    }

    fn camera(&self, size_px: [u32; 2]) -> Result<Camera, CameraError> {
        Camera::new(size_px, self.axis.principal_distance_px, self.axis.principal_point_px, self.brown)
    }
}

/// What k1, k2, k3, p1 and p2 each do to an ideal point.
fn bends(ideal: Vector2<f64>) -> [Vector2<f64>; 5] {
    let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
    [
        ideal * r2,
        ideal * r2 * r2,
        ideal * r2 * r2 * r2,
        Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
        Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
    ]
}

/// Least squares with columns of one size, so that high powers count as much as low ones.
fn solved(mut design: DMatrix<f64>, wanted: &DVector<f64>) -> Option<DVector<f64>> {
    let sizes: Vec<f64> = design.column_iter().map(|column| column.norm().max(f64::MIN_POSITIVE)).collect();
    for (mut column, size) in design.column_iter_mut().zip(&sizes) {
        column /= *size;
    }
    let mut found = design.svd(true, true).solve(wanted, 1e-12).ok()?;
    for (value, size) in found.iter_mut().zip(&sizes) {
        *value /= size;
    }
    found.iter().all(|value| value.is_finite()).then_some(found)
}
