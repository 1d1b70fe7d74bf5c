//! Integration tests: the library and the program from outside.

mod answers;
#[cfg(unix)]
mod batch;
mod blind;
mod challenge;
mod course;
mod diagnose;
mod export;
mod first_version;
mod fleet;
#[cfg(all(unix, feature = "fmi"))]
mod foreign;
mod fuzz;
mod home;
mod identify;
mod logs;
mod margins_law;
mod old_records;
mod outputs;
mod packaging;
mod paper;
mod peers;
#[cfg(unix)]
mod prompts;
mod readme;
mod run;
mod shipped;
mod simulate;
mod station_words;
