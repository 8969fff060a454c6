#!/usr/bin/env python3
"""Says how far two runs of one scene are apart: the first 25 visual steps, and the force's RMS over the run."""

import csv
import math
import pathlib
import sys

FIRST_STEPS = 25


def rows(file):
    with open(file, newline="") as text:
        return list(csv.DictReader(text))


def number(text):
    try:
        return float(text)
    except ValueError:
        return math.nan


def largest_difference(first, second):
    """Relative to the column's largest value: the largest difference, and the column it is in."""
    worst, column = 0.0, "-"
    for name in first[0]:
        a = [number(row[name]) for row in first]
        b = [number(row.get(name, "nan")) for row in second]
        scale = max((abs(x) for x in a if math.isfinite(x)), default=0.0)
        for x, y in zip(a, b):
            if x == y or (math.isnan(x) and math.isnan(y)):
                continue
            difference = abs(x - y) / scale if scale > 0 else abs(y)
            if not difference <= worst:
                worst, column = difference, name
    return worst, column


def rms_force(table):
    names = [n for n in table[0] if n.startswith("sent_f") or n.startswith("sent_force")]
    return math.sqrt(sum(number(row[n]) ** 2 for row in table for n in names) / len(table))


def main():
    old, new = (pathlib.Path(folder) for folder in sys.argv[1:3])
    a, b = rows(old / "visual.csv"), rows(new / "visual.csv")
    worst, column = largest_difference(a[:FIRST_STEPS], b[:FIRST_STEPS])
    first, second = rms_force(rows(old / "haptic.csv")), rms_force(rows(new / "haptic.csv"))
    change = abs(second - first) / first if first > 0 else abs(second)
    print(f"first {FIRST_STEPS} steps {worst:.1e} ({column}), RMS force {first:.6g} -> {second:.6g} N ({change:.2%})")


if __name__ == "__main__":
    main()
