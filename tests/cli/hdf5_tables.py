#!/usr/bin/python3
"""Reads tables with h5py and prints as JSON what is in them: for each file its columns, each a list.

usage: hdf5_tables.py FILE...
"""

import json
import sys

import h5py


def column(data):
    if data.dtype.kind == "S":
        return [text.decode() for text in data[:]]
    assert data.dtype in ("<f8", "<i8"), data.dtype
    return [repr(value) for value in data[:].tolist()]


tables = {}
for name in sys.argv[1:]:
    with h5py.File(name, "r") as file:
        assert all(data.chunks == (4096,) for data in file.values())
        tables[name] = {key: column(data) for key, data in file.items()}
json.dump(tables, sys.stdout)
