#!/usr/bin/env python3
"""Compares the stubs of the package in FOLDER with what the extension has (mypy.stubtest), and checks that the types
hold for a program that uses them.

    check_stubs.py FOLDER
"""

import os
import pathlib
import subprocess
import sys

try:
    from mypy.version import __version__ as version
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)
if int(version.split(".")[0]) < 1:
    print(f"skipped: mypy {version} is too old")
    sys.exit(77)


def main():
    folder = pathlib.Path(sys.argv[1]).resolve()
    here = pathlib.Path(__file__).resolve().parent
    environment = {**os.environ, "MYPYPATH": str(folder), "PYTHONPATH": str(folder), "MYPY_CACHE_DIR": str(folder.parent / "mypy")}
    stubs = [sys.executable, "-m", "mypy.stubtest", "palpate", "--ignore-unused-allowlist", "--allowlist", here / "stubs_allowed.txt"]
    program = [sys.executable, "-m", "mypy", "--strict", here / "typed_use.py"]
    return max(subprocess.run(c, env=environment, check=False).returncode for c in (stubs, program))


if __name__ == "__main__":
    sys.exit(main())
