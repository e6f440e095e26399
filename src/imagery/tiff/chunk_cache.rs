//! The strips and tiles used last.

use std::collections::HashMap;
use std::sync::Arc;

use crate::imagery::grey::Grey;

/// Keeps decoded strips and tiles up to a number of bytes, and the one used last in any case.
#[derive(Debug)]
pub(super) struct ChunkCache {
    capacity_bytes: u64,
    bytes: u64,
    uses: u64,
    chunks: HashMap<usize, Entry>,
}

#[derive(Debug)]
struct Entry {
    last_use: u64,
    chunk: Arc<Grey>,
}

impl ChunkCache {
    /// An empty cache.
    pub(super) fn new(capacity_bytes: u64) -> Self {
        Self { capacity_bytes, bytes: 0, uses: 0, chunks: HashMap::new() }
    }

    /// The strip or tile of this index, if it is here.
    pub(super) fn find(&mut self, index: usize) -> Option<Arc<Grey>> {
        self.uses += 1;
        let entry = self.chunks.get_mut(&index)?;
        entry.last_use = self.uses;
        Some(Arc::clone(&entry.chunk))
    }

    /// Takes a strip or tile in, and lets go of those that were not used for longest.
    pub(super) fn insert(&mut self, index: usize, chunk: Arc<Grey>) {
        self.bytes += chunk.bytes();
        if let Some(former) = self.chunks.insert(index, Entry { last_use: self.uses, chunk }) {
            self.bytes -= former.chunk.bytes();
        }
        while self.bytes > self.capacity_bytes && self.chunks.len() > 1 {
            let oldest = self.chunks.iter().min_by_key(|(_, entry)| entry.last_use).map(|(&index, _)| index);
            let Some(entry) = oldest.and_then(|index| self.chunks.remove(&index)) else { return };
            self.bytes -= entry.chunk.bytes();
        }
    }
}
