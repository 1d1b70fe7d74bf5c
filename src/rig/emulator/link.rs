//! Where the emulated device listens: the master side of a pseudo terminal, or a TCP port.

use std::fs::File;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A byte stream that can be read with a time limit.
pub trait Link {
    /// Reads what is there, waiting at most `wait`; `Ok(None)` when nothing came, `Ok(Some(0))` when the peer left.
    fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<Option<usize>>;
    /// Writes everything.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// A pseudo terminal: the emulator holds the master, the driver opens the device at [`Pty::path`].
pub struct Pty {
    master: File,
    // Held open so that the master sees no hang-up between two clients.
    _device: File,
    path: PathBuf,
    link: Option<PathBuf>,
}

impl Pty {
    /// Opens a pseudo terminal in raw mode; `link` becomes a symbolic link to its device.
    pub fn open(link: Option<&Path>) -> io::Result<Self> {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
        // Elsewhere it is no flag of this call.
        #[cfg(target_os = "linux")]
        let flags = flags | OpenptFlags::CLOEXEC;
        let master = openpt(flags)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let path = PathBuf::from(name.to_str().map_err(io::Error::other)?);
        let device = File::options().read(true).write(true).open(&path)?;
        let mut settings = rustix::termios::tcgetattr(&device)?;
        settings.make_raw();
        rustix::termios::tcsetattr(&device, rustix::termios::OptionalActions::Now, &settings)?;
        let link = link.map(Path::to_path_buf);
        if let Some(link) = &link {
            // The link of an emulator that is gone may go; one to a file is somebody's.
            if link.is_symlink() && std::fs::read_link(link)?.starts_with("/dev") {
                std::fs::remove_file(link)?;
            }
            std::os::unix::fs::symlink(&path, link)?;
        }
        Ok(Self { master: File::from(master), _device: device, path, link })
    }

    /// What a driver opens.
    pub fn path(&self) -> &Path {
        self.link.as_deref().unwrap_or(&self.path)
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
    }
}

impl Link for Pty {
    fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<Option<usize>> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let timeout = Timespec { tv_sec: wait.as_secs() as i64, tv_nsec: wait.subsec_nanos().into() };
        let mut fds = [PollFd::new(&self.master, PollFlags::IN)];
        match poll(&mut fds, Some(&timeout)) {
            Ok(0) | Err(rustix::io::Errno::INTR) => Ok(None),
            Ok(_) => self.master.read(buffer).map(Some),
            Err(e) => Err(e.into()),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.master.write_all(bytes)
    }
}

impl Link for TcpStream {
    fn read(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<Option<usize>> {
        self.set_read_timeout(Some(wait.max(Duration::from_micros(1))))?;
        match Read::read(self, buffer) {
            Ok(n) => Ok(Some(n)),
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }
}
