#!/usr/bin/env bash
# Mutation tests of the rooms whose figures are printed: tests/mutants.sh [FILE...]   (files below src/; all of them in hours)
# MUTANTS: further arguments of cargo-mutants, such as "--shard 0/10 --sharding round-robin" for a tenth of them.
#
# cargo-mutants (installed under target/mutants) changes one expression at a time and runs the tests. Each room is put with what it
# stands on into a small package of its own there, which builds in seconds where the whole takes minutes. docs/mutants.md says
# which mutants live and why. Ends with 2 where one lives that is not named there.
set -euo pipefail
cd "$(dirname "$0")/.."
top=$PWD; work=$top/target/mutants
tool=$work/bin/cargo-mutants
[ -x "$tool" ] || cargo install cargo-mutants --locked --root "$work"
files=("$@")
[ ${#files[@]} -gt 0 ] || files=(control/stability/*.rs batch/statistics/*.rs batch/msa.rs batch/measuring.rs metrics/*.rs limits.rs valve/hyperbola.rs valve/free.rs valve/path.rs valve/curves.rs valve/polynomial.rs)

# The package of a room: its modules, and the modules that it uses.
package() {
    local package=$work/$1; shift
    rm -rf "$package"; mkdir -p "$package/src"
    cp Cargo.lock build.rs "$package/"
    cp -r plans valves drivers examples "$package/"
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
    sed -n '/^\[dependencies\]/,/^# people/p; /^\[dev-dependencies\]/,/^$/p' Cargo.toml | grep -v '^criterion\|^assert_cmd\|^predicates\|^spdx' >> "$package/Cargo.toml"
    printf '//! A room under mutation.\n#![allow(missing_docs, dead_code)]\n' > "$package/src/lib.rs"
    for module in "$@"; do
        printf 'pub mod %s;\n' "$module" >> "$package/src/lib.rs"
        case $module in
        control) # the stability of the loop, and the gains that it speaks of
            mkdir "$package/src/control"; cp -r src/control/stability "$package/src/control/"
            { echo 'pub mod stability;'; sed -n '/^\/\/\/ Gains of the PI/,$p' src/control/mod.rs | sed '/^#\[cfg(test)\]/,$d'; } > "$package/src/control/mod.rs" ;;
        batch) # its statistics, and the studies of the measuring system
            mkdir "$package/src/batch"; cp -r src/batch/statistics src/batch/msa.rs src/batch/measuring.rs "$package/src/batch/"
            printf 'pub mod %s;\n' measuring msa statistics > "$package/src/batch/mod.rs" ;;
        *)
            if [ -d "src/$module" ]; then cp -r "src/$module" "$package/src/"; else cp "src/$module.rs" "$package/src/"; fi ;;
        esac
    done
}

lives=0
for room in control batch metrics limits valve; do
    only=(); for file in "${files[@]}"; do case $file in "$room/"*|"$room.rs") only+=(-f "src/$file") ;; esac; done
    [ ${#only[@]} -gt 0 ] || continue
    case $room in
    control|batch|limits) package "$room" "$room" ;;
    metrics) package metrics units metrics ;;
    valve) package valve units shipped document output digest valve ;;
    esac
    # What takes many seconds draws hundreds of lots; what it would find must be seen by a known answer as well.
    skipped=(); [ "$room" = batch ] && skipped=(--skip coverage --skip the_rules_together --skip intervals_cover)
    status=0
    # shellcheck disable=SC2086
    (cd "$work/$room" && CARGO_TARGET_DIR=$work/target PROPTEST_DISABLE_FAILURE_PERSISTENCE=1 "$tool" mutants "${only[@]}" --in-place --no-shuffle --minimum-test-timeout 20 --timeout-multiplier 5 -o "$work/$room" ${MUTANTS:-} -- \
        --lib -- "${skipped[@]}") || status=$?
    case $status in 0|2|3) ;; *) exit "$status" ;; esac # 2: some live, 3: some never end; the rest is no run
    while read -r line; do
        if sed 's/\\|/|/g' docs/mutants.md | grep -F "\`$line\`" > /dev/null; then echo "known: $line"; else echo "LIVES: $line"; lives=1; fi
    done < <(sed 's/:[0-9]*:[0-9]*:/:/' "$work/$room/mutants.out/missed.txt" | sort -u)
done
[ "$lives" = 0 ] || exit 2
