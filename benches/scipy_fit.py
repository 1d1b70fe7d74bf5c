"""Seconds that a plain NumPy and SciPy fit of an effect takes: the yardstick of `cargo bench --bench diagnose`.

The base model of the paper (cubic ascending and descending curve, hyperbola between them, delay) with one effect is
fitted to the simulation error of a recording of 120 s at 100 Hz by scipy.optimize.least_squares, from one start: gain
and offset of the curves, a, delay, and the effect's parameter. What has no memory, the stretches between two turns of
the current and the linear lag are computed by whole arrays; the play is a recursion and a loop over the samples. The
bench makes the same fits (group `plain fit`) and writes the recordings, so run it first:

    cargo bench --bench diagnose -- "plain fit"
    python3 -m venv target/scipy && target/scipy/bin/pip install numpy scipy
    target/scipy/bin/python benches/scipy_fit.py [FOLDER OF THE RECORDINGS, target/tmp]
"""
import platform
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import scipy
from scipy.optimize import least_squares
from scipy.signal import lfilter

REPETITIONS = 7
STEP_S = 0.01
ASCENDING = np.array([-42.65, 92.5, -8.4, -2.03])
DESCENDING = np.array([-40.01, 83.32, -1.3, -2.41])


def hyperbola(current, ascending, descending, a):
    """Pressure from the current, Eqs. (5) to (8): one array per stretch between two turns."""
    up, down = np.polyval(ascending, current), np.polyval(descending, current)
    pressure = np.empty_like(current)
    pressure[0] = 0.5 * (up[0] + down[0])
    sign = np.sign(np.diff(current))
    moving = np.flatnonzero(sign)
    turns = moving[1:][sign[moving[1:]] != sign[moving[:-1]]]
    pressure[1:moving[0] + 1 if len(moving) else None] = pressure[0]
    for begin, end in zip([*moving[:1], *turns], [*turns, len(current) - 1]):
        rising = sign[begin] > 0
        curve = up if rising else down
        p_t = pressure[begin] + a / (curve[begin] - pressure[begin])
        f = curve[begin + 1:end + 1]
        root = np.sqrt((p_t - f) ** 2 + 4.0 * a)
        pressure[begin + 1:end + 1] = 0.5 * (p_t + f + (root if rising else -root))
    return pressure


def lag(pressure, tau_s):
    """First-order lag, exact for an input that is linear between samples."""
    ratio = STEP_S / tau_s
    decay = np.exp(-ratio)
    mean = (1.0 - decay) / ratio
    weights = [1.0 - mean, mean - decay]
    return lfilter(weights, [1.0, -decay], pressure, zi=[pressure[0] * (1.0 - weights[0])])[0]


def play(current, width):
    """Play operator of a dead band at reversals: each sample needs the one before."""
    half, position, out = 0.5 * width, current[0], []
    for i in current.tolist():
        if position < i - half:
            position = i - half
        elif position > i + half:
            position = i + half
        out.append(position)
    return np.array(out)


def simulate(theta, effect, times, current):
    """Pressure [bar] of the model: gain, offset [bar], a [bar^2], delay [s], the effect's parameter."""
    gain, offset, a, delay_s, size = theta
    shift = np.array([0.0, 0.0, 0.0, offset])
    current = np.interp(times - delay_s, times, current)
    if effect == "reversal_dead_band":
        current = play(current, size)
    pressure = np.maximum(hyperbola(current, gain * ASCENDING + shift, gain * DESCENDING + shift, a), 0.0)
    return lag(pressure, size) if effect == "first_order_lag" else pressure


def seconds(work):
    """Median and range of the time of one call."""
    took = []
    for _ in range(REPETITIONS):
        begin = time.perf_counter()
        work()
        took.append(time.perf_counter() - begin)
    return f"{statistics.median(took):.4f} s ({min(took):.4f} to {max(took):.4f})"


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "target/tmp")
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy {scipy.__version__}; medians of {REPETITIONS}")
    for effect, start in [("first_order_lag", 0.015), ("reversal_dead_band", 0.008)]:
        table = np.genfromtxt(folder / f"{effect}.csv", delimiter=",", names=True)
        times, current, measured = table["time_s"], table["current_a"], table["pressure_bar"]
        simulations = 0

        def residual(theta):
            nonlocal simulations
            simulations += 1
            return measured - simulate(theta, effect, times, current)

        theta = [0.97, 0.2, 0.5, 0.027, start]  # a delay of whole samples would begin on a kink of the interpolation
        bounds = ([0.0, -np.inf, 1e-6, 0.0, 1e-4], np.inf)

        def fit():
            return least_squares(residual, theta, bounds=bounds, x_scale="jac")

        fitted = fit()
        took = simulations
        print(f"{effect}: {np.round(fitted.x, 4)} at {np.sqrt(np.mean(fitted.fun ** 2)):.4f} bar after {took} simulations")
        print(f"  one simulation  {seconds(lambda: residual(theta))}")
        print(f"  fit             {seconds(fit)}")


main()
