//! A reader that counts lines and refuses to give more than so many bytes for one thing.

use std::cell::Cell;
use std::io::{BufRead, Error, ErrorKind, Read, Result};
use std::rc::Rc;

/// What a [`Meter`] has counted; shared with who sets the allowance while a parser owns the reader.
#[derive(Debug, Clone, Default)]
pub(super) struct Count(Rc<Counted>);

#[derive(Debug, Default)]
struct Counted {
    lines: Cell<u64>,
    bytes: Cell<u64>,
    /// Up to which byte reading is allowed.
    allowed: Cell<u64>,
    exhausted: Cell<bool>,
}

impl Count {
    /// The line that is being read, from 1.
    pub(super) fn line(&self) -> u64 {
        self.0.lines.get() + 1
    }

    /// How many bytes have been read.
    pub(super) fn bytes(&self) -> u64 {
        self.0.bytes.get()
    }

    /// Allows so many bytes from here on.
    pub(super) fn allow(&self, bytes: u64) {
        self.0.allowed.set(self.bytes().saturating_add(bytes));
    }

    fn one(&self, byte: u8) {
        self.0.lines.set(self.0.lines.get() + u64::from(byte == b'\n'));
        self.0.bytes.set(self.0.bytes.get() + 1);
    }

    /// Whether more was asked for than was allowed.
    pub(super) fn is_exhausted(&self) -> bool {
        self.0.exhausted.get()
    }
}

/// Passes bytes on up to the allowance, and then errors.
pub(super) struct Meter<'a> {
    input: &'a mut dyn BufRead,
    count: Count,
    /// What of the input's buffer has been passed over without being consumed there: a call through `dyn` for each
    /// byte, as the JSON parser reads, would cost more than parsing.
    chunk: Vec<u8>,
    at: usize,
}

/// So much is copied from the input at once.
const CHUNK: usize = 64 << 10;

impl<'a> Meter<'a> {
    /// A meter that allows so many bytes, until it is told otherwise.
    pub(super) fn new(input: &'a mut dyn BufRead, allowance: u64) -> Self {
        let count = Count::default();
        count.allow(allowance);
        Self { input, count, chunk: Vec::with_capacity(CHUNK), at: 0 }
    }

    /// What it counts.
    pub(super) fn count(&self) -> Count {
        self.count.clone()
    }

    fn refill(&mut self) -> Result<()> {
        if self.at < self.chunk.len() {
            return Ok(());
        }
        self.chunk.clear();
        self.at = 0;
        let bytes = loop {
            match self.input.fill_buf() {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                other => break other?,
            }
        };
        let taken = bytes.len().min(CHUNK);
        self.chunk.extend_from_slice(&bytes[..taken]);
        self.input.consume(taken);
        Ok(())
    }

    fn take(&mut self, bytes: usize) {
        let passed = &self.chunk[self.at..self.at + bytes];
        let lines = passed.iter().filter(|byte| **byte == b'\n').count();
        let counted = &self.count.0;
        counted.lines.set(counted.lines.get() + lines as u64);
        counted.bytes.set(counted.bytes.get() + bytes as u64);
        self.at += bytes;
    }

    fn check(&self) -> Result<()> {
        if self.count.0.bytes.get() < self.count.0.allowed.get() {
            return Ok(());
        }
        self.count.0.exhausted.set(true);
        Err(Error::other("too large"))
    }
}

impl BufRead for Meter<'_> {
    fn fill_buf(&mut self) -> Result<&[u8]> {
        self.refill()?;
        if self.at < self.chunk.len() {
            self.check()?;
        }
        Ok(&self.chunk[self.at..])
    }

    fn consume(&mut self, bytes: usize) {
        self.take(bytes.min(self.chunk.len() - self.at));
    }
}

impl Read for Meter<'_> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize> {
        if let ([into], Some(byte)) = (&mut *into, self.chunk.get(self.at)) {
            // the JSON parser reads so, byte after byte
            self.check()?;
            *into = *byte;
            self.at += 1;
            self.count.one(*into);
            return Ok(1);
        }
        let available = self.fill_buf()?;
        let bytes = available.len().min(into.len());
        into[..bytes].copy_from_slice(&available[..bytes]);
        self.take(bytes);
        Ok(bytes)
    }
}
