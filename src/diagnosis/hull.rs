//! How much of the image lies between its control points?

use nalgebra::Vector2;

use crate::geometry::Camera;

/// The area of the convex hull of places, given in pixels of the file, as a share of the frame.
#[must_use]
pub fn hull_share(camera: &Camera, places_px: &[Vector2<f64>]) -> f64 {
    let mut places: Vec<Vector2<f64>> = places_px.iter().copied().filter(|p| p.iter().all(|v| v.is_finite())).collect();
    places.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let lower = chain(places.iter().copied());
    let upper = chain(places.iter().rev().copied());
    let rim: Vec<Vector2<f64>> = [&lower[..lower.len().saturating_sub(1)], &upper].concat();
    let twice: f64 = (0..rim.len()).map(|k| rim[k].perp(&rim[(k + 1) % rim.len()])).sum();
    twice.abs() / 2.0 / camera.frame_area_px2()
}

/// The half of the hull on one side of places in order (Andrew's monotone chain).
fn chain(places: impl Iterator<Item = Vector2<f64>>) -> Vec<Vector2<f64>> {
    let mut chain: Vec<Vector2<f64>> = Vec::new();
    for place in places {
        while let [.., a, b] = chain[..]
            && (b - a).perp(&(place - b)) <= 0.0
        {
            chain.pop();
        }
        chain.push(place);
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Brown;

    fn share(places: &[[f64; 2]]) -> f64 {
        let camera = Camera::new([400, 300], 300.0, Vector2::new(200.0, 150.0), Brown::default()).unwrap();
        hull_share(&camera, &places.iter().map(|p| Vector2::from(*p)).collect::<Vec<_>>())
    }

    #[test]
    fn it_is_the_area_between_the_outermost() {
        let corners = [[0.0, 0.0], [400.0, 0.0], [400.0, 300.0], [0.0, 300.0]];
        assert!((share(&corners) - 1.0).abs() < 1e-12);
        assert!((share(&corners[..3]) - 0.5).abs() < 1e-12);
        let with_inner = [&corners[..], &[[200.0, 150.0], [10.0, 20.0], [200.0, 0.0]]].concat();
        assert!((share(&with_inner) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn few_or_collinear_places_hold_nothing() {
        assert_eq!(share(&[]), 0.0);
        assert_eq!(share(&[[5.0, 5.0]]), 0.0);
        assert_eq!(share(&[[5.0, 5.0], [100.0, 50.0]]), 0.0);
        assert!(share(&[[0.0, 0.0], [100.0, 50.0], [200.0, 100.0], [50.0, 25.0]]) < 1e-12);
        assert_eq!(share(&[[f64::NAN, 1.0], [5.0, f64::INFINITY], [1.0, 1.0]]), 0.0);
    }
}
