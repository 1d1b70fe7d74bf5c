//! x^m for one exponent and many x: a table of the mantissa's powers, and of the powers of two.

/// Steps of the mantissa between 1 and 2.
const STEPS: usize = 512;
/// Powers of two of the table: from 2^-60 to 2^60.
const TWOS: i32 = 60;
/// Largest exponent for which the table is exact to 1e-5.
const MOST: f64 = 6.0;

/// The power function of one exponent, exact to 1e-5 of its value.
#[derive(Debug, Clone)]
pub(super) struct Power {
    exponent: f64,
    mantissa: Box<[f64; STEPS + 1]>,
    twos: Box<[f64; 2 * TWOS as usize + 1]>,
}

impl Power {
    /// For x^`exponent`.
    pub fn new(exponent: f64) -> Self {
        Self {
            exponent,
            mantissa: Box::new(std::array::from_fn(|k| (1.0 + k as f64 / STEPS as f64).powf(exponent))),
            twos: Box::new(std::array::from_fn(|k| (exponent * (k as f64 - f64::from(TWOS))).exp2())),
        }
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
        let (low, high) = (self.mantissa[k], self.mantissa[k + 1]);
        (low + (high - low) * (place - k as f64)) * self.twos[(twos + TWOS) as usize]
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
