//! Integration tests: the library and the program from outside.

mod peers;
mod wire;
