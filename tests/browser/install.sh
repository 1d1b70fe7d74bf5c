#!/usr/bin/env bash
# What the test of the pages needs: Chromium and Node (Debian packages), Playwright's client (npm, pinned; no browser of its own).
set -euo pipefail
cd "$(dirname "$0")"
need=()
command -v chromium > /dev/null || need+=(chromium)
command -v npm > /dev/null || need+=(nodejs npm)
if [ "${#need[@]}" -gt 0 ]; then
    run=(); [ "$(id -u)" -eq 0 ] || run=(sudo)
    "${run[@]}" apt-get update -qq
    "${run[@]}" apt-get install -y -qq --no-install-recommends "${need[@]}"
fi
target=../../target/browser
mkdir -p "$target"
cp package.json pages.mjs pictures.mjs station.mjs load.mjs "$target"
cd "$target"
# What is installed is what package.json pins.
node -e 'for (const [name, version] of Object.entries(require("./package.json").dependencies)) if (require(`${name}/package.json`).version !== version) process.exit(1)' 2> /dev/null ||
    npm install --silent --no-fund --no-audit --ignore-scripts
