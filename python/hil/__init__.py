"""Valve models from recordings, simulation, and a diagnosis of missing physics.

The same code as the program ``hil``: the same answers, the same words, the same JSON.

Frames are pandas or polars data frames, pyarrow tables or dictionaries of arrays with the columns of a recording:
``time_s`` [s], ``current_a`` [A], ``pressure_bar`` [bar], optionally ``run`` (text), ``target_bar``, ``current_meas_a``,
``oil_temp_c``, ``supply_bar``. ``map`` takes foreign columns: ``{"current_a": "I_cmd [mA]"}``.
"""

from __future__ import annotations

import html
import json as _json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _hil
from ._frames import columns as _columns
from ._frames import mapping as _mapping
from ._hil import HilError, ModelError, RecordingError, __version__
from ._hil import Model as _Model

if TYPE_CHECKING:
    import pandas

__all__ = ["Diagnosis", "HilError", "Identified", "Model", "ModelError", "RecordingError", "__version__", "diagnose", "identify", "simulate"]


class Model:
    """A valve model, the content of a file with ``schema = "hil.valve/1"``."""

    __slots__ = ("_model",)

    def __init__(self, model: _Model) -> None:
        self._model = model

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Model:
        """Reads a valve file: its path, or the bare name of one that ships with the program.

        Raises ModelError with file, line and key.
        """
        return cls(_Model.load(os.fspath(path)))

    @classmethod
    def from_toml(cls, text: str) -> Model:
        """Reads the text of a valve file."""
        return cls(_Model.from_toml(text))

    def to_toml(self) -> str:
        """The text of the valve file."""
        return self._model.to_toml()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the valve file; it is whole under its name or not there."""
        target = Path(path)
        part = target.with_name(f".{target.name}.{os.getpid()}.part")
        try:
            part.write_text(self.to_toml(), encoding="utf-8")
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)

    @property
    def name(self) -> str:
        """Name of the valve."""
        return self._model.name

    @property
    def delay_s(self) -> float:
        """Dead time between command and pressure [s]."""
        return self._model.delay_s

    @property
    def lag_s(self) -> float:
        """Time constant of the lag [s]; 0 for none."""
        return self._model.lag_s

    @property
    def noise_bar(self) -> float:
        """Standard deviation of the sensor noise [bar]."""
        return self._model.noise_bar

    @property
    def effects(self) -> list[str]:
        """Ids of the effects beyond the base model."""
        return self._model.effects

    @property
    def current_limits_a(self) -> tuple[float, float]:
        """Smallest and largest current that the valve may see [A]."""
        return self._model.current_limits_a

    def __repr__(self) -> str:
        return repr(self._model)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self._model == other._model

    __hash__ = None  # type: ignore[assignment]


class _Answer:
    """What identification and diagnosis have in common: a model, the JSON of the contract, a text, a page."""

    def __init__(self, answer: tuple[_Model, str, str, str]) -> None:
        self.model = Model(answer[0])
        """The model that was found."""
        self.json: dict[str, Any] = _json.loads(answer[1])
        """The document that the program prints with ``--format json``."""
        self.text: str = answer[2]
        """What the program prints on a terminal."""
        self.page: str = answer[3]
        """The page as HTML; one file, nothing from the network."""

    def __str__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self.page)}" style="width:100%;height:640px;border:0"></iframe>'


class Identified(_Answer):
    """A valve model identified from a recording."""

    @property
    def rmse_bar(self) -> float:
        """Error of the model on the recording [bar]."""
        return float(self.json["rmse_bar"])

    @property
    def warnings(self) -> list[str]:
        """What the recording could not carry."""
        return list(self.json["warnings"])

    def __repr__(self) -> str:
        return f"<hil.Identified {self.model!r}, RMSE {self.rmse_bar:.3f} bar>"


class Diagnosis(_Answer):
    """Where a simulation and a recording differ, and what physics the model lacks. ``model`` is the augmented model."""

    @property
    def verdict(self) -> str:
        """``match``, ``explained``, ``partly_explained``, ``unexplained`` or ``not_comparable``."""
        return str(self.json["verdict"])

    @property
    def summary(self) -> str:
        """One paragraph."""
        return str(self.json["summary"])

    @property
    def rmse_bar(self) -> dict[str, float]:
        """Errors before and after, on held-out data, and the noise floor [bar]."""
        return dict(self.json["rmse_bar"])

    @property
    def effects(self) -> pandas.DataFrame:
        """One row an effect and parameter: ``id, parameter, value, std_error, low, high, unit, heldout_gain_bar, p_value``; ``low`` and
        ``high`` are the 95 % interval, empty where the recording does not bound the parameter. Needs pandas."""
        import pandas as pd

        names = ["id", "parameter", "value", "std_error", "low", "high", "unit", "heldout_gain_bar", "p_value"]
        rows = [
            [e["id"], name, p["value"], p.get("std_error"), *(p.get("interval") or (None, None)), p["unit"], e["heldout_gain_bar"], e["p_value"]]
            for e in self.json["effects"]
            for name, p in (e["parameters"] or {"": {"value": None, "unit": ""}}).items()
        ]
        return pd.DataFrame(rows, columns=names)

    @property
    def candidates(self) -> pandas.DataFrame:
        """Everything that was tried: ``id, bic, heldout_rmse_bar, rejected_because``. Needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.json["candidates"], columns=["id", "bic", "heldout_rmse_bar", "rejected_because"])

    def __repr__(self) -> str:
        found = ", ".join(e["id"] for e in self.json["effects"]) or "no effect"
        return f"<hil.Diagnosis {self.verdict}: {found}>"


def identify(
    frame: Any,
    *,
    map: Mapping[str, str] | None = None,  # noqa: A002 - the word of the command line
    hysteresis: str | None = None,
    order: int | None = None,
    name: str | None = None,
    source: str = "frame",
) -> Identified:
    """A valve model from a recording, as ``hil identify``.

    hysteresis: ``"hyperbolic"`` or ``"none"``; found from the data where not given. order: that of the curves.
    Raises RecordingError where a column is missing or the data hold nothing to identify.
    """
    return Identified(_hil.identify_columns(_columns(frame), source, _mapping(map), hysteresis, order, name))


def diagnose(
    frame: Any,
    model: Model,
    *,
    map: Mapping[str, str] | None = None,  # noqa: A002 - the word of the command line
    source: str = "frame",
) -> Diagnosis:
    """What physics the model lacks to give this recording, as ``hil diagnose``.

    Raises RecordingError where the recording cannot carry a diagnosis.
    """
    return Diagnosis(_hil.diagnose_columns(_columns(frame), source, _mapping(map), model._model))


def simulate(
    model: Model,
    current: npt.ArrayLike,
    *,
    step_s: float = 0.01,
    time: npt.ArrayLike | None = None,
    input: str = "held",  # noqa: A002 - the word of the command line
) -> npt.NDArray[np.float64]:
    """Simulated pressure [bar], shape (n,), of a current [A], shape (n,).

    step_s: time between two samples [s]; or time: that of each sample [s], increasing, shape (n,).
    input: ``"held"``, the command stands until the next sample, as the program takes it, or ``"ramp"``, it goes there on a line.
    A float64 array is read in place. Raises ModelError.
    """
    wanted = np.ascontiguousarray(current, dtype=np.float64)
    if time is None:
        return _hil.simulate_even(model._model, input, step_s, wanted)
    return _hil.simulate_at(model._model, input, np.ascontiguousarray(time, dtype=np.float64), wanted)
