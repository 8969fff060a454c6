"""Every subcommand once: exit code, files, keys, columns (design: what others may rely on)."""

import math
import os
import pathlib
import re
import signal
import socket
import struct
import time
import urllib.error
import urllib.request

from harness import CASES, SCENE, case, expect

SUBCOMMANDS = ["run", "one-d", "check", "evaluate", "stress", "mesh", "validate", "devices", "view",
               "replay", "export", "latency", "soak", "study", "schema", "manual", "completion"]
SCENES = sorted(p.stem for p in (pathlib.Path(__file__).parents[2] / "scenes").glob("*.yaml") if p.stem != "one-d")
UNITS = r"_(s|ms|us|m|kg|N|Nm|Pa|J|rad|deg|Hz|m_s|rad_s|N_m|m3|m2|count)$"
WITHOUT_UNIT = r"(^|_)(q?[wxyz]|contacts.*|iterations|.*iterations|residual|.*residual|active|buttons|flags?|step|tick|motion_share|redone|converged|.*_rel|scene|method|handle|device|aim|passes|status|missed|.*stale.*)$"


def numbers(rows, column):
    return [float(row[column]) for row in rows]


def check_columns(name, header):
    expect(len(set(header)) == len(header), f"{name}: a column stands twice")
    for column in header:
        expect(re.search(UNITS, column) or re.search(WITHOUT_UNIT, column),
               f"{name}: column '{column}' has no unit in its name")


def require_keys(name, value, keys):
    """keys: {key: nested keys or None}; the innermost values are finite numbers or texts."""
    for key, nested in keys.items():
        expect(key in value, f"{name} has no key '{key}'")
        if nested:
            require_keys(f"{name}.{key}", value[key], nested)
        else:
            expect(isinstance(value[key], (int, float, str)), f"{name}.{key} is {value[key]!r}")


def keys(*names, **nested):
    return {**dict.fromkeys(names), **nested}


SUMMARY = keys(
    "scene", "method",
    mesh=keys("tetrahedra", "nodes", "surface_triangles"),
    visual=keys("step_s", "steps", "median_ms", "p95_ms", "max_ms"),
    haptic=keys("rate_hz", "ticks", "missed", tick_us=keys("p50", "p99", "max")),
    linearization=keys("median_ms"),
    contact=keys("max_active", "max_penetration_m", "max_residual"),
    force=keys("peak_N", "rms_N"),
)


STRESS_SUMMARY = keys("scene", "hand", "seed", "step_s", "by_clock", "steps", "stopped", "deepest_penetration_rel", "nan",
                      "wrong_side", "self_intersections", "inverted", "steps_crossed", "steps_passed", "steps_folded",
                      "frozen", "max_energy_J", "max_kinetic_J", "max_elastic_J", "energy_made_J", "largest_energy_made_J",
                      "restored", "not_converged", "cut", "cut_twice", "least_share", "redone",
                      step_ms=keys("median", "p99", "p99_9", "max"))


def check_report(path):
    """A page that needs nothing but itself."""
    text = path.read_text()
    expect(text.lstrip().lower().startswith("<!doctype html"), "report.html is not an HTML page")
    outside = re.findall(r"""<(?:script|img|link|iframe)[^>]*(?:src|href)\s*=\s*["']?(?!data:|#)[^"'>\s]+""", text)
    expect(not outside, f"report.html loads {outside[:1]}")


def run_press(context, *options, out=None):
    out = out or context.out
    context.succeeds(["run", context.file("scene.yaml", SCENE), "--out", out, *options])
    return context.summary(out)


@case
def help_of_every_subcommand(context):
    overview = context.succeeds(["--help"])
    for name in SUBCOMMANDS:
        expect(re.search(rf"(?m)^\s*{name}\b", overview), f"--help does not list {name}")
        expect(len(context.succeeds([name, "--help"]).splitlines()) > 3, f"{name} --help says too little")


@case
def run_writes_what_others_rely_on(context):
    summary = run_press(context)
    require_keys("summary", summary, SUMMARY)
    expect(summary["method"] == "live", "the default method is not live")
    parts = summary["live"]["parts_median_contact_ms"]
    expect(set(parts) == {"factorize", "modes", "search", "partners", "replay"}, f"parts of a live step: {parts}")
    expect(min(parts["replay"], parts["modes"], parts["search"], parts["factorize"]) > 0, f"one took no time: {parts}")
    expect(summary["mesh"]["tetrahedra"] == 48 and summary["mesh"]["nodes"] == 27, f"mesh: {summary['mesh']}")
    expect(summary["visual"]["steps"] == 15, f"0.3 s at 0.02 s are 15 steps and not {summary['visual']['steps']}")
    expect(summary["contact"]["max_active"] > 0, "pressing made no contact")
    expect(0 < summary["force"]["rms_N"] <= summary["force"]["peak_N"], f"force: {summary['force']}")
    for name in ("haptic.csv", "visual.csv", "timing.csv"):
        check_columns(name, context.table(name)[0])
    check_report(context.out / "report.html")
    leftovers = {p.name for p in context.out.iterdir() if not p.name.startswith("picture")} - {"haptic.csv", "visual.csv", "timing.csv", "summary.json",
                                                          "report.html", "motion.csv", "recording.palpate"}
    expect(not leftovers, f"unexpected files {leftovers}")


@case
def run_has_one_row_a_tick_and_a_step(context):
    summary = run_press(context)
    for name, dt, count in (("haptic.csv", 0.001, summary["haptic"]["ticks"]),
                            ("visual.csv", 0.02, summary["visual"]["steps"])):
        header, rows = context.table(name)
        expect(header[0] == "time_s", f"{name} begins with {header[0]} and not with time_s")
        expect(len(rows) == count, f"{name} has {len(rows)} rows and the summary says {count}")
        for i, time in enumerate(numbers(rows, 0)):
            expect(abs(time - i * dt) < 1e-9, f"{name}: row {i} is at {time} s")
    header, rows = context.table("haptic.csv")
    quaternions = [i for i, c in enumerate(header) if c.endswith("qw")]
    expect(len(quaternions) >= 2, f"haptic.csv has no quaternions of device and proxy: {header}")
    for i in quaternions:
        order = [c[-2:] for c in header[i:i + 4]]
        expect(order == ["qw", "qx", "qy", "qz"], f"the quaternion's columns stand as {order}")
        for row in rows:
            expect(abs(math.hypot(*map(float, row[i:i + 4])) - 1) < 1e-6, "a quaternion is not of unit length")


@case
def run_is_the_same_twice(context):
    run_press(context, out=context.folder / "a")
    run_press(context, out=context.folder / "b")
    for name in ("haptic.csv", "visual.csv"):
        same = (context.folder / "a" / name).read_bytes() == (context.folder / "b" / name).read_bytes()
        expect(same, f"{name} differs between two runs")


@case
def run_replays_its_recorded_motion(context):
    run_press(context, out=context.folder / "a")
    run_press(context, "--device", f"recorded:{context.folder / 'a' / 'motion.csv'}", out=context.folder / "b")
    for name in ("haptic.csv", "visual.csv"):
        same = (context.folder / "a" / name).read_bytes() == (context.folder / "b" / name).read_bytes()
        expect(same, f"{name} differs between the run and its replay")


def method_case(method):
    def run(context):
        summary = run_press(context, "--method", method)
        expect(summary["method"] == method, f"the summary names the method {summary['method']}")
        require_keys("summary", summary, SUMMARY)

    CASES[f"run-method-{method}"] = run


for name in ("hsl", "hsl-exact", "vc"):
    method_case(name)


@case
def run_takes_the_options_of_the_command_line(context):
    summary = run_press(context, "--duration", "0.2", "--visual-dt", "0.01", "--latency", "0", "--seed", "7",
                        "--handle", "top", "--aim", "predicted")
    expect(summary["visual"]["step_s"] == 0.01 and summary["visual"]["steps"] == 20, f"visual: {summary['visual']}")


# A soft pad rubs on a soft slab; a rigid plate lies on a log.
STIFF_DEVICE = ("device: {type: prescribed, limits: {peak_force: 1000, continuous_force: 1000, peak_torque: 100, "
                "stiffness: 2000, damping: 10, rotational_stiffness: 5, rotational_damping: 0.02}}\n")
PAD = STIFF_DEVICE + """palpate: 1
name: pad
duration: 2.1
tool:
  shape: {bar: {size: [0.009, 0.009, 0.003], cells: [3, 3, 1]}}
  pose: {position: [0, 0, 0.0008]}
  material: {youngs_modulus: 1.0e4, poisson_ratio: 0, density: 300, damping_beta: 0.002}
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.00225], normal: [0, 0, 1]}}
      hand:
        smooth: false
        keyframes:
          - {t: 0.2}
          - {t: 0.8, position: [0, 0, -0.0015]}
          - {t: 1.0, position: [0, 0, -0.0015]}
          - {t: 1.5, position: [0, 0.0016, -0.0015]}
          - {t: 1.8, position: [0, 0, -0.0015]}
bodies:
  - name: slab
    shape: {bar: {size: [0.025, 0.02, 0.0065], cells: [5, 4, 2]}}
    pose: {position: [0, 0, -0.0066]}
    material: {youngs_modulus: 2.0e5, poisson_ratio: 0.45, density: 1000, damping_beta: 0.003}
    start: settled
obstacles: [{name: ground, plane: {point: [0, 0, -0.0066]}}]
contact: {friction: 0}
"""
PLATE = STIFF_DEVICE + """palpate: 1
name: plate
duration: 2
tool:
  shape: {box: {size: [0.1, 0.06, 0.04]}}
  rigid: true
  pose: {position: [0, 0, 0.003]}
  handles: {center: {hand: {smooth: false, keyframes: [{t: 0.2}, {t: 1.2, position: [0, 0, -0.01]}]}}}
obstacles: [{name: log, capsule: {a: [0, -0.3, -0.05], b: [0, 0.3, -0.05], radius: 0.05}}]
contact: {friction: 0.5}
"""


@case
def run_says_what_was_out_of_the_ordinary(context):
    """In one row, with the summary's numbers; a quiet run has no such row. With a slew limit that is low there is one."""
    slow = "safety: {max_slew: 3}\n"
    for scene, step, expected in ((PAD, 0.01, ""), (PAD + slow, 0.01, "change of force limited"), (PAD, 0.02, None),
                                  (PLATE, 0.005, None)):
        output = context.succeeds(["run", context.file("scene.yaml", scene), "--visual-dt", step, "--pictures", "0",
                                   "--out", context.out])
        summary = context.summary()
        flags, made = summary["haptic"]["flags"], summary["visual"]["energy_made_J"]
        parts = [f"{text} {flags[flag]}" for flag, text in
                 (("model_rejected", "models refused"), ("model_damped", "models slowed"),
                  ("proxy_limited", "proxy at its limit"), ("slew_limited", "change of force limited")) if flags[flag]]
        if made > 1e-3:
            parts.append(f"steps made {1e3 * made:.3g} mJ")
        rows = re.findall(r"(?m)^! out of the ordinary, ticks +(.*?) *$", output)
        expect(rows == ([", ".join(parts)] if parts else []), f"{parts} came up, and the table says {rows}")
        if expected is not None:
            expect(expected in "".join(rows) and bool(rows) == bool(expected), f"{rows} and not '{expected}'")


@case
def run_replaces_an_earlier_result(context):
    run_press(context)
    summary = run_press(context, "--duration", "0.1")
    expect(len(context.table("visual.csv")[1]) == summary["visual"]["steps"] == 5, "files of two runs are mixed")


@case
def run_keeps_real_time(context):
    begin = time.monotonic()
    summary = run_press(context, "--realtime", "--duration", "0.5")
    expect(time.monotonic() - begin >= 0.5, "simulated time went faster than the clock")
    require_keys("summary", summary, SUMMARY)
    rows = context.table("haptic.csv")[1]
    expect(len(rows) == summary["haptic"]["ticks"] > 0, f"{len(rows)} rows of {summary['haptic']['ticks']} ticks")
    ticks = [t / 0.001 for t in numbers(rows, 0)]
    expect(all(abs(t - round(t)) < 1e-6 for t in ticks), "a tick is off the clock's raster")
    expect(ticks == sorted(set(ticks)) and round(ticks[-1]) < 500, "ticks are not in order, or beyond the end")
    # what a loaded machine made the loop miss is counted, up to the last tick
    gone = round(ticks[-1]) + 1 - len(rows)
    expect(gone <= summary["haptic"]["missed"], f"{gone} ticks are gone and {summary['haptic']['missed']} missed")


@case
def one_d_reproduces_the_table(context):
    context.succeeds(["one-d", "--out", context.out])
    header, rows = context.table("one_d.csv")
    expect(header == ["time", "method", "visual_dt", "latency", "xd", "xh", "xt", "force"], f"columns {header}")
    expect(any(row[1] == "reference" for row in rows), "no rows of the reference")
    check_report(context.out / "report.html")
    runs = find_runs(context.summary())
    for method, dt, drag, rms in (("vc", 0.01, 5.80, 5.10), ("vc", 0.02, 11.80, 10.32), ("hsl", 0.01, 0.43, 0.46),
                                  ("hsl", 0.02, 0.24, 0.60)):
        run = next((r for r in runs if r["method"] == method and abs(float(r["visual_dt"]) - dt) < 1e-9), None)
        expect(run, f"no run of {method} at {dt} s")
        for key, wanted in (("drag_N", drag), ("rms_N", rms)):
            tolerance = 0.005 + 0.001 * wanted  # the table's last digit and 0.1 %
            expect(abs(run[key] - wanted) <= tolerance, f"{method} at {dt} s: {key} is {run[key]} and not {wanted}")


def find_runs(summary):
    """The list of runs: {method, visual_dt, drag_N, rms_N, peak_error_N, ...} each."""
    runs = next((v for v in summary.values() if isinstance(v, list) and v and "drag_N" in v[0]), None)
    expect(runs, f"summary.json lists no runs: {list(summary)}")
    for run in runs:
        require_keys("run", run, keys("method", "visual_dt", "latency", "drag_N", "rms_N", "peak_error_N"))
    return runs


@case
def one_d_reads_a_config(context):
    config = context.file("c.yaml", "handle_mass: 0.1\nvisual_dts: [0.01]\nmethods: [hsl]\nlatency: 0\n")
    context.succeeds(["one-d", "--config", config, "--out", context.out])
    runs = [r for r in find_runs(context.summary()) if r["method"] != "reference"]
    expect([r["method"] for r in runs] == ["hsl"], f"runs {runs}")
    context.succeeds(["one-d", "--config", context.scene("one-d"), "--out", context.folder / "shipped"])


def check_case(at, active):
    def run(context):
        scene = context.file("scene.yaml", SCENE)
        context.succeeds(["check", "linearization", scene, "--at", at, "--out", context.out])
        check = context.summary()["linearization_check"]
        require_keys("linearization_check", check, keys("kx_frozen_rel", "kv_frozen_rel", "kx_full_rel", "kv_full_rel",
                                                        "active", "sticking", "sliding"))
        expect((check["active"] > 0) == active, f"active contacts: {check['active']}")
        expect(check["sticking"] + check["sliding"] <= check["active"], f"counts do not fit: {check}")
        for key in ("kx_frozen_rel", "kv_frozen_rel"):
            expect(check[key] <= 1e-6, f"{key} is {check[key]}")

    CASES[f"check-linearization-at-{at}"] = run


check_case("0.2", True)


def attached_case(name, springs):
    """The scene with its lower side held by the world, and no ground."""
    held = "{region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}" + springs + "}"
    text = SCENE.partition("obstacles:\n")[0].replace("  friction: 0.5\n", f"  friction: 0.5\n  attachments: {{root: {held}}}\n")

    def run(context):
        scene = context.file("scene.yaml", text)
        context.rejects(["run", scene, "--method", "live", "--out", context.folder / "live"], ["--method", "hsl"])
        context.succeeds(["check", "linearization", scene, "--at", "0.2", "--out", context.out])
        check = context.summary()["linearization_check"]
        for key in ("kx_frozen_rel", "kv_frozen_rel"):
            expect(check[key] <= 1e-6, f"{key} is {check[key]}")
        context.succeeds(["check", "linearization", scene, "--at", "0.2", "--derivative", "full", "--out", context.out])
        check = context.summary()["linearization_check"]
        for key in ("kx_full_rel", "kv_full_rel"):
            expect(check[key] <= 1e-6, f"{key} is {check[key]}")
        context.succeeds(["run", scene, "--duration", "0.6", "--pictures", "0", "--out", context.out])
        summary = context.summary()
        expect(summary["method"] == "hsl", f"method {summary['method']}")
        root = summary["attachments"][0]
        expect(root["name"] == "root" and root["peak_N"] > 0, f"{root}")
        header, rows = context.table("attachments.csv")
        check_columns("attachments.csv", [c for c in header if c not in ("body", "attachment")])
        expect(len(rows) == summary["visual"]["steps"], f"{len(rows)} rows")

    CASES[f"attachment-{name}"] = run


attached_case("fixed", "")
attached_case("springs", ", stiffness: 1.0e5, damping: 100")


RIGID_TOOL = """\
palpate: 1
name: probe
duration: 0.4
visual: {step: 0.02}
tool:
  rigid: true
  density: 2000
  shape: {sphere: {radius: 0.01}}
  pose: {position: [0, 0, 0.031]}
  handles:
    grip:
      mass: 0.02
      hand: {keyframes: [{t: 0}, {t: 0.3, position: [0.002, 0, -0.006]}]}
bodies:
  - name: tissue
    shape: {bar: {size: [0.06, 0.06, 0.03], cells: [4, 4, 2]}}
    material: {youngs_modulus: 2.0e4, poisson_ratio: 0.4, density: 1000}
    attachments: {table: {region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}}}
"""


@case
def rigid_tool(context):
    scene = context.file("scene.yaml", RIGID_TOOL)
    context.rejects(["run", context.file("r.yaml", RIGID_TOOL.replace("      mass", "      region: {}\n      mass", 1)), "--out", context.folder / "r"],
                    ["region", "whole"])
    context.rejects(["run", scene, "--tetrahedra", "100", "--out", context.folder / "t"], ["--tetrahedra", "rigid"])
    said = context.succeeds(["validate", scene])
    for line in ("tool: rigid, ", "tissue: ", "table: 25 nodes around (0, 0, 0) m, fixed", "all of the tool, at (0, 0, 0.0"):
        expect(line in said, f"validate does not say '{line}': {said}")
    for method in ("live", "hsl", "vc"):
        context.succeeds(["run", scene, "--method", method, "--pictures", "0", "--out", context.out])
        summary = context.summary()
        expect(summary["contact"]["max_active"] > 0, f"{method}: no contact")
        expect(0.1 < summary["force"]["peak_N"] < 3.3, f"{method}: {summary['force']}")
    for derivative in ("frozen", "full"):
        context.succeeds(["check", "linearization", scene, "--at", "0.3", "--derivative", derivative, "--out", context.out])
        check = context.summary()["linearization_check"]
        expect(check["active"] > 0, "no contact")
        for key in (f"kx_{derivative}_rel", f"kv_{derivative}_rel"):
            expect(check[key] <= 1e-6, f"{key} is {check[key]}")


GLUED = RIGID_TOOL.replace(
    "{table: {region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}}}",
    "{joint: {region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}, to: bed}}\n    start: settled") + """\
  - name: bed
    shape: {bar: {size: [0.08, 0.08, 0.02], cells: [4, 4, 2]}}
    pose: {position: [0, 0, -0.02]}
    material: {youngs_modulus: 4.0e4, poisson_ratio: 0.4, density: 1000}
    attachments: {table: {region: {halfspace: {point: [0, 0, 0.001], normal: [0, 0, -1]}}}}
    start: settled
"""


@case
def glued_bodies(context):
    scene = context.file("scene.yaml", GLUED)
    said = context.succeeds(["validate", scene])
    for line in ("joint: 25 nodes around (0, 0, 0) m, glued to bed", "table: 25 nodes around (0, 0, -0.02) m, fixed"):
        expect(line in said, f"validate does not say '{line}': {said}")
    for method in ("live", "hsl", "hsl-exact"):
        context.succeeds(["run", scene, "--method", method, "--pictures", "0", "--out", context.out])
        summary = context.summary()
        expect(summary["contact"]["max_active"] > 0, f"{method}: no contact")
        expect(0.1 < summary["force"]["peak_N"] < 3.3, f"{method}: {summary['force']}")
        joint, table = summary["attachments"]
        expect(joint["body"] == "tissue" and table["body"] == "bed", f"{summary['attachments']}")
        weight = 9.81 * 1000 * 0.08 * 0.08 * 0.02
        expect(abs(table["last_N"][2] - joint["last_N"][2] - weight) < 0.05 * weight, f"{joint} {table}")
        header, rows = context.table("attachments.csv")
        expect(len(rows) == 2 * summary["visual"]["steps"], f"{len(rows)} rows")
    for derivative in ("frozen", "full"):
        context.succeeds(["check", "linearization", scene, "--method", "hsl-exact", "--at", "0.3", "--derivative", derivative,
                          "--out", context.out])
        check = context.summary()["linearization_check"]
        expect(check["active"] > 0, "no contact")
        for key in (f"kx_{derivative}_rel", f"kv_{derivative}_rel"):
            expect(check[key] <= 1e-6, f"{key} is {check[key]}")


@case
def mesh_info_and_embed(context):
    source = context.file("ball.off", ball())
    info = context.succeeds(["mesh", "info", source])
    expect("320" in info, f"the count of triangles is missing: {info!r}")
    points = [tuple(map(float, l.split())) for l in ball().splitlines()[2:] if len(l.split()) == 3]
    said = re.search(r"extents +\((.*), (.*), (.*)\) to \((.*), (.*), (.*)\)", info)
    expect(said, f"no extents: {info!r}")
    for k in range(6):
        expected = (min, max)[k // 3](p[k % 3] for p in points)
        expect(abs(float(said[k + 1]) - expected) < 1e-5, f"extent {k} is not {expected}: {info!r}")
    output = context.succeeds(["mesh", "embed", source, "--tets", "200"])
    for word in ("volume", "tetrahedra", "worst", "outside"):
        expect(word in output.lower(), f"the report does not say '{word}': {output!r}")


@case
def mesh_info_of_tetrahedra(context):
    nodes = [(x, y, z) for z in (0.5, 2) for y in (0, 1) for x in (-1, 1)]
    tetrahedra = [(0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7)]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(nodes))]
    lines += [f"{i + 1} {x} {y} {z}" for i, (x, y, z) in enumerate(nodes)]
    lines += ["$EndNodes", "$Elements", str(len(tetrahedra))]
    lines += [f"{i + 1} 4 2 0 1 " + " ".join(str(n + 1) for n in t) for i, t in enumerate(tetrahedra)]
    said = context.succeeds(["mesh", "info", context.file("cell.msh", "\n".join(lines + ["$EndElements", ""]))])
    for line in ("6, 1 pieces", "8, 8 on the surface of 12 triangles", "2 x 1 x 1.5", "(-1, 0, 0.5) to (1, 1, 2)",
                 "volume                3\n"):
        expect(line in said, f"mesh info does not say '{line}': {said}")
    context.rejects(["mesh", "info", context.file("broken.msh", "$MeshFormat\n2.2 0 8\n")], ["broken.msh"])


def ball(radius=0.05, rounds=2):
    """An icosphere as an OFF file: 20 * 4^rounds triangles."""
    g = (1 + 5 ** 0.5) / 2
    points = [(a, b, 0) for a in (-1, 1) for b in (-g, g)]
    points = points + [(0, x, y) for x, y, _ in points] + [(y, 0, x) for x, y, _ in points]

    def near(i, j):
        return abs(math.dist(points[i], points[j]) - 2) < 1e-9

    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near(i, j) and near(j, k) and near(i, k):
                    a, b, c = (points[n] for n in (i, j, k))
                    u, v = [[q[n] - a[n] for n in range(3)] for q in (b, c)]
                    normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
                    faces.append((i, j, k) if sum(n * x for n, x in zip(normal, a)) > 0 else (i, k, j))
    for _ in range(rounds):
        middle, finer = {}, []
        for face in faces:
            m = []
            for n in range(3):
                edge = tuple(sorted((face[n], face[(n + 1) % 3])))
                if edge not in middle:
                    middle[edge] = len(points)
                    points.append(tuple((points[edge[0]][x] + points[edge[1]][x]) / 2 for x in range(3)))
                m.append(middle[edge])
            finer += [(face[0], m[0], m[2]), (face[1], m[1], m[0]), (face[2], m[2], m[1]), tuple(m)]
        faces = finer
    lines = ["OFF", f"{len(points)} {len(faces)} 0"]
    for p in points:
        lines.append(" ".join(f"{radius * x / math.hypot(*p):.9g}" for x in p))
    return "\n".join(lines + [f"3 {a} {b} {c}" for a, b, c in faces]) + "\n"


@case
def mesh_make_alien(context):
    target = context.folder / "alien.obj"
    context.succeeds(["mesh", "make", "alien", "--out", target])
    faces = sum(line.startswith("f ") for line in target.read_text().splitlines())
    expect(faces >= 4000, f"the alien has {faces} triangles")
    context.succeeds(["mesh", "info", target])


@case
def visual_step_auto(context):
    """As short as the machine holds; a run with the number given is the same to the bit."""
    scene = context.file("scene.yaml", SCENE.replace("{step: 0.02}", "{step: auto}"))
    context.rejects(["run", scene, "--visual-dt", "some", "--out", context.out], ["--visual-dt", "auto"])
    context.succeeds(["run", scene, "--out", context.out])
    visual = context.summary()["visual"]
    step, chosen = visual["step_s"], visual["auto"]
    expect(chosen["holds"] and 1e3 * step >= chosen["warm_up_p99_ms"] / chosen["share"] * 0.999, f"{visual}")
    expect(step < 0.02, f"{step} s for a step of {chosen['warm_up_p99_ms']} ms")
    again = context.folder / "again"
    context.succeeds(["run", scene, "--visual-dt", repr(step), "--out", again])
    expect("auto" not in context.summary(again)["visual"], "it was chosen again")
    for name in ("haptic.csv", "visual.csv", "motion.csv"):
        expect((again / name).read_bytes() == (context.out / name).read_bytes(), f"{name} is another")
    heavy = context.file("heavy.yaml", SCENE.replace("cells: [2, 2, 2]", "cells: [10, 8, 10]"))
    context.succeeds(["run", heavy, "--visual-dt", "auto", "--out", context.folder / "heavy"])
    longer = context.summary(context.folder / "heavy")["visual"]["step_s"]
    expect(longer > step, f"{longer} s for a heavy scene, {step} s for a light one")
    expect(longer <= 0.02 + 1e-12, "longer than the scene's own")


@case
def soak_of_shipped_scenes(context):
    """The short version of the hour in docs/haptics.md: a minute of each, both at once."""
    names = ("alien", "bunnies")
    runs = [context.start(["soak", context.scene(name), "--duration", "60", "--out", context.folder / name]) for name in names]
    for name, run in zip(names, runs, strict=True):
        _, errors = run.communicate(timeout=200)
        expect(run.returncode == 0, f"{name}: exit code {run.returncode}: {errors[-500:]}")
        (summary,) = context.summary(context.folder / name)
        models = summary["models"]
        expect(summary["ticks"] + summary["missed"] == 60000, f"{summary['ticks']} ticks, {summary['missed']} missed")
        expect(models["made"] == sum(models[k] for k in ("used", "refused", "late", "under_way")), f"{models}")
        expect(models["made"] > 600 and models["used"] > 0.3 * models["made"], f"{models}")
        expect(summary["not_finite"] == 0 and not summary["failures"], f"{summary['failures']}")
        expect(summary["hands"] in (3, 4) and summary["peak_N"] > 0.2, f"{summary['hands']} hands, {summary['peak_N']} N")
    context.rejects(["soak", context.file("still.yaml", SCENE.split("      hand:")[0])], ["keyframes"])


@case
def latency_measures_and_advises(context):
    bare = context.folder / "bare"
    output = context.succeeds(["latency", "--duration", "0.5", "--rates", "1000,4000", "--out", bare])
    summary = context.summary(bare)
    expect([r["rate_hz"] for r in summary["rates"]] == [1000, 4000], f"{summary['rates']}")
    for rate in summary["rates"]:
        wake = rate["wake_us"]
        expect(0 < wake["p50"] <= wake["p99"] <= wake["p99_9"] <= wake["max"], f"{wake}")
        expect(sum(n for _, n in wake["bins"]) == rate["ticks"] == wake["count"], "the histogram lost some")
        expect(rate["ticks"] + rate["missed"] == 0.5 * rate["rate_hz"], f"{rate['ticks']}, {rate['missed']}")
    for line in summary["advice"]:
        expect(line in output, f"not said: {line}")
    scene = context.file("scene.yaml", SCENE)
    context.succeeds(["latency", scene, "--duration", "0.5", "--out", context.folder / "both"])
    both = context.summary(context.folder / "both")["rates"]
    expect(all(r["response_us"]["count"] > 10 and r["tick_us"]["p50"] > 0 for r in both), f"{both}")
    context.rejects(["latency", scene, "--rates", "777"], ["--rates", "whole number"])
    context.rejects(["latency", "--rates", "0"], ["--rates"])


def validate_case(name):
    def run(context):
        before = set(context.folder.iterdir())
        context.succeeds(["validate", context.scene(name)])
        expect(set(context.folder.iterdir()) == before, "validate wrote something")

    CASES[f"validate-{name}"] = run


for name in SCENES:
    validate_case(name)


def scene_case(name, duration):
    """A scene of contact between bodies runs, and its surfaces keep apart."""
    def run(context):
        context.succeeds(["run", context.scene(name), "--duration", duration, "--pictures", "1", "--out", context.out])
        summary = context.summary()
        require_keys("summary", summary, SUMMARY)
        expect(summary["visual"]["restored"] == 0, f"{summary['visual']['restored']} steps failed")
        expect(summary["contact"]["max_penetration_m"] < 1e-4, f"contact: {summary['contact']}")
        status = context.table("visual.csv")[0].index("status")
        expect({row[status] for row in context.table("visual.csv")[1]} == {"ok"}, "a step was not ok")
        check_report(context.out / "report.html")
        expect((context.out / "picture-1.png").stat().st_size > 1000, "the picture is missing or empty")

    CASES[f"scene-{name}"] = run


for name, duration in (("alien-self", "0.5"), ("bunnies", "0.1"), ("palpation", "0.3"), ("plug", "0.5"), ("pile", "0.2")):
    scene_case(name, duration)


def stress(context, *arguments, out=None):
    """The summary; exit code 3 and a line for each criterion if and only if one fails."""
    out = out or context.out
    code, output, errors = context.run(["stress", *arguments, "--out", out])
    expect(code in (0, 3), f"exit code {code}, standard error: {errors.strip()}")
    summary = context.summary(out)
    require_keys("summary", summary, STRESS_SUMMARY)
    expect((code == 3) == bool(summary["failures"]), f"exit code {code} with failures {summary['failures']}")
    lines = [line.split("FAILED: ")[1] for line in output.splitlines() if "FAILED: " in line]
    expect(lines == summary["failures"], f"printed {lines} and not {summary['failures']}")
    return summary


def stress_case(name):
    def run(context):
        summary = stress(context, context.scene(name), "--steps", "60", "--seed", "3")
        expect(summary["steps"] == 60, f"{summary['steps']} steps and not 60")
        expect(summary["nan"] == 0, f"{summary['nan']} steps were not finite")
        expect(summary["wrong_side"] == 0, f"{summary['wrong_side']} vertices on the wrong side after calm")
        expect(0 <= summary["deepest_penetration_rel"] < 0.02, f"penetration {summary['deepest_penetration_rel']}")
        expect(summary["max_energy_J"] > 0, "a violent hand gives no energy")
        expect({p.name for p in context.out.iterdir()} == {"summary.json"}, "other files were written")

    CASES[f"stress-{name}"] = run


for name in ("alien", "plug"):
    stress_case(name)


@case
def stress_is_the_same_twice(context):
    """But for its times; another seed is another motion."""
    def result(seed, out):
        summary = stress(context, context.file("scene.yaml", SCENE), "--steps", "40", "--seed", seed, out=out)
        del summary["step_ms"], summary["seed"]
        return summary

    first = result("5", context.folder / "a")
    expect(first == result("5", context.folder / "b"), "two runs of one seed differ")
    expect(first["max_energy_J"] != result("6", context.folder / "c")["max_energy_J"], "the seed changes nothing")


@case
def stress_rides(context):
    """A slow hand fails nothing; each ride is the same whichever was before it."""
    slow = ["--hand", "ride", "--speed", "0.1", "--spin", "1", "--ride", "0.5"]
    both = stress(context, context.file("scene.yaml", SCENE), *slow, "--seeds", "2", "--static")
    expect(both["failures"] == [] and not both["stopped"], f"failures {both['failures']}")
    expect(both["rides"] == {"ridden": 2, "judged": 2, "swinging": 0, "failed": 0, "failed_seeds": []}, f"rides {both['rides']}")
    header, rows = context.table("rides.csv")
    expect([row[header.index("seed")] for row in rows] == ["1", "2"], "not the seeds 1 and 2")
    for row in rows:
        expect(float(row[header.index("handle_off_m")]) < 5e-4, f"the handle did not come back: {row}")
    expect(sum(int(row[header.index("steps")]) for row in rows) == both["steps"], "the steps do not add up")
    second = context.folder / "second"
    stress(context, context.file("scene.yaml", SCENE), *slow, "--steps", "20", "--seed", "2", "--static", out=second)
    expect([r[:-1] for r in context.table("rides.csv", second)[1]] == [rows[1][:-1]], "the second ride alone is another")


@case
def stress_by_the_clock(context):
    """Where steps of 10 ms may take longer, and some end early, states stay good."""
    summary = stress(context, context.scene("alien-self"), "--clock", "--visual-dt", "0.010", "--speed", "20", "--spin",
                     "100", "--steps", "120", "--seed", "3")
    expect(summary["by_clock"] and summary["steps"] == 120, f"{summary['steps']} steps by the clock")
    expect(summary["nan"] == 0 and summary["restored"] == 0, "a step that ended early left no good state")
    expect(summary["wrong_side"] == 0, f"{summary['wrong_side']} vertices on the wrong side after calm")


@case
def stress_stops_with_what_it_has(context):
    process = context.start(["stress", context.file("scene.yaml", SCENE), "--hand", "ride", "--seeds", "100000",
                             "--out", context.out])
    process.stderr.readline()  # it says that it has begun
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    expect(process.returncode == 130, f"exit code {process.returncode} and not 130 after Ctrl+C")
    summary = context.summary()
    expect(summary["stopped"] and summary["steps"] > 0, f"stopped {summary['stopped']} at step {summary['steps']}")
    expect(summary["rides"]["ridden"] == len(context.table("rides.csv")[1]), "rows and rides differ")


@case
def seed_has_64_bits(context):
    stress(context, context.file("scene.yaml", SCENE), "--steps", "1", "--seed", str(2**64 - 1))
    expect(context.summary()["seed"] == 2**64 - 1, f"the seed is {context.summary()['seed']}")


@case
def devices_lists_the_simulated_one(context):
    expect("simulated" in context.succeeds(["devices"]), "the simulated device is not listed")


@case
def evaluate_compares_methods(context):
    context.succeeds(["evaluate", context.file("scene.yaml", SCENE), "--methods", "hsl,vc", "--visual-dt", "0.02",
                      "--out", context.out])
    rows = context.summary()["rows"]
    expect({r["method"] for r in rows} >= {"hsl", "vc"}, f"methods {[r['method'] for r in rows]}")
    for row in rows:
        require_keys("row", row, keys("scene", "method", "visual_dt", "latency", "rms_N", "peak_error_N",
                                      "peak_error_x_N", "peak_error_y_N", "peak_error_z_N", "rms_Nm",
                                      "reference_peak_N", "floor_rms_N", "switch_N", "returned_J",
                                      "reference_returned_J"))
        for name in ("drag_N", "onset_s", "release_s", "glue_Ns"):
            expect(name in row, f"no {name}, not even null")


@case
def evaluate_holds_the_device_in_hands(context):
    """A given motion says nothing of a soft hand."""
    scene = context.file("scene.yaml", SCENE)
    for hand in ("500", "500/", "-1/2", "1/nan", "some", "500/8/1"):
        context.rejects(["evaluate", scene, "--hands", hand], ("--hands", hand))
    for delay in ("+1", "1+", "x", "1.5", "1+2+3"):
        context.rejects(["evaluate", scene, "--delays", delay], ("--delays", delay))
    for delay in ("-1", "1+-1", "1+1000000"):
        context.rejects(["evaluate", scene, f"--delays={delay}"], ("--latency" if delay == "-1" else "--jitter",))
    context.rejects(["evaluate", scene, "--delays", ",".join(["1"] * 17)], ("--delays", "16"))
    context.succeeds(["evaluate", scene, "--methods", "live", "--visual-dt", "0.02", "--hands", "500/8,none",
                      "--delays", "1,1+1", "--out", context.out])
    rows = [r for r in context.summary()["rows"] if "hand" in r]
    wanted = [(hand, 1, jitter) for hand in ("500/8", "none") for jitter in (0, 1)]
    found = [(r["hand"], r["latency"], r["jitter"]) for r in rows]
    expect(found == wanted, f"{found}")
    for row in rows:
        require_keys("row", row, keys("scene", "method", "visual_dt", "hold_pk_N", "hold_pk_mm", "reference_hold_pk_N",
                                      "reference_hold_pk_mm", "rms_N", "returned_J", "reference_returned_J"))


@case
def evaluate_sees_an_alien_at_rest_in_no_hand(context):
    """What nobody holds rests only where all its contacts are found before they are made."""
    context.succeeds(["evaluate", context.scene("alien"), "--methods", "live", "--visual-dt", "0.033", "--hands", "none",
                      "--delays", "2", "--out", context.out])
    (row,) = [r for r in context.summary()["rows"] if "hand" in r]
    expect(row["reference_hold_pk_mm"] < 0.01, f"the reference swings: {row}")
    expect(row["hold_pk_N"] < 0.01 and row["hold_pk_mm"] < 0.1, f"it swings: {row}")


class Served:
    """The program while it serves a page; ends as Ctrl+C ends it."""

    def __init__(self, context, *arguments):
        self.process = context.start([*arguments, "--port", "0"])
        line = self.process.stdout.readline()
        found = re.search(r"http://\S+", line)
        expect(found, f"no address in {line!r}: {'' if found else self.process.communicate()[1]}")
        self.url = found.group().split("?")[0]
        self.port = int(re.search(r":(\d+)/", self.url).group(1))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.communicate(timeout=20)
        finally:
            self.process.kill()
        expect(self.process.returncode == 0, f"exit code {self.process.returncode} after Ctrl+C")

    def get(self, path, **headers):
        request = urllib.request.Request(self.url + path, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as e:
            return e.code, e.read()


@case
def view_serves_its_page_and_messages(context):
    with Served(context, "view", context.file("scene.yaml", SCENE)) as served:
        status, page = served.get("")
        expect(status == 200 and b"<!doctype html" in page.lower(), f"the page: {status}, {page[:60]!r}")
        for name in ("app.js", "app.css", "icon.svg"):
            expect(served.get(name)[0] == 200, f"/{name} is missing")
        expect(b'"mode":"view"' in served.get("session.json")[1], "/session.json does not say view")
        expect(served.get("nothing")[0] == 404, "what is not there was found")
        expect(served.get("", Host="evil.example")[0] == 403, "a foreign host was served")
        with socket.create_connection(("127.0.0.1", served.port), timeout=20) as s:
            s.sendall((f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                       "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n").encode())
            data = b""
            while data.count(b'"type":"s') < 2 or len(data) < 40000:  # scene and state, some frames
                more = s.recv(65536)
                expect(more, "the connection ended")
                data += more
            expect(b"101 Switching" in data and b'"type":"welcome"' in data, "no welcome")


@case
def view_says_why_it_cannot(context):
    scene = context.file("scene.yaml", SCENE)
    with Served(context, "view", scene) as served:
        context.rejects(["view", scene, "--port", str(served.port)], ["--port", str(served.port)])
    context.rejects(["view", scene, "--listen", "0.0.0.0"], ["--token"])
    context.rejects(["view", scene, "--listen", "no address", "--token", "x"], ["--listen"])
    context.rejects(["view", "nowhere.yaml"], ["nowhere.yaml"])


@case
def view_asks_for_its_token(context):
    with Served(context, "view", context.file("scene.yaml", SCENE), "--token", "secret") as served:
        expect(served.get("")[0] == 403, "served without the token")
        expect(served.get("?token=wrong")[0] == 403, "served with a wrong token")
        expect(served.get("?token=secret")[0] == 200, "refused with the token")


@case
def replay_serves_a_recorded_run(context):
    run_press(context)
    with Served(context, "replay", context.out) as served:
        expect(b'"mode":"replay"' in served.get("session.json")[1], "/session.json does not say replay")
        status, recording = served.get("recording")
        expect(status == 200 and recording.startswith(b"PALPATE1"), f"the recording: {status}")
        at, frames, ticks = 8, 0, 0
        while at < len(recording):
            kind, size = struct.unpack_from("<II", recording, at)
            if kind == 1:
                message, _, count = struct.unpack_from("<III", recording, at + 8)
                frames += message == 2
                ticks += count if message == 3 else 0
            at += 8 + -(-size // 8) * 8
        expect(frames == 15 and ticks == 300, f"{frames} frames and {ticks} ticks of 15 and 300")


@case
def replay_needs_a_recording(context):
    context.rejects(["replay", context.folder], ["recording.palpate"])
    pipe = context.folder / "recording.palpate"
    os.mkfifo(pipe)  # nobody writes into it
    context.rejects(["replay", context.folder], ["recording.palpate"])
    pipe.unlink()
    context.file("recording.palpate", "something else")
    context.rejects(["replay", context.folder], ["recording.palpate"])
