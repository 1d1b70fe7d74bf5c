#!/usr/bin/env bash
# Uses every kind of page and the station in Chromium, and holds the pictures of README.md against what the program says now; with --pictures it
# takes them again. Usage: tests/browser/run.sh [HIL] [--pictures]
set -euo pipefail
cd "$(dirname "$0")/../.."
hil=target/release/hil; pictures=no
for argument in "$@"; do
    case "$argument" in --pictures) pictures=yes ;; *) hil=$argument ;; esac
done
tests/browser/install.sh
node="node target/browser"
if [ "$pictures" = yes ]; then
    $node/pictures.mjs "$hil" target/browser/pictures docs
else
    $node/pages.mjs "$hil" target/browser/pages
    $node/station.mjs "$hil" target/browser/station
    $node/pictures.mjs "$hil" target/browser/pictures docs --check
fi
