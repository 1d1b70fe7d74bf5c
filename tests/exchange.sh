#!/usr/bin/env bash
# The library inside an FMU and the Python package, built and tried by the tools of others: FMPy, libcosim, aqdefreader, pytest,
# mypy, Jupyter. Needs Rust, a C compiler, python3 with venv and a network for their packages. One build of the library serves both;
# `HIL_EXCHANGE_PROFILE=dev` takes the library as the tests of the program have built it, with all of its features, where sizes and speeds
# say nothing and are not held. The command `hil` is the argument, where it is built already.
set -euo pipefail
cd "$(dirname "$0")/.."
profile=${HIL_EXCHANGE_PROFILE:-release}
built=target/$([ "$profile" = dev ] && echo debug || echo "$profile")
features=$([ "$profile" = dev ] && echo --features hil/default || true)
work=target/exchange
mkdir -p "$work"
[ -x "$work/venv/bin/python" ] || python3 -m venv "$work/venv"
python=$work/venv/bin/python
"$python" -m pip install --quiet --disable-pip-version-check \
    'fmpy==0.3.32' 'libcosimpy==0.0.6' 'aqdefreader==1.3.0' 'chardet==5.2.0' 'numpy>=2,<3' 'pandas>=2,<3' 'polars>=1,<2' 'pyarrow>=20' \
    'pytest>=8,<10' 'mypy>=1.10,<3' pandas-stubs 'nbclient>=0.10,<1' 'nbformat>=5,<6' 'ipykernel>=6'

step() { printf '\n-- %s (%s s)\n' "$1" "$SECONDS"; }

step "build"
hil=$PWD/${1:-$built/hil}
[ $# -gt 0 ] || cargo build --locked --profile "$profile" --bin hil
# Always both: one of them alone would build the library again, with other features of what it depends on.
# shellcheck disable=SC2086
cargo build --locked --profile "$profile" -p hil-fmu -p hil-python --lib --examples $features
library=$PWD/$work/libhil_fmu.so
strip -o "$library" "$built/libhil_fmu.so"

step "the library inside an FMU"
# shellcheck disable=SC2086
cargo test --locked --profile "$profile" -p hil-fmu -p hil-python $features -- --nocapture

step "models as FMUs, in FMPy"
rm -rf "$work/models"
"$built/examples/models" "$work/models"
"$python" tests/peers/fmu.py "$hil" "$library" "$work/fmu" "$work"/models/*.toml
if [ "$profile" = release ]; then
    size=$(stat -c %s "$work/fmu/plain-2.fmu")
    [ "$size" -lt 4000000 ] || { echo "an FMU has $size bytes; below 4 MB is wanted"; exit 1; }
fi
step "the same in libcosim"
"$python" tests/peers/second_importer.py "$hil" "$library" "$work/cosim" "$work"/models/{plain,flow_limit,three}.toml
step "our own plant with an effect left out, as a foreign model"
"$python" tests/peers/foreign.py "$hil" "$library" "$work/foreign"

step "a lot as AQDEF"
rm -rf "$work/lot" "$work/lot.dfq"
"$hil" batch tipin --count 25 --sim --population examples/batch/population.toml --out "$work/lot" --format json > /dev/null 2> "$work/lot.log"
"$hil" export "$work/lot" -o "$work/lot.dfq"
"$python" tests/peers/aqdef.py "$work/lot.dfq" "$work/lot"

step "the Python package"
rm -rf "$work/wheel"
MATURIN_PEP517_ARGS="--locked --profile $profile $features" "$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$work/wheel" ./python
ls -l "$work"/wheel/*.whl
"$python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$work"/wheel/*.whl
HIL=$hil "$python" -m pytest -q python/tests
# The same wheel on the other versions of Python that this machine has.
for other in 3.10 3.12 3.13; do
    found=$(command -v "python$other" || ls -d "$HOME"/.pyenv/versions/"$other".*/bin/python 2> /dev/null | head -1 || true)
    "${found:-false}" -c 'import venv, ensurepip' 2> /dev/null || { echo "Python $other is not here"; continue; }
    [ -x "$work/venv-$other/bin/python" ] || "$found" -m venv "$work/venv-$other"
    "$work/venv-$other/bin/python" -m pip install --quiet --disable-pip-version-check 'numpy>=2,<3' pandas polars pyarrow pytest
    "$work/venv-$other/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$work"/wheel/*.whl
    echo "Python $other:" && "$work/venv-$other/bin/python" -m pytest -q python/tests
done
(cd python && "../$python" -m mypy --strict hil)
if [ "$profile" = release ]; then
    "$python" tests/peers/python_figures.py "$hil"
fi
step "the notebook"
"$python" - << 'NOTEBOOK'
import nbformat
from nbclient import NotebookClient
notebook = nbformat.read("python/examples/diagnosis.ipynb", as_version=4)
NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": "python/examples"}}).execute()
print("notebook:", len(notebook.cells), "cells")
NOTEBOOK
