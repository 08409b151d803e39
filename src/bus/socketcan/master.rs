//! One master per bus on this computer. RT: before arming only.

use std::io::{Error, ErrorKind};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Held as long as it lives; the kernel gives it up with the process, however that ends. Its name is in the network
/// namespace, as the interface's is.
#[derive(Debug)]
pub struct MasterLock {
    _name: UnixDatagram,
}

impl MasterLock {
    /// Takes the lock of this name: an interface, or a robot.
    ///
    /// # Errors
    /// `AddrInUse` when another process has it.
    pub fn take(kind: &str, name: &str) -> std::io::Result<Self> {
        let address = SocketAddr::from_abstract_name([b"compass.", kind.as_bytes(), b".", name.as_bytes()].concat())?;
        match UnixDatagram::bind_addr(&address) {
            Ok(socket) => Ok(Self { _name: socket }),
            Err(error) if error.kind() == ErrorKind::AddrInUse => {
                Err(Error::new(ErrorKind::AddrInUse, "another `compass run` commands it already"))
            }
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_masters_of_one_bus_are_one_too_many() {
        let name = std::process::id().to_string();
        let first = MasterLock::take("can", &name).unwrap();
        assert_eq!(MasterLock::take("can", &name).unwrap_err().kind(), ErrorKind::AddrInUse);
        assert!(MasterLock::take("robot", &name).is_ok(), "a robot of the same name is something else");
        drop(first);
        assert!(MasterLock::take("can", &name).is_ok());
    }
}
