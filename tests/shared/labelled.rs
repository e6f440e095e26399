//! Labelled images that are made up.

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// An image whose evidence tells mostly, but not always, whether it is right; some have none.
pub(crate) fn image(area: &str, k: usize, draws: &mut ChaCha8Rng) -> Value {
    if k % 10 == 9 {
        return json!({"image": format!("{area}-{k}"), "area": area, "tolerance_m": 0.5});
    }
    let mut about_zero = || (0..6).map(|_| draws.random_range(-0.7..0.7)).sum::<f64>();
    let quality = about_zero();
    // few enough digits for JSON to be read exactly
    let rounded = |value: f64| (value * 1e6).round() / 1e6;
    let mut about = |mean: f64, slope: f64| rounded(mean * (slope * quality + 0.3 * about_zero()).exp());
    let d_max_m = about(0.4, -1.0);
    let log_sigma0 = rounded(about(1.0, -0.4).ln());
    let log_configuration = rounded(about(3.0, -0.3).ln());
    let trial = |k: u32| json!([12 - k, 1 + k, log_sigma0, log_configuration, rounded(d_max_m + f64::from(k))]);
    json!({
        "image": format!("{area}-{k}"),
        "area": area,
        "evidence": {
            "points": 12, "eliminated": 2, "log_sigma0_of_points": log_sigma0,
            "log_configuration_of_points": log_configuration, "sigma0": about(1.0, -0.3), "redundancy": 200,
            "configuration": about(3.0, -0.3), "control_points": about(8.0, 0.3).round(), "control_points_in_view": 16,
            "inlier_share": rounded(1.0 / (1.0 + about(0.2, -0.4))), "matched_share": 0.6,
            "matched_share_in_view": rounded(1.0 / (1.0 + about(1.0, -0.4))),
            "hull_share": rounded(1.0 / (1.0 + about(1.0, -0.4))), "sigma_planimetric_m": about(0.1, -0.5),
            "sigma_of_nine_m": about(0.1, -0.5), "tolerance_m": 0.5, "log_odds": about(60.0, 0.5),
            "runner_up_log_odds": about(20.0, -0.3), "distance_from_approximation": about(6.0, -0.3),
            "moved_by_lines_m": about(0.1, -0.3), "change_by_one_m": about(0.1, -0.5),
            "change_by_two_m": about(0.2, -0.5), "undetected_by_one_m": about(0.1, -0.5),
            "undetected_by_two_m": about(0.2, -0.5), "largest_test": about(6.0, -0.4), "mean_test": about(2.0, -0.4),
            "contradicting": 0, "risk_by_chance": about(0.01, -1.0).min(0.9),
            "risk_with_displacement": about(0.02, -1.0).min(0.9), "risk_with_pair": about(0.02, -1.0).min(0.9),
        },
        "tolerance_m": 0.5,
        "d_max_m": d_max_m,
        "trials": [trial(0), trial(1), trial(2)],
    })
}
