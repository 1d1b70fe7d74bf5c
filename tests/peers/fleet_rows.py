"""Whether two folders of answers hold the same rows, each id once.

    python fleet_rows.py ONE OTHER
"""
import json
import sys
from pathlib import Path


def rows(folder):
    """The rows by id; the recording's place and the number of the answer may differ between calls."""
    found = {}
    for segment in sorted(Path(folder, "rows").glob("*.jsonl")):
        for line in segment.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            if row["id"] in found:
                sys.exit(f"{folder}: {row['id']} has two rows")
            found[row["id"]] = {k: v for k, v in row.items() if k not in ("recording", "model")}
    return found


def main():
    one, other = rows(sys.argv[1]), rows(sys.argv[2])
    if one.keys() != other.keys():
        sys.exit(f"{len(one)} and {len(other)} rows; not in both: {sorted(one.keys() ^ other.keys())[:5]}")
    differing = [k for k in one if one[k] != other[k]]
    if differing:
        sys.exit(f"{len(differing)} rows differ, such as\n{one[differing[0]]}\n{other[differing[0]]}")
    print(f"{len(one)} rows, equal row by row")


if __name__ == "__main__":
    main()
