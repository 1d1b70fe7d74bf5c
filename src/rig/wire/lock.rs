//! One program holds a device: a lock of this machine for what is reached over TCP. A serial port has the lock of the system.

use std::fs::{File, OpenOptions, TryLockError};
use std::net::ToSocketAddrs;
use std::path::PathBuf;

use super::Endpoint;
use crate::rig::RigError;
use crate::rig::profile::{Transport, TransportKind};

/// A device that no other program of this machine may drive while this lives; the system lets go of it however the process ends.
#[derive(Debug)]
pub(super) struct DeviceLock {
    _file: File,
}

/// Takes the lock of a device; `None` where the line has another one, or the machine has no place for it.
///
/// # Errors
/// [`RigError::Open`] where another program holds the device.
pub(super) fn hold(transport: &Transport, endpoint: &Endpoint) -> Result<Option<DeviceLock>, RigError> {
    let Endpoint::Tcp(address) = endpoint else { return Ok(None) };
    // A name that does not resolve is told better where it is opened.
    let Some(at) = address.to_socket_addrs().ok().and_then(|mut all| all.next()) else { return Ok(None) };
    // Behind a serial server all units share one line; elsewhere each unit is a device of its own.
    let one_line = matches!(transport.kind, TransportKind::RtuOverTcp | TransportKind::Line);
    let unit = if one_line { "line".to_string() } else { transport.unit.to_string() };
    let name: String =
        format!("hil-device-{at}-{unit}.lock").chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '.' }).collect();
    let Some(file) = open(&std::env::temp_dir().join(name)) else { return Ok(None) };
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(RigError::Open {
            place: endpoint.to_string(),
            reason: "another program of this machine drives this device; end it first".into(),
        }),
        _ => Ok(Some(DeviceLock { _file: file })),
    }
}

/// The lock file, made where there is none; another user's can be read, which is enough.
fn open(path: &PathBuf) -> Option<File> {
    let made = OpenOptions::new().write(true).create_new(true).open(path);
    made.or_else(|_| File::open(path)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::profile::Profile;

    #[test]
    fn a_device_has_one_driver_whatever_its_name() {
        let profile = Profile::from_toml(include_str!("../../../drivers/emulator-tcp.toml"), "emulator-tcp.toml").unwrap();
        let at = |address: &str| hold(&profile.transport, &Endpoint::Tcp(address.into()));
        let held = at("127.0.0.1:47999").unwrap();
        assert!(held.is_some());
        assert!(at("127.0.0.1:47999").unwrap_err().to_string().contains("another program"));
        assert!(at("127.0.0.1:47998").unwrap().is_some(), "another port is another device");
        drop(held);
        assert!(at("127.0.0.1:47999").unwrap().is_some());
        assert!(hold(&profile.transport, &Endpoint::Serial("/dev/ttyS0".into())).unwrap().is_none());
    }
}
