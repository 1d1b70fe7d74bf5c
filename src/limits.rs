//! Pass, marginal or fail: decided here and nowhere else.
