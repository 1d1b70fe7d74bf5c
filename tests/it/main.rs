//! Integration tests: the library and the program from outside.

mod blind;
mod peers;
mod simulate;
mod wire;
