#!/usr/bin/env python3
"""Executes the notebooks of a folder as Jupyter does, and checks that none keeps outputs in the repository.

    run_notebooks.py FOLDER [--save FOLDER]     --save: the executed ones go there
"""

import argparse
import os
import pathlib
import sys
import time

try:
    import matplotlib  # noqa: F401
    import nbformat
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--save", type=pathlib.Path)
    options = parser.parse_args()
    os.environ["PALPATE_SCENES"] = str(options.folder.resolve().parent.parent / "scenes")
    failed = False
    for file in sorted(options.folder.glob("*.ipynb")):
        notebook = nbformat.read(file, as_version=4)
        cells = [c for c in notebook.cells if c.cell_type == "code"]
        if any(c.outputs or c.execution_count for c in cells):
            print(f"{file.name}: has outputs; clear them before it is committed")
            failed = True
        begin = time.monotonic()
        try:
            NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(file.parent)}}).execute()
        except CellExecutionError as error:
            print(f"{file.name}: {error}")
            failed = True
        if options.save:
            options.save.mkdir(parents=True, exist_ok=True)
            nbformat.write(notebook, options.save / file.name)
        pictures = sum("image/png" in o.get("data", {}) for c in cells for o in c.outputs)
        print(f"{file.name}: {len(cells)} cells, {pictures} pictures, {time.monotonic() - begin:.1f} s")
    return failed


if __name__ == "__main__":
    sys.exit(main())
