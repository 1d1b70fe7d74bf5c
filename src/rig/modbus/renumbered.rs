//! Transaction ids that go on over connections: the codec of each connection counts from 0, and this moves its ids.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::rig::wire::BusPort;

/// Bytes up to and including the length of a frame's rest.
const HEAD: usize = 6;

/// A port whose frames have ids that are combined with `mask` on their way out, and back on their way in.
///
/// The combination is bitwise, so that a header may come in pieces: below the lowest bit of the mask it is an addition.
#[derive(Debug)]
pub struct Renumbered {
    port: BusPort,
    mask: [u8; 2],
    /// Bytes of the frame under way out that are still to be written.
    out_left: usize,
    /// Place in the incoming frame, its head as it came, and the bytes behind the head.
    at: usize,
    head: [u8; HEAD],
    rest: usize,
}

impl Renumbered {
    /// Over `port`, with ids from `first_id` on.
    pub fn new(port: BusPort, first_id: u16) -> Self {
        Self { port, mask: first_id.to_be_bytes(), out_left: 0, at: 0, head: [0; HEAD], rest: 0 }
    }

    fn incoming(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            if self.at < HEAD {
                self.head[self.at] = *byte;
                if let Some(mask) = self.mask.get(self.at) {
                    *byte ^= mask;
                }
                self.at += 1;
                if self.at == HEAD {
                    self.rest = usize::from(u16::from_be_bytes([self.head[4], self.head[5]]));
                    self.at = if self.rest == 0 { 0 } else { HEAD };
                }
            } else {
                self.rest -= 1;
                self.at = if self.rest == 0 { 0 } else { HEAD };
            }
        }
    }
}

impl AsyncRead for Renumbered {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let result = Pin::new(&mut self.port).poll_read(cx, buffer);
        self.incoming(&mut buffer.filled_mut()[before..]);
        result
    }
}

impl AsyncWrite for Renumbered {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        if self.out_left > 0 || bytes.len() < HEAD {
            let n = std::task::ready!(Pin::new(&mut self.port).poll_write(cx, bytes))?;
            self.out_left = self.out_left.saturating_sub(n);
            return Poll::Ready(Ok(n));
        }
        // The codec writes a request as a whole; its reply begins a new frame, whatever came before it.
        let mut frame = bytes.to_vec();
        frame.iter_mut().zip(self.mask).for_each(|(byte, mask)| *byte ^= mask);
        let n = std::task::ready!(Pin::new(&mut self.port).poll_write(cx, &frame))?;
        (self.out_left, self.at) = (bytes.len() - n, 0);
        Poll::Ready(Ok(n))
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.port).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.port).poll_shutdown(cx)
    }
}
