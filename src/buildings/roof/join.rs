//! Joins what continues straight: an eave is one line, however many polygons end on it.

use super::kind::Piece;
use super::net::Net;
use super::{TOLERANCE_M, Work};
use crate::buildings::EdgeKind;

/// Cosine of the bend (5°) above which a line ends, even if it stays within the tolerance.
const STRAIGHT: f64 = 0.996_195;

/// Joins pieces of the same kind that make up one straight line.
pub(super) fn straight(net: &Net, pieces: Vec<Piece>, work: &mut Work) -> Result<Vec<Piece>, ()> {
    let mut chains = Chains::new(net, pieces);
    let mut joined = Vec::with_capacity(chains.pieces.len());
    for number in 0..chains.pieces.len() {
        if !chains.used[number] {
            joined.push(chains.follow(number, work)?);
        }
    }
    Ok(joined)
}

struct Chains<'a> {
    net: &'a Net,
    pieces: Vec<Piece>,
    used: Vec<bool>,
    /// Node and piece, sorted.
    at_node: Vec<(u32, u32)>,
    /// Where a node begins in `at_node`, and after the last node its end.
    first: Vec<u32>,
}

impl<'a> Chains<'a> {
    fn new(net: &'a Net, pieces: Vec<Piece>) -> Self {
        let mut at_node: Vec<(u32, u32)> =
            (0..).zip(&pieces).flat_map(|(number, piece)| piece.ends.map(|node| (node, number))).collect();
        at_node.sort_unstable();
        let mut first = vec![0; net.len() + 1];
        for (node, _) in &at_node {
            first[*node as usize + 1] += 1;
        }
        for node in 0..net.len() {
            first[node + 1] += first[node];
        }
        Self { net, used: vec![false; pieces.len()], pieces, at_node, first }
    }

    /// The whole line of which a piece is a part.
    fn follow(&mut self, number: usize, work: &mut Work) -> Result<Piece, ()> {
        self.used[number] = true;
        let Piece { kind, ends } = self.pieces[number];
        let mut line = ends.to_vec();
        for _ in 0..2 {
            while let Some((next, node)) = self.next(&line, kind, work)? {
                self.used[next] = true;
                line.push(node);
            }
            line.reverse();
        }
        Ok(Piece { kind, ends: [line[0], line[line.len() - 1]] })
    }

    /// The piece that continues a line best at its end, and the node to which it leads.
    fn next(&self, line: &[u32], kind: EdgeKind, work: &mut Work) -> Result<Option<(usize, u32)>, ()> {
        let (last, end) = (line[line.len() - 2], line[line.len() - 1]);
        let way = (self.net.at(end) - self.net.at(last)).normalize();
        let (from, to) = (self.first[end as usize], self.first[end as usize + 1]);
        work.spend((to - from) as usize)?;
        let mut best: Option<(f64, usize, u32)> = None;
        for (_, number) in &self.at_node[from as usize..to as usize] {
            let piece = self.pieces[*number as usize];
            if self.used[*number as usize] || piece.kind != kind {
                continue;
            }
            let node = if piece.ends[0] == end { piece.ends[1] } else { piece.ends[0] };
            let bend = (self.net.at(node) - self.net.at(end)).normalize().dot(&way);
            if bend >= best.map_or(STRAIGHT, |(bend, ..)| bend) {
                work.spend(line.len())?;
                if self.all_on_line(line, node) {
                    best = Some((bend, *number as usize, node));
                }
            }
        }
        Ok(best.map(|(_, number, node)| (number, node)))
    }

    /// Whether all between lie on the way from the first node of a line to a new end.
    fn all_on_line(&self, line: &[u32], end: u32) -> bool {
        let start = self.net.at(line[0]);
        let way = (self.net.at(end) - start).normalize();
        line[1..].iter().all(|node| {
            let offset = self.net.at(*node) - start;
            (offset - way * offset.dot(&way)).norm() <= TOLERANCE_M
        })
    }
}
