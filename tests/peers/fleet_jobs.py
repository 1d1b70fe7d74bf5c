"""Writes a list of jobs with short recordings of simulated valves: two lots, one of which leaks.

    python fleet_jobs.py HIL FOLDER COUNT
"""
import subprocess
import sys
from pathlib import Path

import numpy as np
from valve import VALVE

STEP_S, SECONDS = 0.01, 15.0


def main():
    hil, folder, count = Path(sys.argv[1]).resolve(), Path(sys.argv[2]), int(sys.argv[3])
    (folder / "model.toml").write_text(VALVE.format(name="good"), encoding="utf-8")
    (folder / "leaks.toml").write_text(VALVE.format(name="leaks") + '\n[[effect]]\nleakage = { loss = "1.5 bar" }\n', encoding="utf-8")
    t = np.arange(0.0, SECONDS, STEP_S)
    lines = ["id,recording,model,lot,mileage"]
    for k in range(count):
        random = np.random.default_rng(k)
        current = 0.5 + 0.15 * np.sin(0.6 * t + k) + 0.08 * np.sin(2.3 * t)
        drive, simulated = folder / "drive.csv", folder / "simulated.csv"
        np.savetxt(drive, np.column_stack([t, current]), delimiter=",", header="time_s,current_a", comments="", fmt="%.6f")
        truth = folder / ("leaks.toml" if k % 2 else "model.toml")
        subprocess.run([str(a) for a in (hil, "simulate", drive, "--model", truth, "-o", simulated, "--force")], check=True, capture_output=True)
        pressure = np.genfromtxt(simulated, delimiter=",", names=True)["pressure_bar"] + 0.02 * random.standard_normal(len(t))
        record = folder / f"{k:03d}.csv"
        np.savetxt(record, np.column_stack([t, current, pressure]), delimiter=",", header="time_s,current_a,pressure_bar", comments="", fmt="%.6f")
        lines.append(f"V{k:03d},{record.name},model.toml,L{k % 2},{1000 * k}")
    (folder / "jobs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
