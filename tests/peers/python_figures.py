"""What the Python package costs: a long simulation, and a diagnosis beside that of the program on the same file.

    python python_figures.py HIL
"""
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import hil

SAMPLES = 2_400_000
# CPU of one simulation [s], and what a call from Python may cost more than the program.
MOST_S, MOST_OVERHEAD = 0.1, 0.05


def cpu(work):
    """User and system time, children included, of the quickest of some calls [s]."""
    best = float("inf")
    for _ in range(5):
        before = os.times()
        work()
        after = os.times()
        best = min(best, sum(after[:4]) - sum(before[:4]))
    return best


def main():
    program = sys.argv[1]
    model = hil.Model.load("paper")
    current = 0.5 + 0.3 * np.sin(np.arange(SAMPLES) * 0.01)
    simulated_s = cpu(lambda: hil.simulate(model, current))
    print(f"hil.simulate of {SAMPLES} samples: {simulated_s:.3f} s CPU (goal {MOST_S})")
    short = current[:12_000] + 0.1 * np.sign(np.sin(np.arange(12_000) * 0.02))
    pressure = hil.simulate(model, short) + 0.02 * np.random.default_rng(1).standard_normal(short.size)
    drive = {"time_s": 0.01 * np.arange(short.size), "current_a": short, "pressure_bar": pressure}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "drive.csv"
        np.savetxt(file, np.column_stack(list(drive.values())), delimiter=",", header=",".join(drive), comments="", fmt="%.17g")
        model.save(Path(folder) / "model.toml")
        ask = [program, "diagnose", file, "--model", Path(folder) / "model.toml", "--format", "json"]
        program_s = cpu(lambda: subprocess.run([str(a) for a in ask], check=True, capture_output=True))
        package_s = cpu(lambda: hil.diagnose(drive, model))
    overhead = package_s / program_s - 1.0
    print(f"diagnosis of 120 s: program {program_s:.2f} s CPU, package {package_s:.2f} s ({100 * overhead:+.1f} %, goal {100 * MOST_OVERHEAD:.0f})")
    sys.exit(simulated_s > MOST_S or overhead > MOST_OVERHEAD)


if __name__ == "__main__":
    main()
