//! A serial port or a TCP connection under the codec: no blocking flush, the kernel's input can be purged, own echoed
//! bytes are stripped, and every frame leaves a trace.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio_serial::{SerialPort, SerialStream};

use super::bus::{TRACED_BYTES, TracedFrame};
use crate::rig::realtime::Clock;

/// Frames kept: about three seconds at 100 Hz with two frames per slot.
const TRACED_FRAMES: usize = 600;

/// The stream below a port.
#[derive(Debug)]
pub enum Stream {
    /// A serial port.
    Serial(Box<SerialStream>),
    /// A TCP connection.
    Tcp(TcpStream),
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    time_s: f64,
    sent: bool,
    length: u8,
    bytes: [u8; TRACED_BYTES],
}

/// A bounded memory of frames; it never grows.
#[derive(Debug)]
struct Ring {
    entries: Vec<Entry>,
    next: usize,
}

#[derive(Debug)]
struct Inner {
    stream: Stream,
    strip_echo: bool,
    echo: Vec<u8>,
    clock: Clock,
    ring: Ring,
}

/// A port that the codec owns one handle of and the driver another.
#[derive(Debug, Clone)]
pub struct BusPort(Arc<Mutex<Inner>>);

impl BusPort {
    /// A port over an open stream; `strip_echo` where the adapter returns every sent byte.
    pub fn new(stream: Stream, strip_echo: bool, clock: Clock) -> Self {
        let ring = Ring { entries: Vec::with_capacity(TRACED_FRAMES), next: 0 };
        Self(Arc::new(Mutex::new(Inner { stream, strip_echo, echo: Vec::with_capacity(256), clock, ring })))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Throws away what the kernel has received and nobody has read.
    pub fn purge(&self) {
        let mut inner = self.lock();
        inner.echo.clear();
        let mut rest = [0u8; 256];
        match &mut inner.stream {
            Stream::Serial(port) => {
                let _ = port.clear(tokio_serial::ClearBuffer::Input);
                while matches!(port.try_read(&mut rest), Ok(n) if n > 0) {}
            }
            Stream::Tcp(stream) => while matches!(stream.try_read(&mut rest), Ok(n) if n > 0) {},
        }
    }

    /// Puts another stream under the port, after a reconnection; the trace goes on.
    pub fn replace(&self, stream: Stream) {
        let mut inner = self.lock();
        inner.stream = stream;
        inner.echo.clear();
    }

    /// The latest frames, the oldest first.
    pub fn trace(&self) -> Vec<TracedFrame> {
        let inner = self.lock();
        let ring = &inner.ring;
        let split = if ring.entries.len() < TRACED_FRAMES { 0 } else { ring.next };
        let (new, old) = ring.entries.split_at(split);
        old.iter()
            .chain(new)
            .map(|e| TracedFrame { time_s: e.time_s, sent: e.sent, bytes: e.bytes[..usize::from(e.length)].to_vec() })
            .collect()
    }

    /// Writes bytes as they are.
    pub async fn write_all(&self, bytes: &[u8]) -> io::Result<()> {
        tokio::io::AsyncWriteExt::write_all(&mut self.clone(), bytes).await
    }

    /// Reads what is there into `buffer`.
    pub async fn read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        tokio::io::AsyncReadExt::read(&mut self.clone(), buffer).await
    }
}

impl Inner {
    fn note(&mut self, sent: bool, bytes: &[u8]) {
        let time_s = self.clock.now_s();
        let length = bytes.len().min(TRACED_BYTES);
        let ring = &mut self.ring;
        // What comes in pieces within a millisecond is one frame.
        if let Some(last) = ring.next.checked_sub(1).and_then(|i| ring.entries.get_mut(i))
            && last.sent == sent
            && !sent
            && time_s - last.time_s < 1e-3
        {
            let from = usize::from(last.length);
            let n = length.min(TRACED_BYTES - from);
            last.bytes[from..from + n].copy_from_slice(&bytes[..n]);
            last.length += n as u8;
            return;
        }
        let mut entry = Entry { time_s, sent, length: length as u8, bytes: [0; TRACED_BYTES] };
        entry.bytes[..length].copy_from_slice(&bytes[..length]);
        if ring.entries.len() < TRACED_FRAMES {
            ring.entries.push(entry);
            ring.next = ring.entries.len() % TRACED_FRAMES;
        } else {
            ring.entries[ring.next] = entry;
            ring.next = (ring.next + 1) % TRACED_FRAMES;
        }
    }

    /// Takes the own bytes off the start of what was received; returns what is left.
    fn strip(&mut self, received: &mut [u8]) -> usize {
        let same = received.iter().zip(&self.echo).take_while(|(a, b)| a == b).count();
        if same < received.len() && same < self.echo.len() {
            // Not an echo after all: what was expected does not come any more.
            self.echo.clear();
            return received.len();
        }
        self.echo.drain(..same);
        received.copy_within(same.., 0);
        received.len() - same
    }
}

impl AsyncRead for BusPort {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let mut guard = self.lock();
        let inner = &mut *guard;
        loop {
            let before = buffer.filled().len();
            let result = match &mut inner.stream {
                Stream::Serial(port) => Pin::new(port.as_mut()).poll_read(cx, buffer),
                Stream::Tcp(stream) => Pin::new(stream).poll_read(cx, buffer),
            };
            let Poll::Ready(Ok(())) = result else { return result };
            let received = buffer.filled().len() - before;
            if received == 0 {
                return Poll::Ready(Ok(()));
            }
            let mut copy = [0u8; TRACED_BYTES];
            let n = received.min(TRACED_BYTES);
            copy[..n].copy_from_slice(&buffer.filled()[before..before + n]);
            inner.note(false, &copy[..n]);
            if !inner.strip_echo || inner.echo.is_empty() {
                return Poll::Ready(Ok(()));
            }
            let left = inner.strip(&mut buffer.filled_mut()[before..]);
            buffer.set_filled(before + left);
            if left > 0 {
                return Poll::Ready(Ok(()));
            }
        }
    }
}

impl AsyncWrite for BusPort {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let mut guard = self.lock();
        let inner = &mut *guard;
        let result = match &mut inner.stream {
            Stream::Serial(port) => Pin::new(port.as_mut()).poll_write(cx, bytes),
            Stream::Tcp(stream) => Pin::new(stream).poll_write(cx, bytes),
        };
        if let Poll::Ready(Ok(n)) = result {
            inner.note(true, &bytes[..n]);
            if inner.strip_echo {
                inner.echo.extend_from_slice(&bytes[..n]);
            }
        }
        result
    }

    // A serial flush is a blocking drain inside the async task; the time-out of the reply covers what it would wait for.
    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
