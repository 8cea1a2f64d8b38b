//! SHA-256 of a file, computed while it is read, or of what a file would contain.

use sha2::{Digest, Sha256};
use std::io::{self, Read, Write};

/// A hash over one or several files, each read through a [`HashingReader`].
#[derive(Default)]
pub(super) struct Hash(Sha256);

impl Hash {
    /// The digest of everything read so far.
    pub(super) fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

/// A reader that hashes all bytes that are read through it.
pub(super) struct HashingReader<'a, R> {
    inner: R,
    hash: &'a mut Hash,
}

impl<'a, R: Read> HashingReader<'a, R> {
    pub(super) fn new(inner: R, hash: &'a mut Hash) -> Self {
        Self { inner, hash }
    }

    /// Reads to the end, so that the hash also covers a part of the file that was not needed.
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

/// A sink that hashes all bytes and keeps none.
pub(super) struct HashingWriter<'a>(&'a mut Hash);

impl<'a> HashingWriter<'a> {
    pub(super) fn new(hash: &'a mut Hash) -> Self {
        Self(hash)
    }
}

impl Write for HashingWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
