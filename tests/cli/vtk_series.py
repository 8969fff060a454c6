#!/usr/bin/python3
"""Reads an exported time series with VTK and prints as JSON what is in it.

usage: vtk_series.py FOLDER        the series: each step's time, ranges, sums
       vtk_series.py FILE.vtu      one file
"""

import json
import pathlib
import sys
import xml.etree.ElementTree as xml

import vtk


def read(path):
    problems = []
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.AddObserver("ErrorEvent", lambda *_: problems.append(f"{path}: VTK cannot read it"))
    reader.Update()
    if problems:
        sys.exit(problems[0])
    return reader.GetOutput()


def arrays(data):
    out = {}
    for i in range(data.GetNumberOfArrays()):
        a = data.GetArray(i)
        rows = [a.GetTuple(k) for k in range(a.GetNumberOfTuples())]
        columns = list(zip(*rows)) if rows else [()] * a.GetNumberOfComponents()
        out[a.GetName()] = {"components": a.GetNumberOfComponents(), "count": len(rows), "sum": [sum(c) for c in columns],
                            "low": [min(c, default=0) for c in columns], "high": [max(c, default=0) for c in columns]}
    return out


def volumes(grid):
    out = []
    for i in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(i)
        if cell.GetCellType() == vtk.VTK_TETRA:
            out.append(abs(vtk.vtkTetra.ComputeVolume(*[grid.GetPoint(cell.GetPointId(k)) for k in range(4)])))
    return out


def about(path):
    grid = read(path)
    bounds = [0.0] * 6
    grid.GetBounds(bounds)
    time = grid.GetFieldData().GetArray("TimeValue")
    own = volumes(grid)
    stress = grid.GetCellData().GetArray("stress")
    mean = None
    if stress and own:
        mean = [sum(v * stress.GetComponent(i, c) for i, v in enumerate(own)) / sum(own) for c in range(6)]
    return {"file": path.name, "points": grid.GetNumberOfPoints(), "cells": grid.GetNumberOfCells(), "bounds": bounds,
            "types": sorted({grid.GetCellType(i) for i in range(grid.GetNumberOfCells())}), "volume": sum(own),
            "time": time.GetValue(0) if time else None, "mean_stress": mean, "point": arrays(grid.GetPointData()),
            "cell": arrays(grid.GetCellData())}


def main():
    path = pathlib.Path(sys.argv[1])
    if path.is_file():
        print(json.dumps(about(path)))
        return
    out = {}
    for pvd in sorted(path.glob("*.pvd")):
        sets = xml.parse(pvd).getroot().find("Collection").findall("DataSet")
        out[pvd.stem] = [{"timestep": float(s.get("timestep")), "part": int(s.get("part")), "name": s.get("name"),
                          **about(path / s.get("file"))} for s in sets]
    print(json.dumps(out))


if __name__ == "__main__":
    main()
