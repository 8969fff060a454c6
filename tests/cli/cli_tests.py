#!/usr/bin/env python3
"""End-to-end tests of the program: one case a call, silent when it holds.

usage: cli_tests.py --list | cli_tests.py --program FILE --source FOLDER [CASE...]   (no CASE: all)
"""

import argparse
from pathlib import Path
import sys
import tempfile

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
        with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
            try:
                CASES[name](Context(options.program, options.source, folder))
            except Skip as reason:
                skipped += 1
                print(f"{name}: skipped: {reason}", file=sys.stderr)
            except Failure as failure:
                failures += 1
                print(f"{name}: {failure}", file=sys.stderr)
            except (OSError, LookupError, TypeError, ValueError) as error:  # a result that is missing or of another form
                failures += 1
                print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
    return 1 if failures else SKIPPED if skipped == len(options.cases) > 0 else 0


if __name__ == "__main__":
    sys.exit(main())
