"""Mesh files of other programs, in, and what is exported, out: with VTK on the other side."""

import json
import random
import re

from harness import case, expect, with_vtk


def info_of(context, path):
    """What `mesh info` says: {name: text}; a name that comes more than once has its texts joined."""
    said = {}
    for line in context.succeeds(["mesh", "info", path]).splitlines():
        name, text = line[:22].strip(), line[22:].strip()
        said[name] = said[name] + "; " + text if name in said else text
    return said


def near(a, b, relative=1e-5):
    return abs(a - b) <= relative * abs(b)


def check_held(name, said, held):
    numbers = [float(x) for x in re.findall(r"[-+0-9.e]+", said["size"].replace("x", " "))]
    if "surface" in held:
        expect(near(float(said["volume"].split()[0]), held["surface"]), f"{name}: volume {said['volume']}")
        expect(all(near(a, b, 1e-4) for a, b in zip(numbers, held["size"])), f"{name}: size {said['size']}")
        return
    expect(said["tetrahedra"].startswith(f"{held['tetrahedra']},"), f"{name}: tetrahedra {said['tetrahedra']}")
    expect(said["nodes"].startswith(f"{held['nodes']},"), f"{name}: nodes {said['nodes']}")
    expect(near(float(said["volume"].split(",")[0]), held["volume"]), f"{name}: volume {said['volume']}")
    for words in held.get("notes", []):
        expect(words in said.get("note", ""), f"{name}: no note on '{words}': {said.get('note')}")
    expect(held.get("notes") or "note" not in said, f"{name}: note {said.get('note')}")


@case
def meshes_of_other_programs_are_read(context):
    wanted = json.loads(with_vtk("vtk_meshes.py", context.folder))
    expect(len(wanted["files"]) > 30, f"only {len(wanted['files'])} files were written")
    for name, held in wanted["files"].items():
        check_held(name, info_of(context, context.folder / name), held)
    for name, words in wanted["refused"].items():
        context.rejects(["mesh", "info", context.folder / name], [name, words])


@case
def damaged_meshes_are_refused(context):
    wanted = json.loads(with_vtk("vtk_meshes.py", context.folder))
    chance = random.Random(5)
    for name in ("raw-zlib-32-little.vtu", "base64-plain-64-big.vtu", "binary-zlib-64-little.vtu", "legacy-binary-51.vtk",
                 "legacy-binary-42.vtk", "gmsh-2.2-binary.msh", "gmsh-4.0-binary.msh", "gmsh-4.1-binary.msh", "ball.glb",
                 "ball.3mf"):
        if name not in wanted["files"]:
            continue
        whole = (context.folder / name).read_bytes()
        for share in (0.02, 0.3, 0.6):
            cut = context.file("cut." + name.rpartition(".")[2], whole[:int(share * len(whole))])
            context.rejects(["mesh", "info", cut], [cut])
        for _ in range(4):  # may happen to be a mesh
            bytes_now = bytearray(whole)
            for _ in range(3):
                bytes_now[chance.randrange(len(whole))] = chance.randrange(256)
            code, _, errors = context.run(["mesh", "info", context.file("damaged." + name.rpartition(".")[2], bytes(bytes_now))])
            expect(code in (0, 2) and len(errors.splitlines()) <= 1, f"{name}: exit code {code}: {errors[:200]}")


@case
def run_takes_a_mesh_of_tetrahedra(context):
    with_vtk("vtk_meshes.py", context.folder)
    context.file("scene.yaml", """\
palpate: 1
name: own
duration: 0.1
visual: {step: 0.02}
tool:
  shape: {tetrahedra_file: mixed.vtu}
  material: {youngs_modulus: 2.0e6, poisson_ratio: 0.4, density: 100}
  handles:
    top: {region: {halfspace: {point: [0, 0, 0.9], normal: [0, 0, 1]}}, mass: 0.5}
""")
    code, _, errors = context.run(["run", context.folder / "scene.yaml", "--out", context.out])
    expect(code == 0 and "1 hexahedra are left out" in errors, f"exit code {code}: {errors}")
    expect(context.summary()["mesh"]["tetrahedra"] == 1, "another mesh was taken")
