#!/usr/bin/env bash
# What the tests need beside Rust: mbpoll, libmodbus and strace (Debian packages), pymodbus (pinned) in an environment of
# its own below target/. Run once before `cargo test`; the tests say so when a peer is missing.
set -euo pipefail
cd "$(dirname "$0")/../.."
if ! command -v mbpoll > /dev/null || ! command -v strace > /dev/null || ! [ -e /usr/include/modbus/modbus.h ]; then
    run=(); [ "$(id -u)" -eq 0 ] || run=(sudo)
    "${run[@]}" apt-get update -qq
    "${run[@]}" apt-get install -y -qq --no-install-recommends mbpoll libmodbus-dev strace gcc libc6-dev
fi
venv=target/modbus-peers
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/python" -c 'import pymodbus, sys; sys.exit(pymodbus.__version__ != "3.11.4")' 2> /dev/null ||
    "$venv/bin/pip" install --quiet --disable-pip-version-check 'pymodbus==3.11.4' 'pyserial==3.5'
