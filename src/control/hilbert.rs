//! Places along a Hilbert curve over the earth: what is near on it is near in space.

/// Bits of each coordinate: cells of some centimetres.
const BITS: u32 = 30;

/// How far along the curve a longitude and latitude is, in degrees.
#[must_use]
pub(super) fn place([lon_deg, lat_deg]: [f64; 2]) -> u64 {
    let cells = f64::from(1_u32 << BITS);
    let cell = |share: f64| (share * cells).clamp(0.0, cells - 1.0) as u64;
    let (mut x, mut y) = (cell((lon_deg + 180.0) / 360.0), cell((lat_deg + 90.0) / 180.0));
    let mut along = 0;
    for bit in (0..BITS).rev() {
        let (right, upper) = ((x >> bit) & 1, (y >> bit) & 1);
        along = along << 2 | (3 * right) ^ upper;
        // the quarters at both ends of a curve are turned
        if upper == 0 {
            if right == 1 {
                let most = (1 << BITS) - 1;
                (x, y) = (most - x, most - y);
            }
            (x, y) = (y, x);
        }
    }
    along
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each cell of a grid of 32 by 32 comes once, and the next one is its neighbour.
    #[test]
    fn the_next_place_is_beside() {
        let middle = |cell: u32, whole: f64| (f64::from(cell) + 0.5) * whole / 32.0 - whole / 2.0;
        let mut cells: Vec<(u64, i64, i64)> = (0..32_u32)
            .flat_map(|x| (0..32_u32).map(move |y| (x, y)))
            .map(|(x, y)| (place([middle(x, 360.0), middle(y, 180.0)]), x.into(), y.into()))
            .collect();
        cells.sort_unstable();
        for pair in cells.windows(2) {
            let [(_, x, y), (_, next_x, next_y)] = pair else { unreachable!() };
            assert_eq!((x - next_x).abs() + (y - next_y).abs(), 1, "{pair:?}");
        }
    }

    #[test]
    fn beyond_the_earth_is_its_rim() {
        assert_eq!(place([-200.0, -91.0]), place([-180.0, -90.0]));
    }
}
