#!/usr/bin/env bash
# How late the slots of a 100 Hz loop begin, beside a plain C client of libmodbus that does the same, on the same machine in the same
# minutes: tests/pace.sh [SECONDS [PAIRS]]   (60 and 5 by default)
#
# One emulator on TCP; `hil run` and tests/peers/modbus_pace.c take turns, both under SCHED_FIFO at the same priority with locked
# memory, and each pair begins with the other one. Prints a row for each pair, then the medians and their ratio; ends with 1 where
# the ratio is above 1.2 or a stale sample was taken. HIL names the program (target/release/hil by default).
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}; pairs=${2:-5}; hil=${HIL:-$PWD/target/release/hil}
[ -x "$hil" ] || { cargo build --release --locked --bin hil; hil=$PWD/target/release/hil; }
[ -e /usr/include/modbus/modbus.h ] || tests/peers/install.sh
folder=$(mktemp -d); emulator=
trap '[ -z "$emulator" ] || kill "$emulator" 2> /dev/null || true; rm -rf "$folder"' EXIT
cc -O2 -o "$folder/pace" tests/peers/modbus_pace.c -lmodbus
pace() { cat > "$folder/plan.toml" <<T
schema = "hil.plan/1"
name = "pace"
rate = "100 Hz"
timing.max_lost = "60 %"
timing.max_stale = "60 %"
timing.max_missed = "90 %"
[[phase]]
name = "hold"
stimulus.hold = { at = "300 mA", for = "$1 s" }
measure = [{ metric.max_pressure = {} }]
T
}
cd "$folder"
port=$((20000 + RANDOM % 20000))
# The device is none of the two: it gets the processor before other work, so that both see the same one.
first=(); chrt -f 30 true 2> /dev/null && first=(chrt -f 30)
"${first[@]}" "$hil" emulate --valve paper --driver emulator-tcp --tcp "127.0.0.1:$port" --fast > emulator.log 2>&1 &
emulator=$!
sleep 1
ours() {
    "$hil" run plan.toml --driver emulator-tcp --tcp "127.0.0.1:$port" --out "run-$1" > "run-$1.log" 2>&1 || { tail -5 "run-$1.log" >&2; }
    python3 - "run-$1/record.json" <<'P'
import json, sys
record = json.load(open(sys.argv[1]))
t = record["timing"]
fifo = any(k == "real-time priority" and v.startswith("SCHED_FIFO") for k, v in record["rig"]["details"])
print(f"{t['lateness_p99_s'] * 1e6:.3f} {t['samples']} {t['missed_slots']} {t['lost_samples']} {t['stale_samples']} {'fifo' if fifo else 'no-fifo'}")
P
}
theirs() { ./pace "$port" "$seconds" 100 "$(cat priority)"; }
pace 2
ours 0 > /dev/null
pace "$seconds"
python3 - <<'P'
import json
details = json.load(open("run-0/record.json"))["rig"]["details"]
name = next((v for k, v in details if k == "real-time priority"), "")
open("priority", "w").write(name.split()[-1] if name.startswith("SCHED_FIFO") else "50")
P
echo "pair | hil: p99 [us], slots, missed, lost, stale | C: p99 [us], slots, missed, lost, stale | load"
for pair in $(seq 1 "$pairs"); do
    if [ $((pair % 2)) = 1 ]; then a=$(ours "$pair"); b=$(theirs); else b=$(theirs); a=$(ours "$pair"); fi
    echo "$pair | $a | $b | $(cut -d' ' -f1 /proc/loadavg)" | tee -a pairs
done
python3 - <<'P'
import statistics, sys
rows = [[part.split() for part in line.split("|")] for line in open("pairs")]
ours, theirs = (statistics.median(float(r[k][0]) for r in rows) for k in (1, 2))
stale = sum(int(r[1][4]) for r in rows)
print(f"median of the 99th percentiles: hil {ours:.1f} us, C with libmodbus {theirs:.1f} us, ratio {ours / theirs:.2f} (at most 1.2); stale {stale}")
sys.exit(1 if ours / theirs > 1.2 or stale else 0)
P
