"""Mesh files of other programs, in, and what is exported, out: with VTK on the other side."""

import json
import random
import re

from harness import SCENE, case, expect, with_vtk


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


# A held bar pressed on the ground, and a column that stands there: its stress and forces are known.
COLUMN = SCENE.replace("duration: 0.3", "duration: 1.2") + """\
bodies:
  - name: column
    shape: {bar: {size: [0.04, 0.04, 0.08], cells: [2, 2, 4]}}
    pose: {position: [0.3, 0, 0]}
    material: {youngs_modulus: 4.0e4, poisson_ratio: 0.0, density: 1000, damping_beta: 0.02}
    friction: 0.0
"""
WEIGHT = 1000 * 9.81 * 0.04**2 * 0.08


def run_column(context):
    context.succeeds(["run", context.file("scene.yaml", COLUMN), "--pictures", "0", "--out", context.out])


@case
def export_writes_what_vtk_reads(context):
    run_column(context)
    context.succeeds(["export", context.out, "--every", "2"])
    series = json.loads(with_vtk("vtk_series.py", context.out / "vtu"))
    expect({k: len(v) for k, v in series.items()} == {"mesh": 60, "surface": 60, "contacts": 30}, f"{series.keys()}")
    for steps in series.values():
        for s in steps:
            expect(abs(s["time"] - s["timestep"]) < 1e-12, f"time {s['time']} at {s['timestep']}")
    times = [s["timestep"] for s in series["contacts"]]
    expect(all(abs(t - 0.02 - 0.04 * i) < 1e-9 for i, t in enumerate(times)), f"times {times}")
    column = [s for s in series["mesh"] if s["name"] == "column"][-1]
    expect(column["types"] == [10] and column["cells"] == 96 and column["points"] == 45, f"{column}")
    pressed = column["point"]["contact_force"]["sum"]
    expect(near(pressed[2], WEIGHT, 1e-3) and abs(pressed[0]) < 1e-3, f"the ground carries {pressed} of {WEIGHT} N")
    middle = -WEIGHT / 0.04**2 / 2  # the mean over the height, but for the strain of 1 %
    stress = column["mean_stress"]
    expect(near(stress[2], middle, 0.02), f"stress {stress}, and {middle} Pa would be right")
    expect(all(abs(stress[c]) < 0.01 * abs(middle) for c in (0, 1, 3, 4, 5)), f"stress {stress}")
    moved = column["point"]["displacement"]["sum"][2] / 45  # nodes on five levels
    sunk = -9810 / 4.0e4 * sum(0.08 * z - z * z / 2 for z in (0, 0.02, 0.04, 0.06, 0.08)) / 5
    expect(near(moved, sunk, 0.01), f"sunk by {moved} m, and {sunk} m would be right")
    recorded, made = column["point"]["von_mises"], column["cell"]["von_mises"]
    expect(near(max(made["high"]), max(recorded["high"]), 0.2), f"recorded {recorded['high']}, made {made['high']}")
    tool = [s for s in series["mesh"] if s["part"] == 0][-1]
    contacts = series["contacts"][-1]["point"]
    for c in range(3):
        both = pressed[c] + tool["point"]["contact_force"]["sum"][c]
        expect(abs(contacts["force"]["sum"][c] - both) < 1e-4, f"contacts {contacts['force']['sum']}, nodes {both}")
    expect(contacts["body"]["high"] == [1] and contacts["other"]["high"] == [-1], f"{contacts}")
    surface = [s for s in series["surface"] if s["part"] == 1][-1]
    expect(surface["types"] == [5] and surface["bounds"] == column["bounds"], f"{surface['bounds']} {column['bounds']}")


@case
def export_writes_surface_and_mesh_at_any_time(context):
    run_column(context)
    high = {}
    for time in ("0.6", "0.61", "0.62"):
        for ending in ("obj", "ply"):
            file = context.folder / f"surface.{ending}"
            context.succeeds(["export", context.out, "--surface", file, "--time", time, "--body", "column"])
            high[time, ending] = float(info_of(context, file)["size"].split()[4])
        expect(near(high[time, "obj"], high[time, "ply"]), f"{high}")
    between = (high["0.6", "obj"] + high["0.62", "obj"]) / 2
    expect(abs(high["0.61", "obj"] - between) < 1e-7 and between < 0.08, f"{high}")
    file = context.folder / "mesh.vtu"
    context.succeeds(["export", context.out, "--mesh", file])
    built = json.loads(with_vtk("vtk_series.py", file))
    expect(near(built["volume"], 0.08 * 0.06 * 0.08 + 0.04**2 * 0.08) and built["time"] is None, f"{built['volume']}")
    expect(built["cell"]["body"]["high"] == [1], f"{built['cell']}")
    context.succeeds(["export", context.out, "--mesh", file, "--time", "1.2", "--body", "column"])
    stands = json.loads(with_vtk("vtk_series.py", file))
    expect(near(stands["point"]["contact_force"]["sum"][2], WEIGHT, 1e-3), f"{stands['point']['contact_force']}")
    said = info_of(context, file)
    expect(said["tetrahedra"].startswith("96,") and said["nodes"].startswith("45,"), "its own file is read differently")


@case
def export_refuses_what_it_cannot_do(context):
    context.succeeds(["run", context.file("scene.yaml", SCENE), "--pictures", "0", "--out", context.folder / "run"])
    run = context.folder / "run"
    for arguments, words in ((["nowhere"], ["nowhere"]), ([run, "--time", "1"], ["--time"]),
                             ([run, "--surface", "s.obj", "--time", "9"], ["--time", "0.3"]),
                             ([run, "--surface", "s.obj", "--time", "-1"], ["--time"]),
                             ([run, "--surface", "s.obj", "--time", "nan"], ["--time"]),
                             ([run, "--surface", "s.glb"], ["--surface", ".obj"]), ([run, "--mesh", "m.msh"], ["--mesh", ".vtu"]),
                             ([run, "--surface", "s.obj", "--body", "nobody"], ["--body", "nobody"]),
                             ([run, "--parts", "mesh,bones"], ["--parts", "bones"]), ([run, "--from", "5"], ["--from"]),
                             ([run, "--every", "0"], ["--every"]),
                             ([run, "--surface", "s.obj", "--from", "0.1"], ["--from", "series"]),
                             ([run, "--surface", "s.obj", "--out", "d"], ["--out", "series"])):
        context.rejects(["export", *arguments], words)
    whole = (run / "recording.palpate").read_bytes()
    damaged = context.file("damaged/recording.palpate", b"PALPATE1" + whole[8:].replace(b"scene", b"xxxxx")[:900])
    context.rejects(["export", damaged.parent], ["recording.palpate"])
    context.rejects(["export", context.file("other/recording.palpate", b"PALPATE0" + whole[8:])], ["no recording"])
    cut = context.file("cut/recording.palpate", whole[:int(0.3 * len(whole))])
    code, output, errors = context.run(["export", cut.parent, "--out", context.out])
    expect(code == 0 and "incomplete" in errors, f"exit code {code}: {errors}")
    expect(0 < int(output.split()[0]) < 15, output)
    chance = random.Random(3)
    for _ in range(60):
        now = bytearray(whole)
        now[chance.randrange(len(whole) if chance.random() < 0.3 else 4000)] = chance.randrange(256)
        code, _, errors = context.run(["export", context.file("wrong.palpate", bytes(now)), "--out", context.out, "--to", "0.05"])
        expect(code in (0, 2) and "Error" not in errors, f"exit code {code}: {errors[:200]}")
