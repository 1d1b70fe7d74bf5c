#!/usr/bin/env bash
# The library inside an FMU and the Python package, built and tried by the tools of others: FMPy, aqdefreader, pytest, mypy.
# Needs Rust, python3 with venv and a network for their packages. It builds three times with optimisation, so it is run by hand, not by .ci/run.
set -euo pipefail
cd "$(dirname "$0")/.."
work=target/exchange
mkdir -p "$work"
[ -x "$work/venv/bin/python" ] || python3 -m venv "$work/venv"
python=$work/venv/bin/python
"$python" -m pip install --quiet --disable-pip-version-check \
    'fmpy==0.3.32' 'aqdefreader==1.3.0' 'chardet==5.2.0' 'numpy>=2,<3' 'pandas>=2,<3' 'polars>=1,<2' 'pyarrow>=20' 'pytest>=8,<10' 'mypy>=1.10,<3' pandas-stubs \
    'nbclient>=0.10,<1' 'nbformat>=5,<6' 'ipykernel>=6'

cargo build --locked --release --bin hil
hil=$PWD/target/release/hil
cargo build --locked --release -p hil-fmu
ls -l target/release/libhil_fmu.so

echo "== the library inside an FMU"
cargo test --locked -p hil-fmu

echo "== models as FMUs"
"$python" tests/peers/models.py "$work/models"
"$python" tests/peers/fmu.py "$hil" target/release/libhil_fmu.so "$work/fmu" "$work"/models/*.toml

echo "== a lot as AQDEF"
rm -rf "$work/lot" "$work/lot.dfq"
"$hil" batch plans/tipin.toml --count 25 --sim --population examples/batch/population.toml --out "$work/lot" --format json > /dev/null 2> "$work/lot.log"
"$hil" export "$work/lot" -o "$work/lot.dfq"
"$python" tests/peers/aqdef.py "$work/lot.dfq" "$work/lot"

echo "== the Python package"
"$python" -m pip install --quiet --disable-pip-version-check ./python
HIL=$hil "$python" -m pytest -q python/tests
(cd python && "../$python" -m mypy --strict hil)
"$python" - << 'NOTEBOOK'
import nbformat
from nbclient import NotebookClient
notebook = nbformat.read("python/examples/diagnosis.ipynb", as_version=4)
NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": "python/examples"}}).execute()
print("notebook:", len(notebook.cells), "cells")
NOTEBOOK
