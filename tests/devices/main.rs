//! Tests that drive an emulated device in real time. They are a program of their own, so that no computation of another
//! test takes the processor from them.

mod allowed;
mod fake;
mod last_word;
mod metronome;
mod power;
mod promises;
mod signals;
mod soak;
mod station;
mod ways_out;
mod wire;
mod wire_ends;
mod wire_peers;
mod wire_rows;
mod wire_soak;
mod wire_variants;
