#!/usr/bin/python3
"""Writes a mesh of tetrahedra, and a surface, in every way that VTK, meshio and Assimp have.

usage: vtk_meshes.py FOLDER     prints as JSON what is in them: {"files": {name: {...}}, "refused": {name: words}}
"""

import contextlib
import json
import pathlib
import subprocess
import sys

import vtk

SIZE = (0.3, 0.2, 0.1)


def grid_of_tetrahedra():
    """A cloud of points, meshed by VTK, with a triangle, which is to be left out."""
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    random = vtk.vtkMinimalStandardRandomSequence()
    random.SetSeed(7)
    for corner in range(8):
        points.InsertNextPoint(*[SIZE[d] * (corner >> d & 1) for d in range(3)])
    for _ in range(200):
        x = []
        for d in range(3):
            random.Next()
            x.append(SIZE[d] * random.GetValue())
        points.InsertNextPoint(*x)
    cloud = vtk.vtkPolyData()
    cloud.SetPoints(points)
    mesher = vtk.vtkDelaunay3D()
    mesher.SetInputData(cloud)
    mesher.Update()
    made = mesher.GetOutput()
    grid = vtk.vtkUnstructuredGrid()
    grid.SetPoints(made.GetPoints())
    volume, used = 0.0, set()
    for i in range(made.GetNumberOfCells()):
        cell = made.GetCell(i)
        if cell.GetCellType() != vtk.VTK_TETRA:
            continue
        corners = [made.GetPoint(cell.GetPointId(k)) for k in range(4)]
        own = abs(vtk.vtkTetra.ComputeVolume(*corners))
        if own < 1e-8:
            continue
        volume += own
        used.update(cell.GetPointId(k) for k in range(4))
        grid.InsertNextCell(vtk.VTK_TETRA, cell.GetPointIds())
    tetrahedra = grid.GetNumberOfCells()
    face = vtk.vtkIdList()
    for k in range(3):
        face.InsertNextId(k)
    grid.InsertNextCell(vtk.VTK_TRIANGLE, 3, [0, 1, 2])
    add_data(grid)
    return grid, {"tetrahedra": tetrahedra, "nodes": len(used), "volume": volume}


def add_data(grid):
    """What stands around the mesh in files from elsewhere."""
    named = vtk.vtkDoubleArray()
    named.SetName("a vector")
    named.SetNumberOfComponents(3)
    for k, name in enumerate("XYZ"):
        named.SetComponentName(k, name)
    for i in range(grid.GetNumberOfPoints()):
        named.InsertNextTuple3(i, 0, 1)
    grid.GetPointData().AddArray(named)
    time = vtk.vtkDoubleArray()
    time.SetName("TIME")
    time.InsertNextValue(0.25)
    grid.GetFieldData().AddArray(time)


def vtu_files(grid, folder):
    for mode in ("ascii", "binary", "raw", "base64"):
        for compressor in ("", "zlib", "lz4", "lzma"):
            for header in (32, 64):
                for big in (False, True):
                    if mode == "ascii" and (header, big, compressor) != (32, False, ""):
                        continue
                    name = f"{mode}-{compressor or 'plain'}-{header}-{'big' if big else 'little'}.vtu"
                    write_vtu(grid, folder / name, mode, compressor, header, big)
                    yield name, compressor in ("lz4", "lzma")


def write_vtu(grid, path, mode, compressor, header, big):
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "base64")
    {"": writer.SetCompressorTypeToNone, "zlib": writer.SetCompressorTypeToZLib, "lz4": writer.SetCompressorTypeToLZ4,
     "lzma": writer.SetCompressorTypeToLZMA}[compressor]()
    writer.SetBlockSize(1024)
    writer.SetHeaderType(header)
    writer.SetByteOrder(0 if big else 1)
    assert writer.Write() == 1, path


def legacy_files(grid, folder):
    for binary in (False, True):
        for version in (42, 51):
            name = f"legacy-{'binary' if binary else 'ascii'}-{version}.vtk"
            writer = vtk.vtkUnstructuredGridWriter()
            writer.SetFileName(str(folder / name))
            writer.SetInputData(grid)
            writer.SetFileType(vtk.VTK_BINARY if binary else vtk.VTK_ASCII)
            if hasattr(writer, "SetFileVersion"):
                writer.SetFileVersion(version)
            writer.SetHeader("")
            assert writer.Write() == 1, name
            yield name


def gmsh_files(grid, folder):
    """By meshio, and version 1, which nobody writes any more, by hand."""
    points = [grid.GetPoint(i) for i in range(grid.GetNumberOfPoints())]
    cells = {4: [], 3: []}
    for i in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(i)
        cells[cell.GetNumberOfPoints()].append([cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())])
    lines = ["$NOD", str(len(points))] + [f"{i + 1} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(points)]
    lines += ["$ENDNOD", "$ELM", str(len(cells[3]) + len(cells[4]))]
    for nodes, kind in ((3, 2), (4, 4)):
        lines += [f"{len(lines)} {kind} 1 1 {nodes} " + " ".join(str(n + 1) for n in c) for c in cells[nodes]]
    (folder / "gmsh-1.msh").write_text("\n".join(lines + ["$ENDELM", ""]))
    yield "gmsh-1.msh"
    try:
        import meshio
        import numpy
    except ImportError:
        return
    blocks = [("triangle", numpy.array(cells[3])), ("tetra", numpy.array(cells[4]))]
    for version in ("2.2", "4.0", "4.1"):  # meshio writes one kind of cells in 4.1
        mesh = meshio.Mesh(numpy.array(points), blocks[1:] if version == "4.1" else blocks)
        for binary in (False, True):
            name = f"gmsh-{version}-{'binary' if binary else 'ascii'}.msh"
            with contextlib.redirect_stdout(sys.stderr):
                meshio.gmsh.write(str(folder / name), mesh, version, binary=binary)
            yield name


def other_cells(folder):
    """Hexahedra beside and instead of tetrahedra, tetrahedra with nodes on their edges."""
    points = vtk.vtkPoints()
    for corner in range(8):
        points.InsertNextPoint(corner & 1, corner >> 1 & 1, corner >> 2)
    for ends in ((0, 1), (1, 2), (0, 2), (0, 4), (1, 4), (2, 4)):
        points.InsertNextPoint(*[sum(points.GetPoint(e)[d] for e in ends) / 2 for d in range(3)])
    for name, cells in (("hexahedra.vtu", [(vtk.VTK_VOXEL, range(8))]),
                        ("mixed.vtu", [(vtk.VTK_VOXEL, range(8)), (vtk.VTK_TETRA, (0, 1, 2, 4)), (vtk.VTK_TETRA, (1, 0, 4, 2))]),
                        ("quadratic.vtu", [(vtk.VTK_QUADRATIC_TETRA, (0, 1, 2, 4, 8, 9, 10, 11, 12, 13))])):
        grid = vtk.vtkUnstructuredGrid()
        grid.SetPoints(points)
        for kind, nodes in cells:
            grid.InsertNextCell(kind, len(nodes), list(nodes))
        write_vtu(grid, folder / name, "raw", "zlib", 64, False)


def surface_files(folder):
    """An ellipsoid of half axes 0.1, 0.2, 0.3, by Assimp from what VTK writes."""
    ball = vtk.vtkSphereSource()
    ball.SetRadius(1)
    ball.SetThetaResolution(24)
    ball.SetPhiResolution(24)
    turn = vtk.vtkTransform()
    turn.Scale(0.1, 0.2, 0.3)
    scaled = vtk.vtkTransformPolyDataFilter()
    scaled.SetTransform(turn)
    scaled.SetInputConnection(ball.GetOutputPort())
    scaled.Update()
    writer = vtk.vtkOBJWriter()
    writer.SetFileName(str(folder / "ball.obj"))
    writer.SetInputConnection(scaled.GetOutputPort())
    writer.Write()
    mass = vtk.vtkMassProperties()
    mass.SetInputConnection(scaled.GetOutputPort())
    mass.Update()
    extent = [scaled.GetOutput().GetBounds()[2 * d + 1] - scaled.GetOutput().GetBounds()[2 * d] for d in range(3)]
    x, y, z = extent
    yield "ball.obj", {"surface": mass.GetVolume(), "size": [x, y, z]}
    for name, scale, size in (("ball.glb", 1, [x, z, y]), ("ball.gltf", 1, [x, z, y]), ("ball.3mf", 1e-3, [x, y, z])):
        kind = {"glb": "glb2", "gltf": "gltf2", "3mf": "3mf"}[name.rpartition(".")[2]]
        subprocess.run(["assimp", "export", "ball.obj", name, f"-f{kind}"], cwd=folder, check=True,
                       stdout=subprocess.DEVNULL)
        yield name, {"surface": mass.GetVolume() * scale**3, "size": [s * scale for s in size]}


def main():
    folder = pathlib.Path(sys.argv[1])
    grid, held = grid_of_tetrahedra()
    files, refused = {}, {"hexahedra.vtu": "1 hexahedra"}
    for name, other in vtu_files(grid, folder):
        if other:
            refused[name] = "zlib"
        else:
            files[name] = held
    for name in legacy_files(grid, folder):
        files[name] = held
    for name in gmsh_files(grid, folder):
        files[name] = held
    other_cells(folder)
    files["mixed.vtu"] = {"tetrahedra": 1, "nodes": 4, "volume": 1 / 6, "notes": ["1 hexahedra", "1 repeated"]}
    files["quadratic.vtu"] = {"tetrahedra": 1, "nodes": 4, "volume": 1 / 6, "notes": ["only the corners"]}
    files.update(surface_files(folder))
    print(json.dumps({"files": files, "refused": refused}))


if __name__ == "__main__":
    main()
