//! The robot's socket for a remote hand, and its thread. RT: no.

use super::super::aside::{AsideHand, Desk, now};
use super::Refused;
use super::packet::{Key, LONGEST, Nonce};
use super::receiver::Receiver;
use crate::base::time::Span;
use crate::config::checked::OperatorRemote;
use crate::msg::Status;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The thread looks at least so often whether it is still needed, and whether a view is due.
const TURN: Duration = Duration::from_millis(20);
/// A shorter secret can be guessed.
const SHORTEST_SECRET: usize = 16;
/// A longer one is some other file.
const LONGEST_SECRET: usize = 4096;

/// Opens the port and starts its thread.
///
/// # Errors
/// When the secret cannot be read or is too open, or the port is taken.
pub(crate) fn open(
    config: &OperatorRemote,
    operator_age: Span,
    highest_m_s: Option<f64>,
) -> io::Result<(AsideHand, Arc<Refused>)> {
    let secret = read_secret(Path::new(&config.secret_file))?;
    let socket = UdpSocket::bind(config.listen)?;
    socket.set_read_timeout(Some(TURN))?;
    let receiver = Receiver::new(secret, operator_age, highest_m_s);
    let refused = receiver.refused();
    Ok((AsideHand::start(move |desk| serve(desk, &socket, receiver))?, refused))
}

fn serve(desk: &Desk, socket: &UdpSocket, mut receiver: Receiver) {
    let mut robot = Status::default();
    while !desk.is_over() {
        // One byte more than any of ours, so that a longer one is not taken for one that was cut.
        let mut bytes = [0; LONGEST + 1];
        if let Ok((count, from)) = socket.recv_from(&mut bytes) {
            // A datagram that waited in the kernel counts from now on; the clock fit knows how late that is.
            let answer = receiver.take(now(), from, bytes.get(..count).unwrap_or(&[]), || chance().ok());
            desk.put(&receiver.sample());
            answer.into_iter().for_each(|datagram| send(socket, from, datagram.as_slice()));
        }
        robot = desk.robot().unwrap_or(robot);
        if let Some((peer, datagram)) = receiver.view(now(), &robot) {
            send(socket, peer, datagram.as_slice());
        }
    }
}

/// What the network does not take is lost, as on any other part of its way.
fn send(socket: &UdpSocket, peer: SocketAddr, bytes: &[u8]) {
    drop(socket.send_to(bytes, peer));
}

/// Bytes that nobody can foretell.
///
/// # Errors
/// When the system has none.
pub fn chance() -> io::Result<Nonce> {
    let mut bytes = Nonce::default();
    File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// The secret of a file that others cannot read; white space at its end does not count.
///
/// # Errors
/// When it cannot be read, is too open, too short or too long.
pub fn read_secret(path: &Path) -> io::Result<Key> {
    let refuse = |what: &'static str| Err(io::Error::new(ErrorKind::InvalidInput, what));
    let mut file = File::open(path)?;
    if file.metadata()?.permissions().mode() & 0o007 != 0 {
        return refuse("others may read the secret: chmod o= it");
    }
    let mut bytes = [0; LONGEST_SECRET];
    let mut count = 0;
    while let Some(rest) = bytes.get_mut(count..).filter(|rest| !rest.is_empty()) {
        match file.read(rest)? {
            0 => break,
            more => count += more,
        }
    }
    let secret = bytes.get(..count).unwrap_or(&[]).trim_ascii_end();
    match secret.len() {
        0..SHORTEST_SECRET => refuse("the secret is shorter than 16 bytes: head -c 32 /dev/urandom | base64 makes one"),
        LONGEST_SECRET => refuse("the secret is longer than 4095 bytes"),
        _ => Key::new(secret).ok_or_else(|| io::Error::other("no key")),
    }
}
