"""The valve that the peers' scripts conceal effects in: one that nobody has augmented. `{name}` is filled in."""

VALVE = """schema = "hil.valve/1"
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
