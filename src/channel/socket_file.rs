//! The file of a UNIX socket: made for user and group, never in the place of something else. RT: before arming only.

use std::fs::{self, Permissions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::Path;

/// User and group may connect and write.
const MODE: u32 = 0o660;

/// Takes away the socket of a dead process, and nothing else. `is_heard` says whether somebody listens at a path.
///
/// # Errors
/// When the path holds something that is no socket, or a socket at which somebody listens.
pub fn clear_the_way(path: &Path, is_heard: impl FnOnce(&Path) -> io::Result<bool>) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
        Ok(there) if !there.file_type().is_socket() => {
            return Err(io::Error::new(ErrorKind::AlreadyExists, "there is something that is no socket; not removed"));
        }
        Ok(_) => {}
    }
    if is_heard(path)? {
        return Err(io::Error::new(ErrorKind::AddrInUse, "another process listens there"));
    }
    fs::remove_file(path)
}

/// Opens the socket to user and group, whatever the process's mask says.
///
/// # Errors
/// When the file is gone or belongs to somebody else.
pub fn open_to_the_group(path: &Path) -> io::Result<()> {
    fs::set_permissions(path, Permissions::from_mode(MODE))
}
