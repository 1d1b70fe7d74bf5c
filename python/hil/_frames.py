"""Data frames, tables and dictionaries of arrays as named columns, without copies where the memory allows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Columns = list[tuple[str, Any]]


def _names(frame: Any) -> list[str]:
    if isinstance(frame, Mapping):
        return [str(name) for name in frame]
    names = getattr(frame, "column_names", None)  # pyarrow
    if names is None:
        names = getattr(frame, "columns", None)  # pandas, polars
    if names is None:
        raise TypeError(f"{type(frame).__name__} has no columns: a pandas or polars data frame, a pyarrow table or a dictionary of arrays is wanted")
    return [str(name) for name in names]


def _values(column: Any) -> Any:
    """Numbers as float64, texts as a list; what is neither is nothing."""
    array = column.to_numpy() if hasattr(column, "to_numpy") else np.asarray(column)
    kind = array.dtype.kind
    if kind == "M":  # time stamps count from their first, in seconds
        return np.ascontiguousarray((array - array[:1]) / np.timedelta64(1, "s"), dtype=np.float64)
    if kind == "m":
        return np.ascontiguousarray(array / np.timedelta64(1, "s"), dtype=np.float64)
    if kind in "fiu":
        return np.ascontiguousarray(array, dtype=np.float64)
    if kind in "OUT" and all(isinstance(v, str) for v in array):
        return [str(v) for v in array]
    if kind == "O":
        try:
            return np.ascontiguousarray([np.nan if v is None else float(v) for v in array], dtype=np.float64)
        except (TypeError, ValueError):
            return None
    return None


def columns(frame: Any) -> Columns:
    """All columns of a frame with their names."""
    return [(name, _values(frame[name])) for name in _names(frame)]


def mapping(map: Mapping[str, str] | None) -> list[str]:  # noqa: A002 - the word of the command line
    """`{"current_a": "I_cmd [mA]"}` as the command line has it."""
    return [f"{channel}={expression}" for channel, expression in (map or {}).items()]
