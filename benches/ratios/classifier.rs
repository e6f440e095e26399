//! F11: a support vector machine with RBF kernel on four features, against scikit-learn.

use anyhow::{Context as _, Result};
use gable::learning::Machine;
use gable::learning::svm::{Kernel, Settings};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::measure::compare;
use super::peer::{Peers, write_array};
use super::table::Row;

const SAMPLES: usize = 17_000;
const BATCH: usize = 1000;
const PRICE: f64 = 10.0;
const GAMMA: f64 = 0.8;
/// Decision values of machines that were trained to the same tolerance differ by no more.
const ALIKE: f64 = 0.02;

pub fn bench(peers: &Peers) -> Result<Vec<Row>> {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let samples: Vec<(Vec<f64>, bool)> = (0..SAMPLES).map(|_| sample(&mut rng)).collect();
    let batch: Vec<Vec<f64>> = (0..BATCH).map(|_| sample(&mut rng).0).collect();
    let folder = tempfile::tempdir()?;
    let rows = samples
        .iter()
        .flat_map(|(features, right)| features.iter().copied().chain(std::iter::once(f64::from(u8::from(*right)))));
    write_array(folder.path(), "samples", rows)?;
    write_array(folder.path(), "batch", batch.iter().flatten().copied())?;
    write_array(folder.path(), "parameters", [PRICE, GAMMA])?;
    let mut peer = peers.start("classifier.py", folder.path())?;
    let settings = Settings { kernel: Kernel::Rbf { gamma: GAMMA }, price: PRICE, weight_of_wrong: 1.0 };
    let training = compare(&mut peer, "train", || Ok(Machine::train(&samples, &settings)?))?;
    let machine = training.made;
    let decisions = || Ok(batch.iter().map(|features| machine.decision(features)).collect::<Vec<f64>>());
    let deciding = compare(&mut peer, "decide", decisions)?;
    let theirs = deciding.told["decisions"].as_array().context("decisions")?;
    let differ = |(ours, theirs): (&f64, &serde_json::Value)| (ours - theirs.as_f64().unwrap_or(f64::NAN)).abs();
    let most = deciding.made.iter().zip(theirs).map(differ).fold(0.0, f64::max);
    let counts = (machine.support_vectors(), training.told["support_vectors"].as_u64().unwrap_or(0));
    let as_good = most < ALIKE && theirs.len() == BATCH;
    let row = |what: String, peer_s: f64, ours_s: f64, gate: f64, moonshot: f64, note: String| Row {
        id: "F11",
        what,
        peer_s,
        ours_s,
        gate,
        moonshot,
        as_good,
        note,
    };
    let alike = format!("decision values differ by at most {most:.4}");
    let vectors = format!("{} support vectors, {} of theirs", counts.0, counts.1);
    let (decide, train) =
        (format!("{BATCH} SVM decisions / scikit-learn"), format!("training on {SAMPLES} samples / scikit-learn"));
    Ok(vec![
        row(decide, deciding.peer_s, deciding.ours_s, 0.5, 0.05, alike),
        row(train, training.peer_s, training.ours_s, 1.5, 0.5, vectors),
    ])
}

/// Features of an image, scaled; right with the odds that their sum says.
fn sample(rng: &mut ChaCha8Rng) -> (Vec<f64>, bool) {
    let features: Vec<f64> = (0..4).map(|_| rng.random_range(-1.0..1.0)).collect();
    let bent = features[0] + features[1] * features[2] - 0.5 * features[3].powi(2) + 0.3;
    let right = rng.random_range(0.0..1.0) < 1.0 / (1.0 + (-6.0 * bent).exp());
    (features, right)
}
