"""Parquet files as pyarrow writes and reads them, to compare with our own reader and writer.

write DIR         writes recordings with many column types to DIR, each NAME.parquet with its values in NAME.csv
check FILE CSV    reads FILE and compares every column with CSV
"""

import csv
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

ROWS = 3000


def save(folder, name, columns, expected, **options):
    pq.write_table(pa.table(columns), folder / f"{name}.parquet", **options)
    with open(folder / f"{name}.csv", "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(expected)
        for row in zip(*expected.values()):
            out.writerow([v if isinstance(v, str) else "" if v is None or np.isnan(v) else repr(float(v)) for v in row])


def write(folder):
    folder = Path(folder)
    time = np.arange(ROWS) * 0.01
    current = 0.5 + 0.4 * np.sin(time)
    pressure = 25 * current
    plain = {"time_s": time, "current_a": current, "pressure_bar": pressure}
    for compression in ["none", "snappy", "zstd"]:
        save(folder, compression, plain, plain, compression=compression, row_group_size=700)
    save(folder, "pages2", plain, plain, data_page_version="2.0", use_dictionary=False, column_encoding="BYTE_STREAM_SPLIT")

    gaps = [None if k % 7 == 3 else float(p) for k, p in enumerate(pressure)]
    runs = ["first" if k < 1000 else "second, longer" for k in range(ROWS)]
    save(folder, "gaps", {"run": runs} | plain | {"pressure_bar": gaps}, {"run": runs} | plain | {"pressure_bar": gaps})

    counts = np.round(pressure * 100).astype(np.int32)
    single = current.astype(np.float32)
    typed = {
        "time_s": pa.array(1_700_000_000_000_000 + np.arange(ROWS) * 10_000, pa.timestamp("us")),
        "current_a": single,
        "pressure_bar": counts,
        "oil_temp_c": np.full(ROWS, 2**31 + 5, np.uint32),
    }
    save(folder, "types", typed, {"time_s": time, "current_a": single, "pressure_bar": counts, "oil_temp_c": typed["oil_temp_c"]})


def check(path, expected):
    with open(expected, newline="") as file:
        rows = list(csv.DictReader(file))
    table = pq.read_table(path)
    assert table.column_names == list(rows[0]), table.column_names
    for name in table.column_names:
        if name == "run":
            assert table[name].to_pylist() == [row[name] for row in rows]
        else:
            assert table[name].to_pylist() == [float(row[name]) if row[name] else None for row in rows], name


if __name__ == "__main__":
    {"write": write, "check": check}[sys.argv[1]](*sys.argv[2:])
