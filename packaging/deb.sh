#!/usr/bin/env bash
# Makes a Debian package under target/debian/: the stripped program, the library for FMUs, man pages and completions; then unpacks it
# and tries it from an empty folder. Needs cargo-deb (`cargo install --locked cargo-deb`).
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --locked --release
# The library that goes into an exported FMU.
cargo build --locked --release -p hil-fmu
share=target/share
rm -rf "$share" target/debian
XDG_DATA_HOME="$PWD/$share" target/release/hil man
cargo deb --no-build --no-strip
package=$(realpath target/debian/*.deb)

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
dpkg -x "$package" "$root"
size=$(stat -c %s "$root/usr/bin/hil")
echo "$(basename "$package"): $(stat -c %s "$package") bytes, the program $size"
[ "$size" -lt 20000000 ] || { echo "the program is to be below 20 MB" >&2; exit 1; }
mkdir "$root/empty"
cd "$root/empty"
"$root/usr/bin/hil" run tipin --sim > run.txt
"$root/usr/bin/hil" init . --example diagnosis > /dev/null
"$root/usr/bin/hil" export paper -o valve.fmu
for file in man/man1/hil.1.gz man/man1/hil-run.1.gz bash-completion/completions/hil zsh/vendor-completions/_hil fish/vendor_completions.d/hil.fish \
    doc/hil/README.md; do
    [ -s "$root/usr/share/$file" ] || { echo "the package lacks usr/share/$file" >&2; exit 1; }
done
echo "unpacked and tried: run, init, export, man pages, completions"
