//! Files that stand under their names only once they are whole.

use std::fs::{File, Permissions};
use std::io::{BufWriter, Error, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Calls `write` on a file of another name in the same folder, and gives it the name `path` once all of it is on the disk.
/// On an error nothing is left, and what stood at `path` stands there still.
///
/// # Errors
/// The system's, and those of `write`.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), Error>,
) -> Result<(), Error> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::Builder::new()
        .prefix(".unfinished-")
        // What any new file has; the umask is taken off.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
        .map_err(without_path)?;
    let mut buffer = BufWriter::new(file.as_file_mut());
    write(&mut buffer)?;
    buffer.flush()?;
    drop(buffer);
    file.as_file().sync_all()?;
    file.persist(path).map_err(|e| without_path(e.error))?;
    Ok(())
}

/// The system's reason by itself: the caller says which file, and not that of the temporary name.
fn without_path(error: Error) -> Error {
    let text = error.to_string();
    match text.split_once(" at path ") {
        Some((reason, _)) => Error::new(error.kind(), reason),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_finished_is_not_there_and_the_old_one_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        write_whole(&path, |f| f.write_all(b"old")).unwrap();
        let full = |f: &mut BufWriter<&mut File>| {
            f.write_all(b"new")?;
            Err(Error::from(std::io::ErrorKind::StorageFull))
        };
        assert!(write_whole(&path, full).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
    }

    #[test]
    fn files_are_readable_as_the_umask_says() {
        let folder = tempfile::tempdir().unwrap();
        let (whole, plain) = (folder.path().join("whole"), folder.path().join("plain"));
        write_whole(&whole, |f| f.write_all(b"x")).unwrap();
        std::fs::write(&plain, b"x").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&whole), mode(&plain));
    }

    #[test]
    fn a_folder_that_is_missing_is_the_systems_reason_alone() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_whole(&folder.path().join("no/a.csv"), |_| Ok(())).unwrap_err();
        assert_eq!(error.to_string(), "No such file or directory (os error 2)");
    }
}
