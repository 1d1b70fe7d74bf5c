"""Exports models as FMUs, lets FMPy validate and run them, and compares with what `hil simulate` writes.

    python fmu.py HIL LIBRARY FOLDER [MODEL.toml ..]
"""
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

STEP_S = 0.01
# What the FMU may differ from what `hil simulate` writes as Parquet [bar].
ALLOWED = 1e-9
OIL_C = 80.0


def drive(seconds=120.0):
    """Steps and ramps between 0.1 A and 0.9 A, the same every time."""
    random = np.random.default_rng(20)
    t = np.arange(0.0, seconds, STEP_S)
    levels = random.uniform(0.15, 0.9, int(seconds) + 1)
    current = levels[(t / 1.0).astype(int)]
    ramp = (t % 20.0) < 8.0
    current[ramp] = 0.2 + 0.6 * np.abs(((t[ramp] / 4.0) % 2.0) - 1.0)
    return t, np.round(current, 6)


def called(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}")


def main():
    hil, library, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve(), Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    t, current = drive()
    record = folder / "drive.csv"
    # Oil that stays as warm as it is, for the effects that use it.
    columns = np.column_stack([t, current, np.full(len(t), OIL_C)])
    np.savetxt(record, columns, delimiter=",", header="time_s,current_a,oil_temp_c", comments="", fmt=["%.2f", "%.6f", "%.1f"])
    worst, wrong = 0.0, []
    for model in map(Path, sys.argv[4:]):
        simulated = folder / "simulated.parquet"
        called(hil, "simulate", record, "--model", model, "-o", simulated, "--force")
        want = parquet.read_table(simulated)["pressure_bar"].to_numpy()
        for version in "23":
            fmu = folder / f"{model.stem}-{version}.fmu"
            called(hil, "export", model, "-o", fmu, "--fmi", version, "--library", library, "--force")
            problems = validate_fmu(str(fmu))
            if problems:
                wrong.append(f"{fmu.name}: {problems}")
            # The first sample is the begin; the input of each step is that at its begin.
            signal = np.array(list(zip(t, current)), dtype=[("time", float), ("current", float)])
            inputs = {v.name for v in read_model_description(str(fmu)).modelVariables if v.causality == "input"}
            start = {"current": current[0]} | ({"oil_temperature": OIL_C} if "oil_temperature" in inputs else {})
            begun = time.perf_counter()
            result = simulate_fmu(
                str(fmu), start_time=0.0, stop_time=float(t[-1]), output_interval=STEP_S, input=signal, output=["pressure"], start_values=start
            )
            seconds = time.perf_counter() - begun
            have = result["pressure"]
            difference = float(np.max(np.abs(have[: len(want)] - want[: len(have)])))
            worst = max(worst, difference)
            print(f"{model.stem:32s} FMI {version}.0  {fmu.stat().st_size / 1e6:5.2f} MB  {seconds:5.2f} s  differs by {difference:.1e} bar")
            if not difference <= ALLOWED or len(have) < len(want) - 1:
                wrong.append(f"{fmu.name}: {difference} bar, {len(have)} samples of {len(want)}")
    print(f"worst {worst:.1e} bar, {len(wrong)} wrong")
    print("\n".join(wrong))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
