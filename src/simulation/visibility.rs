//! Which surface does a ray of the camera meet first? Polygons against a depth buffer, in tiles.
//!
//! Everything is decided in ideal image coordinates, where straight edges are straight; the distortion enters only
//! through the places at which rays are taken. They are found exactly at every fourth pixel and interpolated between
//! (the error is below 0.001 px for any lens that bends straight lines by less than a few per cent).

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::draws::floor_and_rest;
use super::surface::{Face, Patch, Puff};
use super::terrain::Terrain;
use crate::geometry::{Camera, ExteriorOrientation};

/// Pixels along one side of a tile.
pub(crate) const TILE_PX: usize = 32;
const NODE_PX: usize = 4;
const NODES: usize = TILE_PX / NODE_PX + 1;

/// Nothing is seen that is nearer to the camera.
const NEAREST_M: f64 = 0.5;

/// On long sides of a patch the ground may rise and fall between the corners.
const LONGEST_SIDE_M: f64 = 15.0;

/// What a ray meets; the numbers are places in the lists of the town.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Surface {
    Meadow,
    Patch(u32),
    Face(u32),
    Puff(u32),
}

/// The camera in its place: rays and projections between ideal coordinates (x right, y down) and space.
pub(crate) struct Eye<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) centre_m: Vector3<f64>,
    /// Takes `(x, y, 1)` to the ray in space that advances by one along the line of sight.
    ray_from_ideal: Matrix3<f64>,
}

impl<'a> Eye<'a> {
    pub(crate) fn new(camera: &'a Camera, orientation: &ExteriorOrientation) -> Self {
        let right_down_forward = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let ray_from_ideal = orientation.camera_from_object.matrix().transpose() * right_down_forward;
        Self { camera, centre_m: orientation.projection_centre_m, ray_from_ideal }
    }

    /// The point on a ray at a depth.
    pub(crate) fn point_m(&self, ideal: Vector2<f64>, depth_m: f64) -> Vector3<f64> {
        self.centre_m + self.ray_from_ideal * Vector3::new(ideal.x, ideal.y, 1.0) * depth_m
    }

    /// Camera coordinates: right, down, forward.
    fn seen(&self, point_m: Vector3<f64>) -> Vector3<f64> {
        self.ray_from_ideal.tr_mul(&(point_m - self.centre_m))
    }
}

/// A rectangle in ideal coordinates.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Vector2<f64>,
    high: Vector2<f64>,
}

impl Bounds {
    const EVERYWHERE: Self = Self {
        low: Vector2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
        high: Vector2::new(f64::INFINITY, f64::INFINITY),
    };

    fn around(points: impl Iterator<Item = Vector2<f64>>) -> Self {
        let none = Self { low: Self::EVERYWHERE.high, high: Self::EVERYWHERE.low };
        points.fold(none, |b, p| Self { low: b.low.inf(&p), high: b.high.sup(&p) })
    }

    /// What is common to two rectangles that touch.
    fn within(&self, other: &Self) -> Self {
        Self { low: self.low.sup(&other.low), high: self.high.inf(&other.high) }
    }

    /// The rectangle about what a matrix makes of this one.
    fn taken_by(&self, matrix: &Matrix2<f64>) -> Self {
        let ends = [0, 1].map(|k| (matrix.column(k) * self.low[k], matrix.column(k) * self.high[k]));
        let [(a, b), (c, d)] = ends;
        Self { low: a.inf(&b) + c.inf(&d), high: a.sup(&b) + c.sup(&d) }
    }

    fn touches(&self, other: &Self) -> bool {
        self.low.x <= other.high.x
            && other.low.x <= self.high.x
            && self.low.y <= other.high.y
            && other.low.y <= self.high.y
    }
}

/// A face as the camera sees it.
struct SeenFace {
    index: u32,
    bounds: Bounds,
    /// Not negative inside, each a linear form of `(x, y, 1)`.
    sides: Vec<Vector3<f64>>,
    /// 1 / depth as a linear form of `(x, y, 1)`.
    inverse_depth: Vector3<f64>,
}

impl SeenFace {
    fn new(index: usize, face: &Face, eye: &Eye<'_>) -> Option<Self> {
        let corners: Vec<_> = face.corners_m.iter().map(|&corner| eye.seen(corner)).collect();
        if corners.iter().any(|corner| corner.z < NEAREST_M) {
            return None;
        }
        let sides = sides_of(&corners);
        let normal: Vector3<f64> = sides.iter().sum();
        // twice the face's area times its distance: its sign tells from which side it is seen
        let volume = normal.dot(&corners[0]);
        (volume.abs() > 1e-9).then(|| Self {
            index: index as u32,
            bounds: Bounds::around(corners.iter().map(|corner| corner.xy() / corner.z)),
            sides: sides.into_iter().map(|side| side * volume.signum()).collect(),
            inverse_depth: normal / volume,
        })
    }
}

fn sides_of(corners: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    (0..corners.len()).map(|i| corners[i].cross(&corners[(i + 1) % corners.len()])).collect()
}

/// A patch of the ground as the camera sees it.
struct SeenPatch {
    index: u32,
    bounds: Bounds,
    /// Signed distances from the sides in metres, each a linear form of `(east, north, 1)`, not negative inside.
    sides: Vec<Vector3<f64>>,
}

impl SeenPatch {
    fn new(index: usize, patch: &Patch, terrain: &Terrain, eye: &Eye<'_>) -> Self {
        let corners = &patch.corners_m;
        let n = corners.len();
        let along_side = |i: usize| {
            let (from, to) = (corners[i], corners[(i + 1) % n]);
            let pieces = ((to - from).norm() / LONGEST_SIDE_M).ceil().max(1.0) as u32;
            (0..pieces).map(move |k| from + (to - from) * (f64::from(k) / f64::from(pieces)))
        };
        let outline: Vec<_> = (0..n).flat_map(along_side).map(|place| eye.seen(terrain.point_m(place))).collect();
        let bounds = if outline.iter().any(|point| point.z < NEAREST_M) {
            Bounds::EVERYWHERE
        } else {
            Bounds::around(outline.iter().map(|point| point.xy() / point.z))
        };
        let flat: Vec<_> = corners.iter().map(|corner| corner.push(1.0)).collect();
        let area: f64 = sides_of(&flat).iter().map(|side| side.z).sum();
        let sides = sides_of(&flat).into_iter().map(|side| side * (area.signum() / side.xy().norm())).collect();
        Self { index: index as u32, bounds, sides }
    }
}

/// A ball of leaves as the camera sees it.
struct SeenPuff {
    index: u32,
    bounds: Bounds,
    centre: Vector3<f64>,
    radius_m: f64,
}

impl SeenPuff {
    fn new(index: usize, puff: &Puff, eye: &Eye<'_>) -> Option<Self> {
        let (centre, radius_m) = (eye.seen(puff.centre_m), puff.radius_m);
        let nearest_m = centre.z - radius_m;
        (nearest_m > NEAREST_M).then(|| {
            let (middle, reach) =
                (centre.xy() / centre.z, radius_m / nearest_m * (1.0 + centre.xy().norm() / centre.z));
            let bounds = Bounds { low: middle.add_scalar(-reach), high: middle.add_scalar(reach) };
            Self { index: index as u32, bounds, centre, radius_m }
        })
    }

    /// 1 / depth of the near side of the ball on a ray.
    fn inverse_depth(&self, ray: Vector3<f64>) -> Option<f64> {
        let (a, b) = (ray.norm_squared(), ray.dot(&self.centre));
        let discriminant = b * b - a * (self.centre.norm_squared() - self.radius_m * self.radius_m);
        (discriminant > 0.0).then(|| a / (b - discriminant.sqrt()))
    }
}

/// All that may be seen of a town.
pub(crate) struct SeenTown {
    faces: Vec<SeenFace>,
    patches: Vec<SeenPatch>,
    puffs: Vec<SeenPuff>,
}

impl SeenTown {
    pub(crate) fn new(faces: &[Face], patches: &[Patch], puffs: &[Puff], terrain: &Terrain, eye: &Eye<'_>) -> Self {
        Self {
            faces: faces.iter().enumerate().filter_map(|(i, face)| SeenFace::new(i, face, eye)).collect(),
            patches: patches.iter().enumerate().map(|(i, patch)| SeenPatch::new(i, patch, terrain, eye)).collect(),
            puffs: puffs.iter().enumerate().filter_map(|(i, puff)| SeenPuff::new(i, puff, eye)).collect(),
        }
    }
}

/// The part of a town that may be seen in a row of tiles, or in one tile.
pub(crate) struct Part<'a> {
    faces: Vec<&'a SeenFace>,
    patches: Vec<&'a SeenPatch>,
    puffs: Vec<&'a SeenPuff>,
}

impl<'a> Part<'a> {
    pub(crate) fn of_row(town: &'a SeenTown, row: &[Tile]) -> Self {
        let corners = row.iter().flat_map(|tile| [tile.bounds.low, tile.bounds.high]);
        let bounds = Bounds::around(corners);
        Self {
            faces: town.faces.iter().filter(|face| face.bounds.touches(&bounds)).collect(),
            patches: town.patches.iter().filter(|patch| patch.bounds.touches(&bounds)).collect(),
            puffs: town.puffs.iter().filter(|puff| puff.bounds.touches(&bounds)).collect(),
        }
    }
}

/// A square of pixels, each with several rays.
pub(crate) struct Tile {
    /// Its first pixel; tiles lie on a raster that is fixed in the image.
    pub(crate) corner_px: [i32; 2],
    pub(crate) rays_per_pixel: usize,
    bounds: Bounds,
    /// The least and the greatest difference of a pixel and what [`Self::pixel_by_ideal`] makes of its ideal point.
    shift_px: Bounds,
    /// At every fourth pixel, exactly: the ideal point, and 1 / depth of the ground on its ray.
    nodes: Vec<Vector3<f64>>,
    /// Where the corners of the tile are on the ground, row by row.
    pub(crate) ground_corners_m: [Vector2<f64>; 4],
    /// How ideal points turn, reflect and grow on their way to pixels.
    pixel_by_ideal: Matrix2<f64>,
}

impl Tile {
    /// The tile at a corner; `None` where rays miss the ground or the distortion says nothing.
    pub(crate) fn new(corner_px: [i32; 2], rays_per_pixel: u32, eye: &Eye<'_>, terrain: &Terrain) -> Option<Self> {
        let pixel = |i: usize| {
            let (column, row) = ((i % NODES * NODE_PX) as i32, (i / NODES * NODE_PX) as i32);
            Vector2::new(f64::from(corner_px[0] + column), f64::from(corner_px[1] + row))
        };
        let node = |i: usize| {
            let ideal = eye.camera.ideal_from_pixel(pixel(i))?;
            let ground = terrain.meets(eye.centre_m, eye.point_m(ideal, 1.0) - eye.centre_m)?;
            Some(ideal.push(1.0 / eye.seen(ground).z))
        };
        let nodes: Vec<Vector3<f64>> = (0..NODES * NODES).map(node).collect::<Option<_>>()?;
        let bounds = Bounds::around(nodes.iter().map(|node| node.xy()));
        let pixel_by_ideal = eye.camera.pixel_by_reduced() * eye.camera.principal_distance_px;
        let shift = |(i, node): (usize, &Vector3<f64>)| pixel(i) - pixel_by_ideal * node.xy();
        let shift_px = Bounds::around(nodes.iter().enumerate().map(shift));
        let rays_per_pixel = rays_per_pixel as usize;
        let corners = [0, NODES - 1, NODES * (NODES - 1), NODES * NODES - 1].map(|i| nodes[i]);
        let ground_corners_m = corners.map(|ray| eye.point_m(ray.xy(), 1.0 / ray.z).xy());
        Some(Self { corner_px, rays_per_pixel, bounds, shift_px, nodes, ground_corners_m, pixel_by_ideal })
    }

    /// The rays of the tile that may meet something with these bounds.
    fn rays(&self, bounds: &Bounds) -> impl Iterator<Item = usize> + use<> {
        let Bounds { low, high } = bounds.within(&self.bounds).taken_by(&self.pixel_by_ideal);
        let (low, high) = (low + self.shift_px.low, high + self.shift_px.high);
        let range = |low: f64, high: f64, corner: i32| {
            let clamp = |pixel: f64| (pixel - f64::from(corner)).clamp(0.0, TILE_PX as f64) as usize;
            clamp(low.floor() - 1.0)..clamp(high.ceil() + 1.0)
        };
        let columns = range(low.x, high.x, self.corner_px[0]);
        let rays = self.rays_per_pixel;
        range(low.y, high.y, self.corner_px[1]).flat_map(move |row| {
            let first = row * TILE_PX;
            (first + columns.start) * rays..(first + columns.end) * rays
        })
    }

    /// The rays of the tile, pixel by pixel: their ideal points, and 1 / depth of the ground on them.
    ///
    /// In each pixel they are evenly spread, and from pixel to pixel they are shifted along a lattice. A fixed pattern
    /// would move edges that run along rows or columns by up to a quarter of a pixel; here such errors cancel along
    /// the edge.
    fn ground_rays(&self) -> Vec<Vector3<f64>> {
        let mut rays = Vec::with_capacity(TILE_PX * TILE_PX * self.rays_per_pixel);
        for (row, column) in (0..TILE_PX).flat_map(|row| (0..TILE_PX).map(move |column| (row, column))) {
            let first = row / NODE_PX * NODES + column / NODE_PX;
            let [a, b, c, d] = [first, first + 1, first + NODES, first + NODES + 1].map(|node| self.nodes[node]);
            let (by_x, by_y, by_both) = (b - a, c - a, a - b - c + d);
            let (column_in_cell, row_in_cell) = ((column % NODE_PX) as f64, (row % NODE_PX) as f64);
            let shift = lattice_shift(self.corner_px[0] + column as i32, self.corner_px[1] + row as i32);
            for ray in 0..self.rays_per_pixel {
                let [x_in_pixel, y_in_pixel] = self.place_in_pixel(ray, shift);
                let (x, y) =
                    ((column_in_cell + x_in_pixel) / NODE_PX as f64, (row_in_cell + y_in_pixel) / NODE_PX as f64);
                rays.push(a + by_x * x + (by_y + by_both * x) * y);
            }
        }
        rays
    }

    fn place_in_pixel(&self, ray: usize, shift: [f64; 2]) -> [f64; 2] {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let across = (ray as f64 + 0.5) / self.rays_per_pixel as f64;
        [across + shift[0], ray as f64 * GOLDEN + shift[1]].map(|value| floor_and_rest(value).1)
    }
}

/// A shift that fills the unit square evenly as one goes on from pixel to pixel: the steps are powers of the inverse of
/// the plastic number and of its next relative.
fn lattice_shift(x: i32, y: i32) -> [f64; 2] {
    const STEPS: [[f64; 2]; 2] =
        [[0.754_877_666_246_692_8, 0.569_840_290_998_053_3], [0.819_172_513_396_164_4, 0.671_043_606_703_789_2]];
    STEPS.map(|[by_x, by_y]| f64::from(x) * by_x + f64::from(y) * by_y)
}

/// What the rays of a tile meet: for each pixel, row by row, one entry for each of its rays.
pub(crate) struct Sight {
    pub(crate) surface: Vec<Surface>,
    pub(crate) point_m: Vec<Vector3<f64>>,
    ideal: Vec<Vector2<f64>>,
    inverse_depth: Vec<f64>,
}

impl Sight {
    /// Looks at a part of the town from the rays of one tile.
    pub(crate) fn through(tile: &Tile, part: &Part<'_>, eye: &Eye<'_>) -> Self {
        let ground = tile.ground_rays();
        let mut sight = Self {
            surface: vec![Surface::Meadow; ground.len()],
            point_m: ground.iter().map(|ray| eye.point_m(ray.xy(), 1.0 / ray.z)).collect(),
            ideal: ground.iter().map(|ray| ray.xy()).collect(),
            inverse_depth: ground.iter().map(|ray| ray.z).collect(),
        };
        for patch in part.patches.iter().filter(|patch| patch.bounds.touches(&tile.bounds)) {
            sight.paint(patch, tile);
        }
        for face in part.faces.iter().filter(|face| face.bounds.touches(&tile.bounds)) {
            for ray in tile.rays(&face.bounds) {
                let direction = sight.ideal[ray].push(1.0);
                if face.sides.iter().all(|side| side.dot(&direction) >= 0.0) {
                    sight.meet(ray, face.inverse_depth.dot(&direction), Surface::Face(face.index));
                }
            }
        }
        for puff in part.puffs.iter().filter(|puff| puff.bounds.touches(&tile.bounds)) {
            for ray in tile.rays(&puff.bounds) {
                if let Some(inverse_depth) = puff.inverse_depth(sight.ideal[ray].push(1.0)) {
                    sight.meet(ray, inverse_depth, Surface::Puff(puff.index));
                }
            }
        }
        sight.raise_points(eye);
        sight
    }

    fn paint(&mut self, patch: &SeenPatch, tile: &Tile) {
        let holds = |place: Vector2<f64>, margin_m: f64| {
            let place = place.push(1.0);
            patch.sides.iter().all(|side| side.dot(&place) >= margin_m)
        };
        // a convex patch that holds the tile's corners well inside holds all of it
        if tile.ground_corners_m.into_iter().all(|corner| holds(corner, 0.1)) {
            self.surface.fill(Surface::Patch(patch.index));
            return;
        }
        for ray in tile.rays(&patch.bounds) {
            if holds(self.point_m[ray].xy(), 0.0) {
                self.surface[ray] = Surface::Patch(patch.index);
            }
        }
    }

    /// Moves the points of rays that end above the ground from the ground to where they end.
    fn raise_points(&mut self, eye: &Eye<'_>) {
        for (ray, point) in self.point_m.iter_mut().enumerate() {
            if let Surface::Face(_) | Surface::Puff(_) = self.surface[ray] {
                *point = eye.point_m(self.ideal[ray], 1.0 / self.inverse_depth[ray]);
            }
        }
    }

    fn meet(&mut self, ray: usize, inverse_depth: f64, surface: Surface) {
        if inverse_depth > self.inverse_depth[ray] {
            self.inverse_depth[ray] = inverse_depth;
            self.surface[ray] = surface;
        }
    }
}
