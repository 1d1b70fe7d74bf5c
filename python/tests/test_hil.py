"""The package against the program, on the same files, and its manners."""

from __future__ import annotations

import _thread
import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import hil

# Where the program lies; without it the comparisons with it are skipped and said so.
PROGRAM = os.environ.get("HIL")
program = pytest.mark.skipif(not PROGRAM, reason="HIL names no program to compare with")


def written(folder: Path, name: str, columns: dict[str, np.ndarray]) -> Path:
    path = folder / name
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(zip(*[[repr(float(v)) for v in values] for values in columns.values()]))
    return path


def called(*arguments: object) -> str:
    assert PROGRAM
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@program
def test_diagnosis_is_that_of_the_program(tmp_path, model, drive):
    record = written(tmp_path, "record.csv", drive)
    model.save(tmp_path / "model.toml")
    theirs = json.loads(called("diagnose", record, "--model", tmp_path / "model.toml", "-o", tmp_path / "augmented.toml", "--format", "json"))
    ours = hil.diagnose(drive, model, source=theirs["recording"])
    assert ours.json == theirs
    # The program names the augmented model after what it found, to tell before from after in a folder.
    written_model = (tmp_path / "augmented.toml").read_text(encoding="utf-8").splitlines()
    named = [line for line in written_model if line.startswith("name = ")]
    assert [line for line in ours.model.to_toml().splitlines() if not line.startswith("name = ")] == [line for line in written_model if line not in named]


@program
def test_identification_is_that_of_the_program(tmp_path, sweep):
    file = written(tmp_path, "sweep.csv", sweep)
    theirs = json.loads(called("identify", file, "--format", "json"))
    ours = hil.identify(sweep, source="sweep.csv").json
    for key in ("curve", "a_bar2", "delay_s", "rmse_bar", "warnings"):
        assert ours[key] == theirs[key], key


@program
def test_simulation_is_that_of_the_program(tmp_path, model, drive):
    record = written(tmp_path, "record.csv", drive)
    model.save(tmp_path / "model.toml")
    called("simulate", record, "--model", tmp_path / "model.toml", "-o", tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        theirs = np.array([float(row["pressure_bar"]) for row in csv.DictReader(line for line in file if not line.startswith("#"))])
    ours = hil.simulate(model, drive["current_a"], time=drive["time_s"])
    # The file has six digits behind the point.
    assert np.max(np.abs(ours - theirs)) < 1e-6


def test_the_limit_is_found_and_the_models_differ(model, drive):
    found = hil.diagnose(drive, model)
    assert found.verdict in ("explained", "partly_explained")
    table = found.effects
    assert "flow_limit" in set(table["id"])
    assert found.model != model
    assert "flow_limit" in found.model.effects
    assert found.rmse_bar["augmented_heldout"] < 0.5 * found.rmse_bar["base_heldout"]
    assert list(found.candidates.columns) == ["id", "bic", "heldout_rmse_bar", "rejected_because"]
    assert "<iframe" in found._repr_html_()


def test_frames_of_all_kinds_are_the_same(model, sweep):
    pandas = pytest.importorskip("pandas")
    polars = pytest.importorskip("polars")
    arrow = pytest.importorskip("pyarrow")
    plain = hil.identify(sweep).json
    for frame in (pandas.DataFrame(sweep), polars.DataFrame(sweep), arrow.table(sweep)):
        assert hil.identify(frame).json == plain


def test_foreign_columns_runs_and_gaps(sweep):
    foreign = {
        "run": ["one"] * 4000 + ["two"] * (len(sweep["time_s"]) - 4000),
        "t": sweep["time_s"],
        "I": 1e3 * sweep["current_a"],
        "p": sweep["pressure_bar"].copy(),
        "remark": [None] * len(sweep["time_s"]),
    }
    foreign["p"][17] = np.nan
    found = hil.identify(foreign, map={"time_s": "t", "current_a": "I [mA]", "pressure_bar": "p"})
    # A slow sweep shows delay and lag together.
    assert found.model.delay_s + found.model.lag_s == pytest.approx(0.03, abs=0.003)


def test_a_simulation_reads_the_array_in_place_and_leaves_it(model):
    current = np.linspace(0.1, 0.9, 1000)
    before = current.copy()
    pressure = hil.simulate(model, current, step_s=0.01)
    assert pressure.shape == current.shape and pressure.dtype == np.float64
    assert np.array_equal(current, before)
    assert np.all(np.diff(pressure[300:]) > 0)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ({"time_s": [0.0, 0.1]}, "current_a"),
        ({"time_s": np.arange(400) * 0.01, "current_a": np.full(400, 0.5), "pressure_bar": np.full(400, 5.0)}, "constant"),
        ({"time_s": [0.0, 0.1], "current_a": [0.5]}, "has 1 values"),
    ],
)
def test_what_cannot_be_used_is_said(model, frame, said):
    with pytest.raises(hil.RecordingError, match=said):
        hil.diagnose(frame, model)


def test_wrong_models_and_currents_are_refused(model):
    with pytest.raises(hil.ModelError, match="schema"):
        hil.Model.from_toml("name = 'x'")
    with pytest.raises(hil.ModelError):
        hil.Model.load("/nowhere/valve.toml")
    with pytest.raises(hil.ModelError, match="finite"):
        hil.simulate(model, [0.5, np.nan])
    with pytest.raises(hil.ModelError, match="positive"):
        hil.simulate(model, [0.5, 0.6], step_s=0.0)
    with pytest.raises(TypeError, match="columns"):
        hil.identify(3)


def test_a_model_is_written_whole_and_read_back(tmp_path, model):
    path = tmp_path / "valve.toml"
    model.save(path)
    assert hil.Model.load(path) == model
    assert [p.name for p in tmp_path.iterdir()] == ["valve.toml"]


def test_the_lock_is_released(model):
    current = np.tile(np.linspace(0.1, 0.9, 1000), 3000)
    ticks = 0
    done = threading.Event()

    def work() -> None:
        hil.simulate(model, current)
        done.set()

    worker = threading.Thread(target=work)
    worker.start()
    while not done.wait(0.001):
        ticks += 1
    worker.join()
    assert ticks > 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_diagnosis(model, drive):
    tiled = {"time_s": 0.01 * np.arange(20 * 6000), "current_a": np.tile(drive["current_a"], 20), "pressure_bar": np.tile(drive["pressure_bar"], 20)}
    # Begun in the background of a shell, a process ignores Ctrl-C, and Python leaves it at that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.5, _thread.interrupt_main)
    timer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        hil.diagnose(tiled, model)
    assert time.monotonic() - began < 5.0
