"""Bad input: each case is one clear line on standard error, exit code 2, and nothing that looks like a result."""

import os
import re
import json
import signal
import subprocess
import time

from harness import SCENE, case, expect, rejected_variants

TETRAHEDRON = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""


def run_scene(context, text):
    return ["run", context.file("scene.yaml", text), "--out", context.out]


def spoiled(key, value, *words):
    """The good scene with one value replaced; the line names the file and the key."""
    text, count = re.subn(rf"\b{key}: (\[[^]]*\]|[^,}}\n]+)", f"{key}: {value}", SCENE, count=1)
    assert count, key
    return lambda context: (run_scene(context, text), ("scene.yaml", key, *words))


def replaced(old, new, *words):
    assert old in SCENE, old
    return lambda context: (run_scene(context, SCENE.replace(old, new, 1)), ("scene.yaml", *words))


def text_scene(text, *words):
    return lambda context: (run_scene(context, text), ("scene.yaml", *words))


def option(*arguments):
    """The good scene with a bad option; the line names the option."""
    return lambda context: (run_scene(context, SCENE) + list(arguments), [arguments[0]])


def surface_scene(name, content):
    """A scene whose tool is a surface from a file; the line names that file."""
    scene = SCENE.replace("{bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}", f"{{surface: {{file: {name}, size: 0.1}}}}")

    def make(context):
        context.file(name, content)
        return run_scene(context, scene), [name]

    return make


BODIES = """\
bodies:
  - name: stone
    rigid: true
    density: 2600
    shape: {sphere: {radius: 0.02}}
    pose: {position: [0.2, 0, 0]}
obstacles:
"""


def contact_scene(old, new, *words):
    """The good scene with a rigid body, a mesh obstacle and a pair, of which one thing is wrong."""
    text = SCENE.replace("obstacles:\n", BODIES) + """\
  - {name: plate, mesh: {shape: {box: {size: [0.1, 0.1, 0.002]}}, pose: {position: [0, 0.3, 0]}}}
contact:
  pairs:
    - {between: [stone, plate], friction: 0.2}
  thickness: 0.0002
"""
    assert old in text, old
    return text_scene(text.replace(old, new, 1), *words)


ALIASES = "".join(f"{b}: &{b} [{', '.join(['*' + a] * 10)}]\n" for a, b in zip("abcdefghijkl", "bcdefghijklm"))

rejected_variants("bad-scene", {
    "missing": lambda c: (["run", "nowhere.yaml", "--out", c.out], ["nowhere.yaml"]),
    "is-a-folder": lambda c: (["run", c.folder, "--out", c.out], [c.folder.name]),
    "empty": text_scene(""),
    "malformed": text_scene("tool: {shape: [\n  - ] }}\n", "line"),
    "not-a-map": text_scene("- 1\n- 2\n"),
    "binary": text_scene(bytes(range(256)) * 40),
    "deep": text_scene("[" * 100000),
    "alias-bomb": text_scene("a: &a [x, x, x, x, x, x, x, x, x, x]\n" + ALIASES),
    "unknown-key": replaced("density:", "densty:", "densty", "density"),
    "duplicate-key": replaced("duration:", "duration: 1.0\nduration:", "duration"),
    "required-key": replaced("name: press\n", "", "name"),
    "wrong-type": spoiled("density", "heavy"),
    "negative-density": spoiled("density", "-1000"),
    "zero-density": spoiled("density", "0"),
    "nan-density": spoiled("density", ".nan"),
    "infinite-density": spoiled("density", ".inf"),
    "negative-mass": spoiled("mass", "-0.02"),
    "poisson-one-half": spoiled("poisson_ratio", "0.5"),
    "poisson-above-one-half": spoiled("poisson_ratio", "0.7"),
    "negative-stiffness": spoiled("youngs_modulus", "-1"),
    "zero-step": replaced("visual: {step: 0.02}", "visual: {step: 0}", "visual.step"),
    "negative-step": replaced("visual: {step: 0.02}", "visual: {step: -0.01}", "visual.step"),
    "step-not-a-multiple": replaced("visual: {step: 0.02}", "visual: {step: 0.0205}", "visual.step"),
    "negative-friction": spoiled("friction", "-0.5"),
    "zero-cells": spoiled("cells", "[0, 3, 4]"),
    "endless-cells": spoiled("cells", "[100000, 100000, 100000]"),
    "too-many-cells": replaced("cells: [2, 2, 2]", "cells: [200, 200, 200]"),
    "zero-duration": spoiled("duration", "0"),
    "endless-duration": spoiled("duration", "1e300"),
    "too-many-ticks": replaced("duration: 0.3", "duration: 3600\nhaptic: {step: 0.00001}", "yaml: duration: 3600 s"),
    "time-goes-back": replaced("t: 0.2", "t: 0.0"),
    "no-handles": replaced(SCENE[SCENE.index("    top:"):SCENE.index("obstacles:")], "    {}\n", "handles"),
    "region-without-nodes": replaced("point: [0, 0, 0.079]", "point: [0, 0, 5]", "top"),
    "mesh-missing": replaced("{bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}", "{surface: {file: nowhere.obj}}",
                             "nowhere.obj"),
    "mesh-empty": surface_scene("empty.obj", ""),
    "mesh-single-triangle": surface_scene("single.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    "mesh-nan": surface_scene("nan.obj", TETRAHEDRON.replace("v 0 0 1", "v 0 0 nan")),
    "mesh-flat": surface_scene("flat.obj", TETRAHEDRON.replace("v 0 0 1", "v 1 1 0")),
})


def attached_scene(attachment, *words):
    """The good scene with an attachment of the tool that is wrong."""
    return replaced("  friction: 0.5\n", f"  friction: 0.5\n  attachments: {attachment}\n", *words)


LOWER = "region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}"

GLUED_PAIR = f"""\
bodies:
  - name: upper
    shape: {{bar: {{size: [0.02, 0.02, 0.02], cells: [2, 2, 2]}}}}
    pose: {{position: [0, 0, 1]}}
    attachments: {{joint: {{{LOWER}, to: lower}}}}
  - name: lower
    shape: {{bar: {{size: [0.02, 0.02, 0.02], cells: [2, 2, 2]}}}}
    pose: {{position: [0, 0, 0.98]}}
    attachments: {{joint: {{region: {{halfspace: {{point: [0, 0, 0.019], normal: [0, 0, 1]}}}}, to: upper}}}}
"""

rejected_variants("bad-attachment", {
    "not-a-map": attached_scene("[root]", "attachments"),
    "no-region": attached_scene("{root: {}}", "attachments.root", "region"),
    "unknown-key": attached_scene(f"{{root: {{{LOWER}, stifness: 1}}}}", "stifness", "stiffness"),
    "zero-stiffness": attached_scene(f"{{root: {{{LOWER}, stiffness: 0}}}}", "attachments.root.stiffness"),
    "negative-damping": attached_scene(f"{{root: {{{LOWER}, stiffness: 1, damping: -1}}}}", "damping"),
    "damping-alone": attached_scene(f"{{root: {{{LOWER}, damping: 1}}}}", "damping", "stiffness"),
    "motion-without-keyframes": attached_scene(f"{{root: {{{LOWER}, motion: {{}}}}}}", "motion", "keyframes"),
    "motion-from-elsewhere": attached_scene(f"{{root: {{{LOWER}, motion: {{keyframes: [{{t: 0, position: [0, 0, 1]}}]}}}}}}",
                                            "motion", "first keyframe"),
    "motion-that-jumps": attached_scene(
        f"{{root: {{{LOWER}, motion: {{period: 2, keyframes: [{{t: 0}}, {{t: 1, position: [0, 0, 1]}}]}}}}}}", "motion", "jumps"),
    "motion-longer-than-its-period": attached_scene(
        f"{{root: {{{LOWER}, motion: {{period: 1, keyframes: [{{t: 0}}, {{t: 2}}]}}}}}}", "motion", "period"),
    "no-node": attached_scene("{root: {region: {sphere: {center: [0, 0, 5], radius: 0.1}}}}", "root", "no node", "0.08"),
    "no-surface": attached_scene("{root: {region: {sphere: {center: [0, 0, 0.04], radius: 0.01}}, stiffness: 1}}",
                                 "root", "no part"),
    "all-nodes": attached_scene("{root: {region: {sphere: {center: [0, 0, 0], radius: 1}}}}", "root", "every node"),
    "the-handles-nodes": attached_scene("{root: {region: {halfspace: {point: [0, 0, 0.079], normal: [0, 0, 1]}}}}",
                                        "top", "fixed"),
    "twice": attached_scene(f"{{root: {{{LOWER}}}, again: {{{LOWER}}}}}", "again", "another"),
    "live": text_scene(SCENE.replace("  friction: 0.5\n", f"  friction: 0.5\n  attachments: {{root: {{{LOWER}}}}}\n") + "method: live\n",
                       "method", "hsl"),
    "rigid": contact_scene("rigid: true", "rigid: true\n    attachments: {}", "attachments"),
    "to-nobody": attached_scene(f"{{root: {{{LOWER}, to: tol}}}}", "root", "to", "no body", '"tool"'),
    "to-itself": attached_scene(f"{{root: {{{LOWER}, to: tool}}}}", "root", "itself"),
    "to-with-stiffness": attached_scene(f"{{root: {{{LOWER}, to: tool, stiffness: 1}}}}", "root", "stiffness"),
    "to-no-node": attached_scene("{root: {region: {sphere: {center: [0, 0, 5], radius: 0.1}}, to: tool}}", "root", "no node"),
    "to-what-is-far": contact_scene("  friction: 0.5\n", f"  friction: 0.5\n  attachments: {{root: {{{LOWER}, to: stone}}}}\n",
                                    "root", "from stone", "mean edge"),
    "in-a-circle": text_scene(SCENE.partition("obstacles:\n")[0] + GLUED_PAIR, "one of the two is enough"),
    "glued-and-live": text_scene(SCENE.partition("obstacles:\n")[0] + GLUED_PAIR.replace("lower", "tool", 1) + "method: live\n",
                                 "method", "glued"),
})

rejected_variants("bad-contact", {
    "pair-unknown-name": contact_scene("[stone, plate]", "[stone, plat]", "pairs", "plat"),
    "pair-of-one": contact_scene("[stone, plate]", "[stone]", "pairs", "between"),
    "pair-of-obstacles": contact_scene("[stone, plate]", "[ground, plate]", "pairs"),
    "pair-rigid-self": contact_scene("[stone, plate]", "[stone, stone]", "pairs"),
    "pair-twice": contact_scene("  thickness", "    - {between: [plate, stone], friction: 0.3}\n  thickness", "pairs"),
    "pair-negative-friction": contact_scene("friction: 0.2", "friction: -0.2", "pairs", "friction"),
    "pair-without-friction": contact_scene(", friction: 0.2", "", "pairs", "friction"),
    "thickness-zero": contact_scene("thickness: 0.0002", "thickness: 0", "contact.thickness"),
    "thickness-too-large": contact_scene("thickness: 0.0002", "thickness: 0.5", "contact.thickness"),
    "thickness-nan": contact_scene("thickness: 0.0002", "thickness: .nan", "contact.thickness"),
    "recovery-speed-zero": contact_scene("thickness: 0.0002", "max_recovery_speed: 0", "contact.max_recovery_speed"),
    "rigid-with-handles": contact_scene("rigid: true", "rigid: true\n    handles: {}", "handles"),
    "rigid-with-material": contact_scene("rigid: true", "rigid: true\n    material: {density: 1}", "material"),
    "rigid-with-tetrahedra": contact_scene("rigid: true", "rigid: true\n    tetrahedra: 100", "tetrahedra"),
    "rigid-bar": contact_scene("{sphere: {radius: 0.02}}", "{bar: {size: [0.1, 0.1, 0.1], cells: [1, 1, 1]}}", "shape"),
    "rigid-negative-density": contact_scene("density: 2600", "density: -1", "density"),
    "soft-with-density": contact_scene("rigid: true", "rigid: false", "density"),
    "tool-rigid": replaced("  friction: 0.5", "  rigid: true", "rigid"),
    "names-twice": contact_scene("name: plate", "name: stone", "stone"),
    "mesh-bar": contact_scene("{box: {size: [0.1, 0.1, 0.002]}}", "{bar: {size: [0.1, 0.1, 0.1], cells: [1, 1, 1]}}",
                              "mesh"),
    "mesh-open": lambda c: (c.file("sheet.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"), contact_scene(
        "{box: {size: [0.1, 0.1, 0.002]}}", "{surface: {file: sheet.obj}}", "sheet.obj", "closed")(c))[1],
    "mesh-missing": contact_scene("{box: {size: [0.1, 0.1, 0.002]}}", "{surface: {file: nowhere.obj}}", "nowhere.obj"),
})


def stress_option(*arguments):
    return lambda c: (["stress", c.file("scene.yaml", SCENE), "--out", c.out, *arguments], [arguments[0]])


rejected_variants("bad-stress", {
    "missing": lambda c: (["stress", "nowhere.yaml", "--steps", "10", "--out", c.out], ["nowhere.yaml"]),
    "bad-scene": lambda c: (["stress", c.file("scene.yaml", SCENE.replace("density:", "densty:", 1)), "--out", c.out],
                            ["scene.yaml", "densty"]),
    "steps-zero": stress_option("--steps", "0"),
    "steps-negative": stress_option("--steps", "-5"),
    "steps-word": stress_option("--steps", "many"),
    "steps-fraction": stress_option("--steps", "1.5"),
    "steps-endless": stress_option("--steps", "99999999999999"),
    "seed": stress_option("--seed", "x"),
    "hand": stress_option("--hand", "third"),
    "speed": stress_option("--speed", "-1", "--hand", "ride"),
    "seeds-wild": stress_option("--seeds", "3"),
    "seeds-and-steps": stress_option("--seeds", "3", "--steps", "10", "--hand", "ride"),
    "static-wild": stress_option("--static"),
    "duration": stress_option("--duration", "1"),
})

rejected_variants("bad-option", {
    "no-scene": lambda c: (["run", "--out", c.out], []),
    "unknown": option("--colour", "blue"),
    "duration-nan": option("--duration", "nan"),
    "duration-inf": option("--duration", "inf"),
    "duration-negative": option("--duration", "-1"),
    "duration-word": option("--duration", "long"),
    "visual-dt-zero": option("--visual-dt", "0"),
    "visual-dt-nan": option("--visual-dt", "nan"),
    "visual-dt-not-a-multiple": option("--visual-dt", "0.0105"),
    "latency-negative": option("--latency", "-1"),
    "jitter-negative": option("--jitter", "-1"),
    "method": option("--method", "magic"),
    "handle": option("--handle", "tail"),
    "device": option("--device", "wand"),
    "seed": option("--seed", "x"),
    "seed-negative": option("--seed", "-1"),
    "seed-too-large": option("--seed", str(2**64)),
    "subcommand": lambda c: (["fly"], ["fly"]),
    "no-subcommand": lambda c: ([], []),
    "out-below-a-file": lambda c: (["run", c.file("s.yaml", SCENE), "--out", c.file("taken", "") / "out"], ["taken"]),
    "out-is-a-file": lambda c: (["run", c.file("s.yaml", SCENE), "--out", c.file("taken", "")], ["taken"]),
    "check-time-nan": lambda c: (["check", "linearization", c.file("s.yaml", SCENE), "--at", "nan", "--out", c.out],
                                 ["--at"]),
    "check-time-negative": lambda c: (["check", "linearization", c.file("s.yaml", SCENE), "--at", "-1", "--out", c.out],
                                      ["--at"]),
    "validate-missing": lambda c: (["validate", "nowhere.yaml"], ["nowhere.yaml"]),
    "one-d-missing": lambda c: (["one-d", "--config", "nowhere.yaml", "--out", c.out], ["nowhere.yaml"]),
    "one-d-unknown-key": lambda c: (["one-d", "--config", c.file("c.yaml", "handle_mas: 1\n"), "--out", c.out],
                                    ["c.yaml", "handle_mas", "handle_mass"]),
    "one-d-negative-mass": lambda c: (["one-d", "--config", c.file("c.yaml", "tool_mass: -1\n"), "--out", c.out],
                                      ["c.yaml", "tool_mass"]),
    "one-d-nan": lambda c: (["one-d", "--config", c.file("c.yaml", "spring_damping: .nan\n"), "--out", c.out],
                            ["c.yaml", "spring_damping"]),
    "one-d-out": lambda c: (["one-d", "--out", c.file("taken", "") / "out"], ["taken"]),
})


@case
def bad_option_out_empty(context):
    context.rejects(["run", context.file("scene.yaml", SCENE), "--out", ""], ["--out"])


@case
def bad_option_empty(context):
    """Not taken as not given, nor is the next word taken instead."""
    scene = context.file("scene.yaml", SCENE)
    surface = context.file("t.obj", TETRAHEDRON)
    commands = [(["run", scene, "--out", context.out], name)
                for name in ("--duration", "--latency", "--jitter", "--seed", "--tetrahedra", "--compare", "--visual-dt",
                             "--threads", "--handle")]
    commands += [(["mesh", "embed", surface], "--size"), (["one-d", "--out", context.out], "--config"),
                 (["check", "linearization", scene, "--out", context.out], "--at")]
    for command, name in commands:
        context.rejects([*command, name, ""], [f"{name}: must not be empty"])
    context.rejects(["run", scene, "--out", context.out, "--duration=", "0.1"], ["--duration: must not be empty"])
    context.rejects(["validate", ""], ["must not be empty"])


@case
def bad_output_is_full(context):
    """What cannot be written to standard output is a failure; who reads no further is none."""
    scene = context.file("scene.yaml", SCENE)
    surface = context.file("t.obj", TETRAHEDRON)
    for arguments in (["completion", "bash"], ["mesh", "info", surface], ["validate", scene], ["devices"], ["--help"],
                      ["--version"], ["manual"], ["schema", "scene"]):
        with open("/dev/full", "w") as full:
            done = subprocess.run([context.program, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
        expect(done.returncode == 1, f"{arguments}: exit code {done.returncode} and not 1")
        expect(done.stderr == "palpate: cannot write to standard output: No space left on device\n",
               f"{arguments}: {done.stderr!r}")


@case
def bad_scene_without_equilibrium(context):
    """A body that starts settled and falls for as long as anybody would wait: which motion is free."""
    text = SCENE.replace("obstacles:\n", """\
bodies:
  - name: cushion
    shape: {bar: {size: [0.05, 0.05, 0.05], cells: [1, 1, 1]}}
    pose: {position: [10, 0, 90]}
    start: settled
obstacles:
""", 1)
    expect("cushion" in text, "the scene has no obstacles to put a body before")
    context.rejects(["validate", context.file("scene.yaml", text)], ["scene.yaml", "cushion", "moves freely along (0, 0, -1)"])


@case
def bad_option_out_not_writable(context):
    locked = context.folder / "locked"
    locked.mkdir(mode=0o500)
    if os.geteuid() == 0:
        locked = "/proc"  # root may write anywhere but there
    context.rejects(["run", context.file("scene.yaml", SCENE), "--out", f"{locked}/out"], [f"{locked}/out"])


def surface(name, content):
    return lambda c: (["mesh", "embed", c.file(name, content), "--tets", "100", "--out", c.out / "tool.vtk"], [name])


BINARY_STL_THAT_PROMISES_TOO_MUCH = b"\0" * 80 + (0xFFFFFFFF).to_bytes(4, "little") + b"\0" * 50

rejected_variants("bad-mesh", {
    "missing": lambda c: (["mesh", "embed", "nowhere.obj", "--tets", "100", "--out", c.out / "tool.vtk"], ["nowhere.obj"]),
    "unknown-format": surface("shape.xyz", "1 2 3\n"),
    "empty": surface("empty.obj", ""),
    "without-faces": surface("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
    "single-triangle": surface("single.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    "flat": surface("flat.obj", TETRAHEDRON.replace("v 0 0 1", "v 1 1 0")),
    "one-point": surface("point.obj", re.sub(r"v .*", "v 1 1 1", TETRAHEDRON)),
    "nan": surface("nan.obj", TETRAHEDRON.replace("v 0 0 1", "v 0 0 nan")),
    "infinite": surface("inf.obj", TETRAHEDRON.replace("v 0 0 1", "v 0 0 1e999")),
    "index-out-of-range": surface("range.obj", TETRAHEDRON.replace("f 1 4 3", "f 1 4 9")),
    "truncated-ply": surface("cut.ply", "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"),
    "truncated-off": surface("cut.off", "OFF\n4 4 6\n0 0 0\n"),
    "truncated-stl": surface("cut.stl", BINARY_STL_THAT_PROMISES_TOO_MUCH),
    "tets-zero": lambda c: (["mesh", "embed", c.file("t.obj", TETRAHEDRON), "--tets", "0", "--out", c.out / "t.vtk"],
                            ["--tets"]),
    "tets-negative": lambda c: (["mesh", "embed", c.file("t.obj", TETRAHEDRON), "--tets", "-5", "--out",
                                 c.out / "t.vtk"], ["--tets"]),
    "size-zero": lambda c: (["mesh", "embed", c.file("t.obj", TETRAHEDRON), "--size", "0"], ["--size"]),
    "make-cells": lambda c: (["mesh", "make", "box", "--cells", "3", "4", "5", "--out", c.out / "x.obj"], ["--cells"]),
    "make-kind": lambda c: (["mesh", "make", "sphere", "--out", c.out / "x.vtu"],
                            ["--out", "end in .obj, .stl, .ply or .off"]),
    "tets-a-word": lambda c: (["mesh", "embed", c.file("t.obj", TETRAHEDRON), "--tets", "many"], ["--tets", "auto"]),
})


@case
def bad_mesh_a_million_triangles(context):
    """Loads, or meets a stated limit; in bounded time and memory either way."""
    side = 708  # 2 * 708 * 708 triangles on a torus
    from math import cos, pi, sin
    lines = []
    for i in range(side):
        for j in range(side):
            a, b = 2 * pi * i / side, 2 * pi * j / side
            ring = 1 + 0.4 * cos(b)
            lines.append(f"v {ring * cos(a):.6f} {ring * sin(a):.6f} {0.4 * sin(b):.6f}")
    for i in range(side):
        for j in range(side):
            p, q = i * side + j + 1, (i + 1) % side * side + j + 1
            r, s = i * side + (j + 1) % side + 1, (i + 1) % side * side + (j + 1) % side + 1
            lines.append(f"f {p} {q} {s}\nf {p} {s} {r}")
    path = context.file("torus.obj", "\n".join(lines) + "\n")
    code, output, errors = context.run(["mesh", "info", path], timeout=120)
    if code == 2:
        expect(len(errors.splitlines()) == 1 and re.search(r"\d", errors), f"no stated limit: {errors!r}")
    else:
        expect(code == 0, f"exit code {code}: {errors!r}")
        expect(re.search(r"1[, ]?002[, ]?528", output), f"the triangle count is not reported: {output!r}")


def motion(content, *words):
    """The good scene moved by a recording."""
    return lambda c: (run_scene(c, SCENE) + ["--device", f"recorded:{c.file('motion.csv', content)}"],
                      ["motion.csv", *words])


MOTION_HEADER = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n"
MOTION_ROWS = "".join(f"{i / 1000},0,0,0.08,1,0,0,0\n" for i in range(100))

rejected_variants("bad-motion", {
    "empty": motion(""),
    "column-missing": motion("time_s,x_m,y_m,z_m\n0,0,0,0\n", "qw"),
    "not-a-number": motion(MOTION_HEADER + MOTION_ROWS.replace("0.05,0,0,0.08", "0.05,0,0,nan")),
    "infinite": motion(MOTION_HEADER + MOTION_ROWS.replace("0.05,0,0,0.08", "0.05,0,0,inf")),
    "time-stands-still": motion(MOTION_HEADER + MOTION_ROWS.replace("0.05,", "0.049,")),
    "zero-quaternion": motion(MOTION_HEADER + MOTION_ROWS.replace("0.05,0,0,0.08,1", "0.05,0,0,0.08,0")),
    "cut-off": motion(MOTION_HEADER + MOTION_ROWS[:-8]),
})


@case
def bad_end_killed_run_leaves_nothing(context):
    """A run that is killed leaves no summary or report."""
    process = context.start(run_scene(context, SCENE) + ["--duration", "600"])
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and not (context.out.exists() and any(context.out.iterdir())):
        time.sleep(0.05)
    time.sleep(0.3)
    expect(process.poll() is None, "a run of 600 s ended by itself")
    process.send_signal(signal.SIGKILL)
    process.communicate()
    context.no_complete_result()


def interrupted(context, arguments, ready, signals=(signal.SIGINT,)):
    """What a signal ends does so at once, as the signal would by itself (130 in a shell after Ctrl-C), and leaves
    nothing behind. ready() is true once the job is at work."""
    for sent in signals:
        before = sorted(context.folder.rglob("*"))
        process = context.start(arguments)
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline and process.poll() is None and not ready():
            time.sleep(0.02)
        time.sleep(0.3)
        expect(process.poll() is None, f"ended by itself with {process.returncode}")
        process.send_signal(sent)
        begin = time.monotonic()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        expect(time.monotonic() - begin < 2, f"took {time.monotonic() - begin:.1f} s to end")
        expect(process.returncode == -sent, f"exit code {process.returncode} after signal {sent}")
        left = [str(p) for p in sorted(context.folder.rglob("*")) if p not in before]
        expect(not left, f"left behind: {left}")


@case
def interrupted_study_leaves_nothing(context):
    """Ctrl-C during evaluate, and the building of a scene."""
    scene = context.file("scene.yaml", SCENE)
    soon = time.monotonic() + 0.5
    interrupted(context, ["evaluate", scene, "--duration", "60", "--out", context.out], lambda: time.monotonic() > soon)
    large = context.file("large.yaml", SCENE.replace(
        "{bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}", "{sphere: {radius: 0.05}}\n  tetrahedra: 200000"))
    soon = time.monotonic() + 1
    interrupted(context, ["validate", large], lambda: time.monotonic() > soon)


@case
def interrupted_stress_keeps_what_it_has(context):
    """Ctrl-C during stress: it judges and writes the steps that it took."""
    scene = context.file("scene.yaml", SCENE)
    process = subprocess.Popen([context.program, "stress", scene, "--steps", "1000000", "--out", context.out],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    expect(process.returncode == 130, f"exit code {process.returncode}")
    steps = json.loads((context.out / "summary.json").read_text())["steps"]
    expect(0 < steps < 1000000, f"{steps} steps")


@case
def interrupted_mesh_leaves_nothing(context):
    """Ctrl-C while meshes are made."""
    sphere = context.file("sphere.obj", "")
    context.succeeds(["mesh", "make", "sphere", "--out", sphere])
    interrupted(context, ["mesh", "stiffness", sphere, "--tets", "20000", "100000"], lambda: True)
    interrupted(context, ["mesh", "embed", sphere, "--tets", "200000", "--out", context.folder / "sphere.vtk"],
                lambda: True)


@case
def bad_disk_full(context):
    """What cannot be written is said as the system says it."""
    (context.folder / "sphere.obj.part").symlink_to("/dev/full")
    context.rejects(["mesh", "make", "sphere", "--out", context.folder / "sphere.obj"], ["No space left on device"])


rejected_variants("bad-bounds", {
    # 51 obstacles of about 200,000 triangles
    "obstacle-triangles": text_scene(
        SCENE + "".join("  - {mesh: {shape: {revolution: {segments: 512, profile: [[0, 0], [1, 0], "
                        + ", ".join(f"[1, {0.01 * k:g}]" for k in range(1, 196))
                        + f", [0, 1.95]]}}}}, pose: {{position: [{i}, 0, -9]}}}}}}\n" for i in range(60)),
        "obstacle obstacle-", "at most 10000000"),
    "large-thin-box": text_scene(
        SCENE.replace("{bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}", "{box: {size: [10, 10, 0.0001]}}"),
        "tool", "0.0001 m thin", "200000"),
})
