//! Integration tests: the library and the program from outside.

mod allowed;
mod answers;
#[cfg(unix)]
mod batch;
mod blind;
mod challenge;
mod course;
mod diagnose;
mod export;
mod fake;
mod first_version;
mod fleet;
#[cfg(all(unix, feature = "fmi"))]
mod foreign;
mod fuzz;
mod home;
mod identify;
mod last_word;
mod logs;
mod margins_law;
mod old_records;
mod outputs;
mod packaging;
mod paper;
mod peers;
mod power;
mod promises;
#[cfg(unix)]
mod prompts;
mod readme;
mod run;
mod shipped;
mod signals;
mod simulate;
mod soak;
mod station;
mod station_words;
mod ways_out;
mod wire;
mod wire_ends;
mod wire_peers;
mod wire_rows;
mod wire_soak;
mod wire_variants;
