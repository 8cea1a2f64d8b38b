//! SHA-256 of what is read, computed on the way.

use sha2::{Digest, Sha256};
use std::io::{self, Read};

/// A hash over one or several files, each fed through a [`HashingReader`].
#[derive(Default)]
pub(super) struct Hash(Sha256);

impl Hash {
    /// The digest of everything read so far.
    pub(super) fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

/// A reader that hashes and counts what passes.
pub(super) struct HashingReader<'a, R> {
    inner: R,
    hash: &'a mut Hash,
}

impl<'a, R: Read> HashingReader<'a, R> {
    pub(super) fn new(inner: R, hash: &'a mut Hash) -> Self {
        Self { inner, hash }
    }

    /// Reads to the end, so that the hash covers a file whose tail was of no use.
    pub(super) fn drain(&mut self) -> io::Result<()> {
        io::copy(self, &mut io::sink()).map(|_| ())
    }
}

impl<R: Read> Read for HashingReader<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hash.0.update(&buffer[..count]);
        Ok(count)
    }
}
