// Labelled images that are made up, as `tests/shared/labelled.rs` makes them: the evidence tells mostly, but not always,
// whether an orientation is right.

function generator(seed) {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

function image(area, k, draw) {
  const rounded = (value) => Math.round(value * 1e6) / 1e6;
  const aboutZero = () => Array.from({ length: 6 }, () => 1.4 * draw() - 0.7).reduce((sum, value) => sum + value, 0);
  const quality = aboutZero();
  const about = (mean, slope) => rounded(mean * Math.exp(slope * quality + 0.3 * aboutZero()));
  const share = (mean, slope) => rounded(1 / (1 + about(mean, slope)));
  const d_max_m = about(0.4, -1);
  const log_sigma0 = rounded(Math.log(about(1, -0.4)));
  const log_configuration = rounded(Math.log(about(3, -0.3)));
  return {
    image: `${area}-${k}`, area, tolerance_m: 0.5, d_max_m,
    evidence: {
      points: 12, eliminated: 2, log_sigma0_of_points: log_sigma0, log_configuration_of_points: log_configuration,
      sigma0: about(1, -0.3), redundancy: 200, configuration: about(3, -0.3), control_points: Math.round(about(8, 0.3)),
      control_points_in_view: 16, inlier_share: share(0.2, -0.4), matched_share: 0.6, matched_share_in_view: share(1, -0.4),
      hull_share: share(1, -0.4), sigma_planimetric_m: about(0.1, -0.5), sigma_of_nine_m: about(0.1, -0.5), tolerance_m: 0.5,
      log_odds: about(60, 0.5), runner_up_log_odds: about(20, -0.3), distance_from_approximation: about(6, -0.3),
      moved_by_lines_m: about(0.1, -0.3), change_by_one_m: about(0.1, -0.5), change_by_two_m: about(0.2, -0.5),
      undetected_by_one_m: about(0.1, -0.5), undetected_by_two_m: about(0.2, -0.5), largest_test: about(6, -0.4),
      mean_test: about(2, -0.4), contradicting: 0, risk_by_chance: Math.min(0.9, about(0.01, -1)),
      risk_with_displacement: Math.min(0.9, about(0.02, -1)), risk_with_pair: Math.min(0.9, about(0.02, -1)),
    },
    trials: [0, 1, 2].map((n) => [12 - n, 1 + n, log_sigma0, log_configuration, rounded(d_max_m + n)]),
  };
}

/** A labelled set of so many images of two areas, as NDJSON. */
export function labelledSet(images) {
  const draw = generator(9);
  return Array.from({ length: images }, (_, k) => `${JSON.stringify(image(k % 2 ? 'south' : 'north', k, draw))}\n`).join('');
}
