//! Tables as CSV files.

use std::io;
use std::path::Path;

use serde::Serialize;

use super::error::Error;
use crate::whole_file::write_whole;

/// Writes `head` and `rows`.
///
/// # Errors
/// [`Error::Write`].
pub(super) fn write(
    path: &Path,
    head: impl Iterator<Item = String>,
    rows: impl Iterator<Item = impl Serialize>,
) -> Result<(), Error> {
    write_whole(path, |file| {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        writer.write_record(head.map(String::into_bytes)).map_err(reason)?;
        for row in rows {
            writer.serialize(row).map_err(reason)?;
        }
        writer.flush()
    })
    .map_err(|source| Error::Write { file: path.to_path_buf(), source })
}

/// The system's own error where there is one.
fn reason(error: csv::Error) -> io::Error {
    if !error.is_io_error() {
        return io::Error::other(error);
    }
    match error.into_kind() {
        csv::ErrorKind::Io(source) => source,
        other => io::Error::other(format!("{other:?}")),
    }
}
