"""Our own plant as an FMU with an effect left out is a foreign model: what is missing in it is found as with our own base.

    python foreign.py HIL LIBRARY FOLDER
"""
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from fmpy import simulate_fmu
from fmu import STEP_S, called, drive
from valve import VALVE

# Effects of both sides of a model, as they are concealed.
CONCEALED = {
    "first_order_lag": 'tau = "60 ms"',
    "flow_limit": 'rise = "40 bar/s", fall = "40 bar/s"',
    "supply_saturation": 'limit = "16 bar"',
    "reversal_dead_band": 'width = "25 mA"',
}
NOISE_BAR = 0.02


def diagnosed(hil, *arguments):
    done = subprocess.run([str(a) for a in (hil, "diagnose", *arguments, "--format", "json")], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{arguments}: {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def named(found):
    """What explains the most, be it a cause or a form, with its parameters."""
    return next(((e["id"], {k: v["value"] for k, v in e["parameters"].items()}) for e in found["effects"] + found["form"]), (None, {}))


def main():
    hil, library, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve(), Path(sys.argv[3]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    t, current = drive()
    (folder / "plain.toml").write_text(VALVE.format(name="plain"), encoding="utf-8")
    np.savetxt(folder / "drive.csv", np.column_stack([t, current]), delimiter=",", header="time_s,current_a", comments="", fmt=["%.2f", "%.6f"])
    wrong = []
    for number, (effect, parameters) in enumerate(CONCEALED.items()):
        version = "23"[number % 2]
        base = folder / f"base-{version}.fmu"
        called(hil, "export", folder / "plain.toml", "-o", base, "--fmi", version, "--library", library, "--force")
        truth = folder / f"{effect}.toml"
        truth.write_text(VALVE.format(name=effect) + f"\n[[effect]]\n{effect} = {{ {parameters} }}\n", encoding="utf-8")
        called(hil, "simulate", folder / "drive.csv", "--model", truth, "-o", folder / "truth.csv", "--input", "held", "--force")
        record = np.genfromtxt(folder / "truth.csv", delimiter=",", names=True)
        measured = record["pressure_bar"] + NOISE_BAR * np.random.default_rng(number).standard_normal(len(t))
        np.savetxt(
            folder / "record.csv", np.column_stack([t, current, measured]), delimiter=",", header="time_s,current_a,pressure_bar", comments="", fmt="%.6f"
        )
        own = diagnosed(hil, folder / "record.csv", "--model", folder / "plain.toml")
        begun = time.perf_counter()
        answer = folder / f"found-{effect}.toml"
        found = diagnosed(hil, folder / "record.csv", "--model", base, "--trust-fmu", "-o", answer, "--force")
        seconds = time.perf_counter() - begun
        own_name, name = named(own), named(found)
        held = found["rmse_bar"]["augmented_heldout"]
        again = diagnosed(hil, folder / "record.csv", "--model", answer)["verdict"]
        print(f"{effect:20s} FMI {version}.0  foreign base: {name}, held out {held:.3f} bar, then {again}; own base: {own_name}; {seconds:.1f} s")
        # As with our own base; what acts inside the base (ahead of its own lag) can only be put behind all of it, and leaves a rest.
        inside = effect == "supply_saturation"
        if name[0] != own_name[0] or held > (0.3 if inside else 1.2) * (found["rmse_bar"]["base_heldout"] if inside else NOISE_BAR):
            wrong.append(effect)
        if not inside and again != "match":
            wrong.append(f"{effect}: {again}")
        wrong += beside(hil, library, folder, answer, base, t, current)
    print(f"{len(CONCEALED)} concealed, wrong: {wrong or 'none'}")
    sys.exit(bool(wrong))


def beside(hil, library, folder, answer, base, t, current):
    """The effects alone as an FMU, driven by FMPy behind or ahead of the base; both are one step late together with it."""
    alone = folder / f"{answer.stem}.fmu"
    called(hil, "export", answer, "-o", alone, "--library", library, "--force")
    ahead = "reversal" in answer.stem

    def run(fmu, output, **signals):
        columns = np.array(list(zip(t, *signals.values())), dtype=[("time", float), *((name, float) for name in signals)])
        start = {name: values[0] for name, values in signals.items()}
        done = simulate_fmu(str(fmu), start_time=0.0, stop_time=float(t[-1]), output_interval=STEP_S, input=columns, output=[output], start_values=start)
        return done[output]

    if ahead:
        sent = run(alone, "current_out", current=current)
        pressure = run(base, "pressure", current=np.append(sent[1:], sent[-1]))
    else:
        own = run(base, "pressure", current=current)
        pressure = np.append(run(alone, "pressure", current=current, pressure_in=own)[1:], np.nan)
    truth = np.genfromtxt(folder / "truth.csv", delimiter=",", names=True)["pressure_bar"]
    off = float(np.sqrt(np.nanmean((pressure - truth) ** 2)))
    print(f"{'':20s} the effects as an FMU beside the base: {off:.3f} bar RMS from the truth")
    return [] if off < 0.06 or "supply" in answer.stem else [f"{answer.stem}: effects alone"]


if __name__ == "__main__":
    main()
