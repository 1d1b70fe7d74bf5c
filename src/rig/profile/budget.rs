//! The wire budget: how long one slot's frames take on the line, and the arithmetic behind it.
//!
//! Modbus RTU: the characters of request and reply at the baud rate, 3.5 characters of silence after each (fixed
//! 1.75 ms above 19200 baud), and the device's answer time. Host latency is not included.

use super::{Profile, Transaction, TransportKind};

/// Share of the period that the wire may take.
pub const LARGEST_SHARE: f64 = 0.8;

/// The time on the wire of one slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// All transactions with silences and answer times [s].
    pub total_s: f64,
    /// The arithmetic, for people.
    pub arithmetic: String,
}

/// Silence between frames: 3.5 characters up to 19200 baud, 1.75 ms above.
pub fn silence_s(baud: u32, bits_per_character: u32) -> f64 {
    if baud > 19_200 { 1.75e-3 } else { 3.5 * f64::from(bits_per_character) / f64::from(baud) }
}

/// Bytes of request and reply of a transaction as RTU frames, or as lines of text.
pub fn frame_bytes(transaction: &Transaction) -> (u16, u16) {
    if let Some(line) = &transaction.line {
        return (line.request.longest(), line.reply.longest());
    }
    let w = transaction.write.as_ref().map_or(0, |b| b.words);
    let r = transaction.read.as_ref().map_or(0, |b| b.words) + transaction.spare;
    match transaction.function {
        23 => (13 + 2 * w, 5 + 2 * r),
        16 => (9 + 2 * w, 8),
        6 => (8, 8),
        _ => (8, 5 + 2 * r),
    }
}

impl Profile {
    /// Time of `bytes` characters on the serial line [s]; 0 on TCP.
    pub fn characters_s(&self, bytes: usize) -> f64 {
        match self.transport.kind {
            // Of the line behind a gateway the baud rate may be unknown.
            _ if self.transport.baud == 0 => 0.0,
            _ => bytes as f64 * f64::from(self.transport.bits_per_character) / f64::from(self.transport.baud),
        }
    }

    /// Silence between two frames on the serial line [s]; 0 on TCP and between lines of text.
    pub fn frame_silence_s(&self) -> f64 {
        let t = &self.transport;
        let framed = t.baud > 0 && t.kind != TransportKind::Line;
        if framed { silence_s(t.baud, t.bits_per_character) } else { 0.0 }
    }

    /// Time of one slot's frames on the wire.
    pub fn budget(&self) -> Budget {
        let t = &self.transport;
        let (mut total_s, mut lines) = (0.0, Vec::new());
        for (index, transaction) in self.cycle.transactions.iter().enumerate() {
            let what = if transaction.line.is_some() { "line".to_string() } else { format!("function {}", transaction.function) };
            if t.baud == 0 {
                total_s += t.turnaround_s;
                lines.push(format!("  transaction {}: {what}, answer {:.2} ms", index + 1, t.turnaround_s * 1e3));
                continue;
            }
            let (request, reply) = frame_bytes(transaction);
            let characters = self.characters_s(usize::from(request + reply));
            let silence = if transaction.line.is_some() { 0.0 } else { 2.0 * silence_s(t.baud, t.bits_per_character) };
            total_s += characters + silence + t.turnaround_s;
            lines.push(format!(
                "  transaction {}: {what}, {request} + {reply} characters x {} bit / {} baud = {:.2} ms, silence {:.2} ms, answer {:.2} ms",
                index + 1,
                t.bits_per_character,
                t.baud,
                characters * 1e3,
                silence * 1e3,
                t.turnaround_s * 1e3
            ));
        }
        lines.push(format!("  together {:.2} ms", total_s * 1e3));
        Budget { total_s, arithmetic: lines.join("\n") }
    }

    /// The fastest loop that the wire and the device's own rate carry [Hz].
    pub fn highest_rate_hz(&self) -> f64 {
        let wire = if self.budget().total_s > 0.0 { LARGEST_SHARE / self.budget().total_s } else { f64::INFINITY };
        wire.min(self.device.update_hz)
    }

    /// Refuses a loop period that the wire or the device cannot carry, with the arithmetic.
    pub fn check_period(&self, period_s: f64) -> Result<(), String> {
        let rate = 1.0 / period_s;
        if rate > self.device.update_hz * (1.0 + 1e-9) {
            return Err(format!(
                "a loop of {rate:.1} Hz is faster than the device renews its values: `device.update` is {:.1} Hz",
                self.device.update_hz
            ));
        }
        let budget = self.budget();
        let share = budget.total_s / period_s;
        if share > LARGEST_SHARE {
            return Err(format!(
                "a loop of {rate:.1} Hz needs {:.0} % of its period of {:.2} ms on the wire; {:.0} % is the most, so {:.1} Hz:\n{}",
                share * 100.0,
                period_s * 1e3,
                LARGEST_SHARE * 100.0,
                self.highest_rate_hz(),
                budget.arithmetic
            ));
        }
        // Once in half a second the registers of the watchdog are read behind the slot's own frames; the reply must be there
        // before the next slot begins.
        let check_s = self.characters_s(15) + self.frame_silence_s() + self.transport.turnaround_s;
        if self.watchdog.protects() && !self.watchdog.check.is_empty() && budget.total_s + check_s > period_s {
            return Err(format!(
                "a loop of {rate:.1} Hz leaves no time to read the watchdog back: the slot's {:.2} ms and {:.2} ms for one register are more than its period of {:.2} ms:\n{}",
                budget.total_s * 1e3,
                check_s * 1e3,
                period_s * 1e3,
                budget.arithmetic
            ));
        }
        if self.cycle.timeout_s >= period_s {
            return Err(format!(
                "`cycle.timeout` of {:.2} ms leaves nothing of a period of {:.2} ms; it must be shorter",
                self.cycle.timeout_s * 1e3,
                period_s * 1e3
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::silence_s;

    #[test]
    fn silence_follows_the_serial_line_specification() {
        assert_eq!(silence_s(115_200, 10), 1.75e-3);
        assert!((silence_s(9600, 10) - 3.645_833e-3).abs() < 1e-8);
        assert_eq!(silence_s(19_200, 11), 3.5 * 11.0 / 19_200.0);
    }
}
