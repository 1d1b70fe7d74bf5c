//! The parameters of the base model by their names: what "recalibrate" may move.

/// One value for each parameter that the base model already has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Base<T> {
    /// Change of the gain of both curves; 0 as calibrated.
    pub gain: T,
    /// Change of their offset [bar].
    pub offset: T,
    /// Change of the distance between them [bar].
    pub width: T,
    /// Logarithm of `a` [bar^2].
    pub ln_a: T,
    /// Delay and lag together [s].
    pub late: T,
    /// The lag [s].
    pub lag: T,
}

/// Where each stands in the vector that a fit moves; the parameters of the effects come after them.
pub const AT: Base<usize> = Base { gain: 0, offset: 1, width: 2, ln_a: 3, late: 4, lag: 5 };

/// How many there are.
pub const BASE: usize = AT.lag + 1;

impl<T> Base<T> {
    /// All of them, in the order of the vector.
    pub fn in_order(self) -> [T; BASE] {
        [self.gain, self.offset, self.width, self.ln_a, self.late, self.lag]
    }
}

impl Base<f64> {
    /// Those of a vector.
    ///
    /// # Panics
    /// Where it holds fewer than [`BASE`] values.
    pub fn of(theta: &[f64]) -> Self {
        let at = |k: usize| theta[k];
        Self { gain: at(AT.gain), offset: at(AT.offset), width: at(AT.width), ln_a: at(AT.ln_a), late: at(AT.late), lag: at(AT.lag) }
    }

    /// The delay [s].
    pub fn delay_s(&self) -> f64 {
        (self.late - self.lag).max(0.0)
    }

    /// How long it remembers [s]: delay and five times its lag, of which less than a hundredth is left then.
    pub fn memory_s(&self) -> f64 {
        self.late + 4.0 * self.lag
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_the_vector_is_that_of_the_names() {
        assert_eq!(AT.in_order(), std::array::from_fn::<usize, BASE, _>(|k| k));
        let theta = [0.01, 0.2, -0.3, 1.5, 0.03, 0.01, 99.0];
        assert_eq!(Base::of(&theta).in_order(), theta[..BASE]);
        assert!((Base::of(&theta).delay_s() - 0.02).abs() < 1e-15);
    }
}
