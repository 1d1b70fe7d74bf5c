#!/usr/bin/env bash
# Mutation tests of the rooms whose figures are printed: tests/mutants.sh [FILE...]   (files below src/; all of them in many hours)
# MUTANTS: further arguments of cargo-mutants, such as "--shard 0/10 --sharding round-robin" for a tenth of them.
#
# The rooms metrics, statistics, stability and valve, with what they stand on, are put into a small package under target/mutants, which
# builds in seconds where the whole takes minutes; cargo-mutants (installed there too) changes one expression at a time and runs their
# tests. docs/mutants.md says which mutants live and why. Ends with 2 where one lives that is not named there.
set -euo pipefail
cd "$(dirname "$0")/.."
top=$PWD; work=$top/target/mutants; package=$work/package
tool=$work/bin/cargo-mutants
[ -x "$tool" ] || cargo install cargo-mutants --locked --root "$work"

rm -rf "$package"; mkdir -p "$package/src/batch" "$package/src/control"
cp Cargo.lock "$package/"
cp build.rs "$package/"
cp -r plans valves drivers examples "$package/"
cp -r src/units.rs src/shipped.rs src/document.rs src/output src/valve src/metrics src/limits.rs "$package/src/"
cp -r src/batch/statistics "$package/src/batch/"
cp -r src/control/stability "$package/src/control/"
sed -n '/^\[dependencies\]/,/^# people/p; /^\[dev-dependencies\]/,/^$/p' Cargo.toml | grep -v '^criterion\|^assert_cmd\|^predicates\|^spdx' > "$work/dependencies"
cat > "$package/Cargo.toml" <<'T'
[package]
name = "hil"
version = "0.1.0"
edition = "2024"
autoexamples = false
[workspace]
[features]
default = []
parquet = ["dep:parquet"]
history = ["dep:rusqlite"]
fmi = ["dep:libloading", "dep:quick-xml", "dep:zip"]
[profile.dev]
opt-level = 1
debug = false
T
cat "$work/dependencies" >> "$package/Cargo.toml"
cat > "$package/src/lib.rs" <<'T'
//! The rooms under mutation.
#![allow(missing_docs)]
pub mod units;
pub mod shipped;
pub mod document;
pub mod output;
pub mod valve;
pub mod control;
pub mod metrics;
pub mod limits;
pub mod batch;
T
echo 'pub mod statistics;' > "$package/src/batch/mod.rs"
{ echo 'pub mod stability;'; sed -n '/^\/\/\/ Gains of the PI/,$p' src/control/mod.rs | sed '/^#\[cfg(test)\]/,$d'; } > "$package/src/control/mod.rs"

files=("$@")
[ ${#files[@]} -gt 0 ] || files=(metrics/*.rs batch/statistics/*.rs control/stability/*.rs valve/hyperbola.rs valve/curves.rs valve/polynomial.rs limits.rs)
only=(); for file in "${files[@]}"; do only+=(-f "src/$file"); done
status=0
(cd "$package" && CARGO_TARGET_DIR=$work/target "$tool" mutants "${only[@]}" --in-place --no-shuffle --timeout 300 -o "$work" ${MUTANTS:-} -- --lib) || status=$?
[ "$status" -le 3 ] || exit "$status"
echo
sort "$work/mutants.out/missed.txt" | sed 's/:[0-9]*:[0-9]*:/:/' | while read -r line; do
    grep -qF "$line" docs/mutants.md && echo "known: $line" || { echo "LIVES: $line"; touch "$work/lives"; }
done
[ ! -e "$work/lives" ] || { rm "$work/lives"; exit 2; }
