//! Advice for errors of a disk.

/// Advice for disk errors, to be added to the system's message; empty for other errors.
#[must_use]
pub fn advice(kind: std::io::ErrorKind) -> &'static str {
    match kind {
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
            "; make room on that disk, or write to another"
        }
        std::io::ErrorKind::ReadOnlyFilesystem => {
            "; the disk is read-only (Linux remounts a disk with errors this way, and logs it): write to another"
        }
        _ => "",
    }
}
