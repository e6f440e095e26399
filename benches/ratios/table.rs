//! One line for each comparison.

use std::fmt;

/// What the columns are.
pub const HEAD: &str =
    "id  what                                              peer ms     ours ms    ratio   gate  moonshot";

/// A comparison with its bounds.
pub struct Row {
    pub id: &'static str,
    pub what: String,
    pub peer_s: f64,
    pub ours_s: f64,
    pub gate: f64,
    pub moonshot: f64,
    /// Whether the results are as good as they must be for the times to be compared.
    pub as_good: bool,
    /// What the results have in common or not.
    pub note: String,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { id, what, peer_s, ours_s, gate, moonshot, as_good, note } = self;
        let ratio = ours_s / peer_s;
        let held = match ratio {
            _ if !as_good => "RESULTS NOT AS GOOD",
            r if r <= *moonshot => "moonshot held",
            r if r <= *gate => "gate held",
            _ => "GATE MISSED",
        };
        let (peer_ms, ours_ms) = (1e3 * peer_s, 1e3 * ours_s);
        write!(
            f,
            "{id:<3} {what:<46} {peer_ms:>10.3}  {ours_ms:>10.3}  {ratio:>7.4}  {gate:>5}  {moonshot:>8}  {held}"
        )?;
        if note.is_empty() { Ok(()) } else { write!(f, "\n      {note}") }
    }
}
