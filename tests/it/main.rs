//! Integration tests: the library and the program from outside.

#[cfg(unix)]
mod batch;
mod blind;
mod challenge;
mod course;
mod diagnose;
mod fleet;
mod identify;
mod outputs;
mod paper;
mod peers;
mod run;
mod shipped;
mod simulate;
mod wire;
mod wire_ends;
mod wire_peers;
mod wire_rows;
mod wire_soak;
mod wire_variants;
