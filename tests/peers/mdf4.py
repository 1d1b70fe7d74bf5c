"""MDF 4 files as asammdf writes and reads them, to compare with our own reader and writer.

write DIR         writes recordings in many layouts to DIR, each NAME.mf4 with its values in NAME.csv
check FILE CSV    reads FILE and compares every channel with the columns of CSV, run by run
"""

import csv
import sys
from pathlib import Path

import numpy as np
from asammdf import MDF, Signal

ROWS = 3000


def channels(rows=ROWS):
    time = np.arange(rows) * 0.01
    current = 0.5 + 0.4 * np.sin(time)
    pressure = 25 * current + np.cos(3 * time)
    return time, current, pressure


def column(value):
    return "" if np.isnan(value) else repr(float(value))


def expect(path, time, *columns):
    names = ["time_s", "current_a", "pressure_bar"]
    with open(path, "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(names)
        for row in zip(time, *columns):
            out.writerow([column(v) for v in row])


def save(folder, name, signals, time, current, pressure, version="4.10", compression=0, comment=""):
    mdf = MDF(version=version)
    for group in signals:
        mdf.append(group, comment=comment)
    mdf.save(folder / f"{name}.mf4", compression=compression, overwrite=True)
    mdf.close()
    expect(folder / f"{name}.csv", time, current, pressure)


def write(folder):
    folder = Path(folder)
    time, current, pressure = channels()

    def plain(t=time, c=current, p=pressure):
        return [[Signal(c, t, name="current_a", unit="A"), Signal(p, t, name="pressure_bar", unit="bar")]]

    for version in ["4.00", "4.10", "4.11"]:
        for compression in [0, 1, 2]:
            name = f"plain-{version.replace('.', '')}-{compression}"
            save(folder, name, plain(), time, current, pressure, version, compression)

    long = channels(250_000)
    save(folder, "long", plain(*long), *long, compression=2)

    milli = [[Signal(current * 1000, time, name="current_a", unit="mA"), Signal(pressure / 10, time, name="pressure_bar", unit="MPa")]]
    save(folder, "units", milli, time, current, pressure)

    raw_current = np.round(current * 10_000).astype("<u2")
    raw_pressure = np.round(pressure * 100).astype(">i4")
    scaled = [
        [
            Signal(raw_current, time, name="current_a", unit="A", conversion={"a": 1e-4, "b": 0.0}),
            Signal(raw_pressure, time, name="pressure_bar", unit="bar", conversion={"a": 0.01, "b": -1.0}),
        ]
    ]
    save(folder, "integers", scaled, time, raw_current * 1e-4, raw_pressure * 0.01 - 1.0, compression=1)

    single = current.astype("<f4"), pressure.astype("<f4")
    save(folder, "singles", plain(time, *single), time, *single)

    table = {f"raw_{k}": float(k * 100) for k in range(3)} | {f"phys_{k}": float(k * k) for k in range(3)}
    tabled = [
        [
            Signal(current, time, name="current_a", unit="A"),
            Signal(pressure * 5, time, name="pressure_bar", unit="bar", conversion=table | {"interpolation": True}),
        ]
    ]
    save(folder, "table", tabled, time, current, np.interp(pressure * 5, [0, 100, 200], [0, 1, 4]))

    invalid = np.zeros(ROWS, dtype=bool)
    invalid[100:200] = True
    gaps = [
        [
            Signal(current, time, name="current_a", unit="A"),
            Signal(pressure, time, name="pressure_bar", unit="bar", invalidation_bits=invalid),
        ]
    ]
    save(folder, "invalid", gaps, time, current, np.where(invalid, np.nan, pressure))

    fine = np.arange(10 * ROWS) * 0.001
    rasters = [
        [Signal(current, time, name="current_a", unit="A")],
        [Signal(2 * fine, fine, name="pressure_bar", unit="bar"), Signal(fine.astype("<u1"), fine, name="other")],
    ]
    spread = np.full(10 * ROWS, np.nan)
    spread[::10] = current
    save(folder, "rasters", rasters, fine, spread, 2 * fine)


def check(path, expected):
    with open(expected, newline="") as file:
        rows = list(csv.DictReader(file))
    runs = {}
    for row in rows:
        runs.setdefault(row.get("run"), []).append(row)
    names = [name for name in rows[0] if name not in ("run", "time_s")]
    with MDF(path) as mdf:
        assert mdf.version == "4.10", mdf.version
        assert len(mdf.groups) == len(runs), (len(mdf.groups), len(runs))
        for group, (run, of_run) in enumerate(runs.items()):
            acquired = mdf.groups[group].channel_group.acq_name
            assert (acquired or None) == run, (acquired, run)
            for name in names:
                wanted = np.array([float(row[name] or "nan") for row in of_run])
                if np.isnan(wanted).all():
                    continue
                signal = mdf.get(name, group=group)
                np.testing.assert_array_equal(signal.samples, wanted, err_msg=name)
                np.testing.assert_array_equal(signal.timestamps, [float(row["time_s"]) for row in of_run])
                assert signal.unit == {"current_a": "A", "oil_temp_c": "degC"}.get(name, "bar"), signal.unit


if __name__ == "__main__":
    {"write": write, "check": check}[sys.argv[1]](*sys.argv[2:])
