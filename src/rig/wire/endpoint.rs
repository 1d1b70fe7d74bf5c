//! Where a device is reached, and messages that say what to do when it is not.

use std::fmt;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::TcpStream;
use tokio_serial::{SerialPortBuilderExt, SerialStream};

use super::port::Stream;
use crate::rig::RigError;
use crate::rig::profile::{Parity, Transport, TransportKind};

/// Where a device is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Endpoint {
    /// A serial port.
    Serial(PathBuf),
    /// Host and port.
    Tcp(String),
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(path) => write!(f, "{}", path.display()),
            Self::Tcp(address) => f.write_str(address),
        }
    }
}

impl Endpoint {
    /// Whether this kind of line goes there.
    pub fn check(&self, kind: TransportKind, profile: &str) -> Result<(), RigError> {
        let fits = match self {
            Self::Serial(_) => matches!(kind, TransportKind::Rtu | TransportKind::Line),
            Self::Tcp(_) => kind != TransportKind::Rtu,
        };
        let wanted = if matches!(self, Self::Serial(_)) { "--tcp HOST:PORT" } else { "--port DEVICE" };
        if fits {
            Ok(())
        } else {
            Err(RigError::Open { place: self.to_string(), reason: format!("{profile} is for another kind of line; use {wanted}") })
        }
    }

    fn failed(&self, reason: String) -> RigError {
        RigError::Open { place: self.to_string(), reason }
    }

    /// Opens the line; must be called inside the runtime. `within` bounds a connection.
    pub async fn open(&self, transport: &Transport, within: Duration) -> Result<Stream, RigError> {
        match self {
            Self::Serial(path) => self.open_serial(path, transport).map(|s| Stream::Serial(Box::new(s))),
            Self::Tcp(address) => {
                let stream = tokio::time::timeout(within, TcpStream::connect(self.resolve(address)?)).await;
                let stream = match stream {
                    Err(_) => {
                        return Err(
                            self.failed(format!("no answer within {} ms: is the device on, and is this its address?", within.as_millis()))
                        );
                    }
                    Ok(Err(e)) if e.kind() == std::io::ErrorKind::ConnectionRefused => {
                        return Err(self.failed(
                            "the connection is refused: nothing listens there; check address and port (Modbus TCP usually is 502)".into(),
                        ));
                    }
                    Ok(Err(e)) => return Err(self.failed(e.to_string())),
                    Ok(Ok(stream)) => stream,
                };
                // Without it a request can wait for the acknowledgement of the one before.
                stream.set_nodelay(true).map_err(|e| self.failed(e.to_string()))?;
                Ok(Stream::Tcp(stream))
            }
        }
    }

    fn resolve(&self, address: &str) -> Result<SocketAddr, RigError> {
        if let Ok(numeric) = address.parse() {
            return Ok(numeric);
        }
        let found = address.to_socket_addrs().map_err(|e| self.failed(format!("{e}; write HOST:PORT, for instance 192.168.0.10:502")))?;
        found.into_iter().next().ok_or_else(|| self.failed("this name has no address".into()))
    }

    fn open_serial(&self, path: &Path, t: &Transport) -> Result<SerialStream, RigError> {
        let parity = match t.parity {
            Parity::None => tokio_serial::Parity::None,
            Parity::Even => tokio_serial::Parity::Even,
            Parity::Odd => tokio_serial::Parity::Odd,
        };
        let stop = if t.stop_bits == 2 { tokio_serial::StopBits::Two } else { tokio_serial::StopBits::One };
        let name = path.to_string_lossy();
        tokio_serial::new(name.as_ref(), t.baud)
            .parity(parity)
            .stop_bits(stop)
            .open_native_async()
            .map_err(|e| self.failed(advice(path, &e)))
    }
}

fn advice(path: &Path, error: &tokio_serial::Error) -> String {
    use std::io::ErrorKind;
    let kind = match (error.kind(), std::fs::metadata(path)) {
        (_, Err(e)) => e.kind(),
        (tokio_serial::ErrorKind::Io(kind), Ok(_)) => kind,
        _ => ErrorKind::Other,
    };
    match kind {
        ErrorKind::NotFound => format!("there is no such port{}", ports()),
        ErrorKind::PermissionDenied => {
            "you may not open it: add yourself to the group of the device (usually `sudo usermod -aG dialout $USER`) and log in again"
                .into()
        }
        _ if error.description.contains("exclusive") || error.description.contains("busy") => {
            format!("another program holds it (`fuser {}` says which)", path.display())
        }
        _ => format!("{error}; is this a serial port? They are /dev/serial/by-id/..., /dev/ttyUSB0, /dev/ttyACM0, /dev/ttyS0 and the like"),
    }
}

/// The serial ports of this machine, for a message.
fn ports() -> String {
    let names: Vec<String> = ["/dev/serial/by-id"]
        .iter()
        .flat_map(|d| std::fs::read_dir(d).into_iter().flatten().flatten())
        .map(|e| e.path().display().to_string())
        .collect();
    if names.is_empty() {
        "; no USB serial adapter is plugged in here (/dev/serial/by-id is empty)".into()
    } else {
        format!("; there are: {}", names.join(", "))
    }
}

/// Asks the kernel for the adapter's low-latency mode; says what came of it.
pub fn low_latency(path: &Path) -> &'static str {
    let Some(device) = std::fs::canonicalize(path).ok().and_then(|p| p.file_name().map(|n| n.to_owned())) else { return "unknown device" };
    let timer = Path::new("/sys/bus/usb-serial/devices").join(device).join("latency_timer");
    if !timer.exists() {
        return "not needed (no USB adapter with a latency timer)";
    }
    if std::fs::write(&timer, "1").is_ok() || std::fs::read_to_string(&timer).is_ok_and(|t| t.trim() == "1") {
        "latency timer 1 ms"
    } else {
        "not permitted: the adapter may hold replies back for 16 ms; run `setserial DEVICE low_latency` as root"
    }
}
