"""A valve and recordings of it, made by the program itself from a model that ships with it."""

from __future__ import annotations

import numpy as np
import pytest

import hil

VALVE = """
schema = "hil.valve/1"
name = "example"
source = "made for the tests of the Python package"
current_limits = ["0 A", "1 A"]
hysteresis.hyperbolic.a = "0.8 bar^2"
delay = "20 ms"
lag = "10 ms"
floor = "0 bar"
noise = "20 mbar"

[curve]
ascending = [-42.65, 92.5, -8.4, -2.03]
descending = [-40.01, 83.32, -1.3, -2.41]
"""

Columns = dict[str, np.ndarray]


def triangle(seconds: float, period_s: float, step_s: float = 0.01) -> np.ndarray:
    """A current that rises and falls between 0.1 A and 0.9 A."""
    t = np.arange(0.0, seconds, step_s)
    phase = (t / period_s) % 1.0
    return 0.1 + 0.8 * (1.0 - np.abs(2.0 * phase - 1.0))


def recorded(model: hil.Model, current: np.ndarray, seed: int) -> Columns:
    """What a sensor with 20 mbar of noise would have recorded."""
    noise = np.random.default_rng(seed).normal(0.0, 0.02, current.size)
    return {"time_s": 0.01 * np.arange(current.size), "current_a": current, "pressure_bar": hil.simulate(model, current) + noise}


@pytest.fixture(scope="session")
def model() -> hil.Model:
    return hil.Model.from_toml(VALVE)


@pytest.fixture(scope="session")
def sweep(model: hil.Model) -> Columns:
    return recorded(model, triangle(80.0, 40.0), 1)


@pytest.fixture(scope="session")
def drive(model: hil.Model) -> Columns:
    """A drive of a valve whose pressure cannot rise faster than 20 bar/s, which the model does not know."""
    limited = hil.Model.from_toml(VALVE + '\n[[effect]]\nflow_limit = { rise = "20 bar/s", fall = "20 bar/s" }\n')
    levels = np.random.default_rng(7).uniform(0.2, 0.9, 60)
    return recorded(limited, np.repeat(levels, 100), 2)
