//! x^m for one exponent and many x: a table of the mantissa's powers, and of the powers of two.

use std::cell::RefCell;
use std::sync::Arc;

/// Steps of the mantissa between 1 and 2.
const STEPS: usize = 512;
/// Powers of two of the table: from 2^-60 to 2^60.
const TWOS: i32 = 60;
/// Largest exponent for which the table is exact to 1e-5.
const MOST: f64 = 6.0;
/// Tables that a thread keeps: a fit moves the other parameters more often than an exponent.
const KEPT: usize = 8;

/// The power function of one exponent, exact to 1e-5 of its value.
#[derive(Debug, Clone)]
pub(super) struct Power {
    exponent: f64,
    table: Arc<Table>,
}

#[derive(Debug)]
struct Table {
    mantissa: [f64; STEPS + 1],
    twos: [f64; 2 * TWOS as usize + 1],
}

impl Table {
    fn new(exponent: f64) -> Self {
        Self {
            mantissa: std::array::from_fn(|k| (1.0 + k as f64 / STEPS as f64).powf(exponent)),
            twos: std::array::from_fn(|k| (exponent * (k as f64 - f64::from(TWOS))).exp2()),
        }
    }
}

thread_local! {
    /// The tables made last, the latest at the end.
    static TABLES: RefCell<Vec<(u64, Arc<Table>)>> = const { RefCell::new(Vec::new()) };
}

impl Power {
    /// For x^`exponent`.
    pub fn new(exponent: f64) -> Self {
        let key = exponent.to_bits();
        let table = TABLES.with_borrow_mut(|kept| {
            let table = match kept.iter().position(|(bits, _)| *bits == key) {
                Some(at) => kept.remove(at).1,
                None => Arc::new(Table::new(exponent)),
            };
            if kept.len() >= KEPT {
                kept.remove(0);
            }
            kept.push((key, table.clone()));
            table
        });
        Self { exponent, table }
    }

    /// `x` to the exponent, for `x` >= 0.
    #[inline]
    pub fn of(&self, x: f64) -> f64 {
        let bits = x.to_bits();
        let twos = (bits >> 52) as i32 - 1023;
        if self.exponent > MOST || !(-TWOS..=TWOS).contains(&twos) {
            return x.powf(self.exponent);
        }
        let part = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 0x3ff0_0000_0000_0000) - 1.0;
        let place = part * STEPS as f64;
        let k = place as usize;
        let (low, high) = (self.table.mantissa[k], self.table.mantissa[k + 1]);
        (low + (high - low) * (place - k as f64)) * self.table.twos[(twos + TWOS) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_function() {
        for exponent in [0.05, 0.5, 1.0, 1.7, 3.0, 6.0, 9.0] {
            let power = Power::new(exponent);
            for x in [0.0, 1e-300, 1e-9, 0.3, 0.999_999, 1.0, 1.3, 2.0, 17.3, 4e5, 1e300] {
                let exact = f64::powf(x, exponent);
                let close = (power.of(x) - exact).abs() <= 2e-5 * exact;
                assert!(close || power.of(x) == exact, "{x}^{exponent}: {} for {exact}", power.of(x));
            }
        }
    }
}
