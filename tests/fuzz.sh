#!/usr/bin/env bash
# AFL++ on every reader of files and parser of frames: tests/fuzz.sh [SECONDS [TARGET...]]   (60 for each target by default)
#
# The targets are those of tests/it/fuzz, built with AFL's instrumentation on stable Rust (cargo-afl, installed under target/fuzz), so
# that inputs are kept that reach a branch no other one did. An input may take ten seconds and one gigabyte. Prints a row for each
# target; ends with 1 where one panicked, hung or took more.
set -euo pipefail
cd "$(dirname "$0")/.."
top=$PWD; work=$top/target/fuzz; seconds=${1:-60}; shift || true
[ -x "$work/bin/cargo-afl" ] || cargo install cargo-afl --locked --root "$work"
# AFL++ itself is in the package, and is built where this says.
export PATH=$work/bin:$PATH XDG_DATA_HOME=$work/share CARGO_TARGET_DIR=$work/target HIL_ROOT=$top
[ -d "$work/share" ] || cargo afl config --build
cargo afl build --release --manifest-path tests/fuzz/Cargo.toml
program=$work/target/release/hil-fuzz
export RUST_BACKTRACE=0 AFL_SKIP_CPUFREQ=1 AFL_NO_UI=1 AFL_NO_AFFINITY=1 AFL_I_DONT_CARE_ABOUT_MISSING_CRASHES=1 AFL_SKIP_CRASHES=1 AFL_HANG_TMOUT=10000 TMPDIR=${TMPDIR:-/dev/shm}
targets=("$@"); [ ${#targets[@]} -gt 0 ] || mapfile -t targets < <("$program" list)
bad=0
echo "target | inputs | edges found | kept | panics or too much memory | hangs"
for target in "${targets[@]}"; do
    seeds=$work/seeds/$target; out=$work/found/$target
    rm -rf "$seeds" "$out"; mkdir -p "$out"
    "$program" seeds "$target" "$seeds"
    cargo afl fuzz -i "$seeds" -o "$out" -V "$seconds" -t 10000 -m 1024 -- "$program" run "$target" > "$out/log" 2>&1 ||
        { tail -20 "$out/log" >&2; exit 1; }
    of() { sed -n "s/^$1 *: *//p" "$out/default/fuzzer_stats"; }
    echo "$target | $(of execs_done) | $(of edges_found) | $(of corpus_count) | $(of saved_crashes) | $(of saved_hangs)"
    [ "$(of saved_crashes)" = 0 ] && [ "$(of saved_hangs)" = 0 ] || { bad=1; find "$out/default" -path '*es/id*' -o -path '*hangs/id*'; }
done
rm -rf "$TMPDIR"/hil-fuzz-*
exit $bad
