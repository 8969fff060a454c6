#!/usr/bin/env python3
"""Puts standard input into a page, between the markers `<!-- rivals: NAME -->` and `<!-- end -->`: fill.py PAGE NAME"""

import datetime
import pathlib
import re
import subprocess
import sys


def processor():
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return "unknown processor"


def main():
    page, name = pathlib.Path(sys.argv[1]), sys.argv[2]
    figures = sys.stdin.read().strip()
    if not figures:
        sys.exit(f"fill.py: no figures for {name}")
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    source = f"*{datetime.date.today()}, {processor()}, one thread, {commit}.* "
    between = re.compile(rf"(<!-- rivals: {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    text, count = between.subn(lambda m: f"{m[1]}\n{source}{figures}\n\n{m[2]}", page.read_text())
    if count != 1:
        sys.exit(f"fill.py: {page} has {count} places for {name}")
    page.write_text(text)


main()
