"""Figures of `hil identify` on recordings that lie beside the project, as a report: it judges nothing.

    python3 tests/figures.py target/release/hil RECORDINGS
"""
import json
import os
import subprocess
import sys
import tempfile

hil, folder = os.path.abspath(sys.argv[1]), sys.argv[2]


def call(*args):
    done = subprocess.run([hil, *args], capture_output=True, text=True)
    if done.returncode:
        print("  ", done.stderr.strip().splitlines()[-1])
        return None
    return json.loads(done.stdout)


labelled = os.path.join(folder, "labelled")
if os.path.isdir(labelled):
    truth = json.load(open(os.path.join(labelled, "truth.json")))
    print("sweep: delay and lag beyond the message's delay, RMSE")
    for name in sorted(truth):
        found = call("identify", os.path.join(labelled, name, "sweep.csv"), "--format", "json")
        if found:
            late = found["delay_s"] + (found.get("lag_s") or 0.0) - truth[name]["delay"]
            note = " (the sweep had the effect)" if truth[name]["absorbed"] else ""
            print(f"  {name:<42} {1e3 * late:+6.1f} ms  {found['rmse_bar']:.3f} bar{note}")
real = os.path.join(folder, "real")
if os.path.isdir(real):
    print("step tests: RMSE of the identified model on the runs held back")
    for name in sorted(n for n in os.listdir(real) if n.startswith("eppr-")):
        with tempfile.TemporaryDirectory() as scratch:
            model = os.path.join(scratch, "model.toml")
            found = call("identify", os.path.join(real, name, "record.csv"), "-o", model, "--format", "json")
            out = os.path.join(scratch, "out.csv")
            error = found and call("simulate", os.path.join(real, name, "holdout.csv"), "--model", model, "-o", out, "--format", "json")
            if error:
                print(f"  {name:<42} {error.get('rmse_bar') or error['total']['rmse_bar']:.3f} bar")
