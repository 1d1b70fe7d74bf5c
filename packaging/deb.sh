#!/usr/bin/env bash
# Makes a Debian package under target/debian/: the stripped program, its man pages and completions. Needs cargo-deb
# (`cargo install --locked cargo-deb`).
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --release
# The library that goes into an exported FMU.
cargo build --locked --release -p hil-fmu
share=target/share
rm -rf "$share"
XDG_DATA_HOME="$PWD/$share" target/release/hil man
cargo deb --no-build --no-strip
