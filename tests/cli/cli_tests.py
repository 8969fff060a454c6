#!/usr/bin/env python3
"""End-to-end tests of the program: one case a call, silent when it holds.

What fails while the machine stood still is tried again: runs in real time cannot keep their bounds there.

usage: cli_tests.py --list | cli_tests.py --program FILE --source FOLDER [CASE...]   (no CASE: all)
"""

import argparse
from pathlib import Path
import sys
import tempfile
import threading
import time

import bad_input  # noqa: F401  registers its cases
import command_line  # noqa: F401
import devices  # noqa: F401
import faults  # noqa: F401
import mesh_files  # noqa: F401
import safety  # noqa: F401
import studies  # noqa: F401
import subcommands  # noqa: F401
import tables  # noqa: F401
from harness import CASES, Context, Failure, Skip

SKIPPED = 77  # exit code
STALL = 0.02  # s: a thread that wants to run waits longer than this on a machine that has no time for a case
TRIES = 5


class Stalls(threading.Thread):
    """Looks every 2 ms how late it is."""

    def __init__(self):
        super().__init__(daemon=True)
        self.longest = 0.0  # s
        self.ended = threading.Event()

    def run(self):
        before = time.monotonic()
        while not self.ended.wait(0.002):
            now = time.monotonic()
            self.longest = max(self.longest, now - before - 0.002)
            before = now


def outcome(name, options):
    """Runs a case. @returns None, a Skip or what went wrong; and the longest stall of the machine meanwhile [s]"""
    stalls = Stalls()
    stalls.start()
    try:
        with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
            CASES[name](Context(options.program, options.source, folder))
            result = None
    except Skip as reason:
        result = reason
    except Failure as failure:
        result = str(failure)
    except (OSError, LookupError, TypeError, ValueError) as error:  # a result that is missing or of another form
        result = f"{type(error).__name__}: {error}"
    finally:
        stalls.ended.set()
        stalls.join()
    return result, stalls.longest


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--program")
    parser.add_argument("--source")
    parser.add_argument("cases", nargs="*")
    options = parser.parse_args()
    if options.program and options.source:  # cases run in folders of their own
        options.program, options.source = str(Path(options.program).resolve()), str(Path(options.source).resolve())
    if options.list:
        print("\n".join(CASES))
        return 0
    failures, skipped = 0, 0
    for name in options.cases or CASES:
        result, stall = outcome(name, options)
        for _ in range(TRIES - 1):
            if not isinstance(result, str) or stall <= STALL:
                break
            print(f"{name}: {result} (the machine stood for {stall:.3f} s: once more)", file=sys.stderr)
            result, stall = outcome(name, options)
        if isinstance(result, Skip):
            skipped += 1
            print(f"{name}: skipped: {result}", file=sys.stderr)
        elif result is not None:
            failures += 1
            print(f"{name}: {result}", file=sys.stderr)
    return 1 if failures else SKIPPED if skipped == len(options.cases) > 0 else 0


if __name__ == "__main__":
    sys.exit(main())
