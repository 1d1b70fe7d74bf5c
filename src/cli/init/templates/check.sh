#!/bin/sh
# What a change must pass: every file is right, the plan runs on the simulated valve, and diff.md says what moved
# against the accepted report. The exit code is the verdict of the run.
set -u
hil check || exit
run=reports/runs/ci
rm -rf "$run"
hil run acceptance --sim --out "$run" --format text
verdict=$?
cp "$run/junit.xml" junit.xml
if [ -f reports/acceptance/record.json ]; then
    hil diff reports/acceptance "$run" --format markdown > diff.md
else
    echo "There is no accepted report yet: \`hil accept $run\` makes this run the accepted one." > diff.md
fi
exit "$verdict"
