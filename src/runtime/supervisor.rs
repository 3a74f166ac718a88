use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::time::Duration;

use miette::Diagnostic;
use thiserror::Error;

/// Why the supervisor that started the process cannot be told anything.
#[derive(Debug, Error, Diagnostic)]
pub enum SupervisorError {
    /// Its socket cannot be reached.
    #[error("the supervisor's socket NOTIFY_SOCKET={address} cannot be reached: {reason}")]
    #[diagnostic(help(
        "it has to be an absolute path, or @ and a name; unset it to run without a supervisor"
    ))]
    Socket {
        /// What the environment says.
        address: String,
        /// Why.
        reason: io::Error,
    },

    /// The time within which it wants to hear is none.
    #[error("WATCHDOG_USEC={0} is no time in µs")]
    Time(String),
}

/// The process that started this one and restarts it, such as systemd, and its protocol: datagrams of
/// `NAME=value` lines to the socket that `NOTIFY_SOCKET` names (sd_notify(3)).
///
/// Never waits: what a socket has no room for is said again later.
#[derive(Debug)]
pub struct Supervisor {
    socket: UnixDatagram,
    address: SocketAddr,
    watchdog: Option<Duration>,
}

impl Supervisor {
    /// The one that the environment names, if there is one. It wants a heartbeat if `WATCHDOG_USEC` is
    /// set, and `WATCHDOG_PID` is this process or not set.
    ///
    /// # Errors
    /// [`SupervisorError`].
    pub fn from_environment() -> Result<Option<Self>, SupervisorError> {
        let Some(address) = std::env::var_os("NOTIFY_SOCKET") else { return Ok(None) };
        let own = std::env::var("WATCHDOG_PID").map_or(true, |pid| pid == std::process::id().to_string());
        let watchdog = match std::env::var("WATCHDOG_USEC") {
            Ok(text) if own => match text.parse() {
                Ok(us) if us > 0 => Some(Duration::from_micros(us)),
                _ => return Err(SupervisorError::Time(text)),
            },
            _ => None,
        };
        Self::at(address.as_bytes(), watchdog).map(Some).map_err(|reason| SupervisorError::Socket {
            address: address.to_string_lossy().into_owned(),
            reason,
        })
    }

    /// The one that listens at `address`, a path or `@` and an abstract name, and wants a heartbeat within
    /// every `watchdog`.
    ///
    /// # Errors
    /// The address is none, or nobody listens there.
    pub fn at(address: &[u8], watchdog: Option<Duration>) -> io::Result<Self> {
        let address = match address {
            [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
            [b'/', ..] => SocketAddr::from_pathname(Path::new(std::ffi::OsStr::from_bytes(address)))?,
            _ => {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is neither a path nor abstract"));
            }
        };
        UnixDatagram::unbound()?.connect_addr(&address)?;
        // Not connected itself: a supervisor that was started again listens with another socket.
        let socket = UnixDatagram::unbound()?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, address, watchdog })
    }

    /// Within what time it wants to hear that all is well.
    pub(super) fn watchdog(&self) -> Option<Duration> {
        self.watchdog
    }

    /// Says it; false when there is no room, or nobody listens just now.
    pub(super) fn tell(&self, text: &str) -> bool {
        self.socket.send_to_addr(text.as_bytes(), &self.address).is_ok_and(|sent| sent == text.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_abstract_names_are_reached_and_nothing_else_is() {
        let name = format!("clearway_supervisor_{}", std::process::id());
        let path = std::env::temp_dir().join(&name);
        let abstract_address = SocketAddr::from_abstract_name(&name).unwrap();
        for (listener, address) in [
            (UnixDatagram::bind(&path).unwrap(), path.to_string_lossy().into_owned()),
            (UnixDatagram::bind_addr(&abstract_address).unwrap(), format!("@{name}")),
        ] {
            let supervisor = Supervisor::at(address.as_bytes(), None).unwrap();
            assert!(supervisor.tell("READY=1\n"));
            let mut bytes = [0; 64];
            let length = listener.recv(&mut bytes).unwrap();
            assert_eq!(&bytes[..length], b"READY=1\n");
            // A listener that does not look never makes anybody wait.
            let told = (0..100_000).take_while(|_| supervisor.tell("WATCHDOG=1\n")).count();
            assert!(told < 100_000);
            drop(listener);
            assert!(!supervisor.tell("WATCHDOG=1\n"));
        }
        std::fs::remove_file(&path).unwrap();
        for address in ["", "relative", "/no/such/socket", "@clearway_nobody_listens_here"] {
            assert!(Supervisor::at(address.as_bytes(), None).is_err(), "{address:?}");
        }
    }

    #[test]
    fn a_supervisor_that_was_started_again_hears_as_before() {
        let path = std::env::temp_dir().join(format!("clearway_supervisor_again_{}", std::process::id()));
        let first = UnixDatagram::bind(&path).unwrap();
        let supervisor = Supervisor::at(path.as_os_str().as_bytes(), None).unwrap();
        assert!(supervisor.tell("READY=1\n"));
        drop(first);
        std::fs::remove_file(&path).unwrap();
        assert!(!supervisor.tell("WATCHDOG=1\n"));
        let second = UnixDatagram::bind(&path).unwrap();
        assert!(supervisor.tell("WATCHDOG=1\n"));
        let mut bytes = [0; 64];
        let length = second.recv(&mut bytes).unwrap();
        assert_eq!(&bytes[..length], b"WATCHDOG=1\n");
        std::fs::remove_file(&path).unwrap();
    }
}
