"""Writes valve files with effects of every stage; the tests of `fmu/` try all effects, without a foreign importer.

    python models.py FOLDER
"""
import sys
from pathlib import Path

BASE = """schema = "hil.valve/1"
name = "{name}"
source = "made for a test"
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

EFFECTS = {
    "plain": "",
    "transport_delay": 'extra = "15 ms"',
    "first_order_lag": 'tau = "45 ms"',
    "second_order_resonance": 'frequency = "8 Hz", damping = "0.3"',
    "flow_limit": 'rise = "60 bar/s", fall = "50 bar/s"',
    "reversal_dead_band": 'width = "15 mA"',
    "supply_saturation": 'limit = "16 bar"',
    "reference_drift": 'gain = "4 %", tau = "60 s"',
    "reference_shift": 'gain = "4 %"',
    "leakage": 'loss = "1 bar"',
    "creep": 'gain = "5 %", tau = "3 s", spread = "1"',
    "sensor_lag": 'tau = "30 ms"',
    "sensor_quantization": 'step = "0.1 bar"',
}


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, parameters in EFFECTS.items():
        text = BASE.format(name=name)
        if parameters:
            text += f"\n[[effect]]\n{name} = {{ {parameters} }}\n"
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    (folder / "three.toml").write_text(
        BASE.format(name="three")
        + "".join(f"\n[[effect]]\n{name} = {{ {EFFECTS[name]} }}\n" for name in ("reversal_dead_band", "flow_limit", "sensor_lag")),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
