"""Reads an exported lot with aqdefreader and compares it with the batch's own journal, value by value.

    python aqdef.py LOT.dfq BATCH
"""
import glob
import json
import math
import sys
from datetime import datetime

from aqdefreader import read_dfq_file

ABSENT = 256


def attempts(batch):
    """The deciding attempt of every judged valve, in the order of the batch: (serial, lot, time, {name: (value, limit)})."""
    last = {}
    for segment in sorted(glob.glob(f"{batch}/journal/*.jsonl")):
        for line in open(segment, encoding="utf-8"):
            text = line[line.index("{"):line.rindex("}") + 1]
            entry = json.loads(text)
            record = entry.get("record")
            if entry["event"] != "finished" or record is None or record["outcome"] not in ("PASS", "MARGINAL", "FAIL"):
                continue
            if entry["position"] in last and last[entry["position"]][0] > entry["attempt"]:
                continue
            figures = {}
            for phase in record["phases"]:
                seen = {}
                for m in phase["measurements"]:
                    seen[m["metric"]] = seen.get(m["metric"], 0) + 1
                    number = "" if seen[m["metric"]] == 1 else f"#{seen[m['metric']]}"
                    figures[f"{phase['name']} {m['metric']}{number}"] = (m.get("value"), m.get("limit") or {})
            started = (record.get("provenance") or {}).get("started") or entry["at"]
            last[entry["position"]] = (entry["attempt"], record["dut"], started, figures)
    return [last[k] for k in sorted(last)]


def main():
    lot, batch = sys.argv[1:3]
    part = read_dfq_file(lot).get_part(0)
    valves = attempts(batch)
    wrong = []
    compared = absent = 0
    for characteristic in part.get_characteristics():
        name = characteristic.get_data("K2002")
        values = characteristic.get_measurements()
        if len(values) != len(valves):
            wrong.append(f"{name}: {len(values)} values, {len(valves)} valves")
            continue
        for measured, (_, dut, started, figures) in zip(values, valves):
            value, limit = figures.get(name, (None, {}))
            if value is None:
                absent += 1
                if measured.attribute != ABSENT:
                    wrong.append(f"{name}, {dut['serial']}: attribute {measured.attribute} for an absent value")
            elif measured.attribute != 0 or not math.isclose(float(measured.value), value, rel_tol=1e-12, abs_tol=1e-12):
                wrong.append(f"{name}, {dut['serial']}: {measured.value} ({measured.attribute}), {value} in the journal")
            if measured.datetime != datetime.fromisoformat(started[:19]):
                wrong.append(f"{name}, {dut['serial']}: {measured.datetime}, {started} in the journal")
            for key, bound in (("K2110", "min"), ("K2111", "max")):
                have, want = characteristic.get_data(key), limit.get(bound)
                if value is not None and (have is None) != (want is None) or have is not None and want is not None and float(have) != want:
                    wrong.append(f"{name}: {key} {have}, {want} in the journal")
            compared += 1
    if not compared:
        wrong.append("nothing was compared")
    print(f"{compared} values, {absent} absent, {len(wrong)} wrong")
    for line in wrong[:20]:
        print(line)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
