"""Parameter studies, and the JSON Schemas of scenes and studies."""

import csv
import filecmp
import json
import os
import re
import resource
import signal
import subprocess
import time
from pathlib import Path

from harness import SCENE, Failure, case, expect, rejected_variants, with_python

STUDY = """\
palpate_study: 1
name: small
kind: run
scenes: [scene.yaml]
set: {duration: 0.1}
vary: {tool.friction: [0.2, 0.5]}
methods: [live, vc]
seeds: {first: 3, count: 2}
run: {tables: csv}
"""
INCOMPLETE = 3  # exit code


def planned(context, text=STUDY, folder="study", scene=SCENE):
    context.file("scene.yaml", scene)
    context.succeeds(["study", "plan", context.file("study.yaml", text), "--out", context.folder / folder])
    return context.folder / folder


def report(context, folder, code=0):
    found, output, errors = context.run(["study", "report", folder])
    expect(found == code, f"exit code {found} and not {code}: {errors.strip()}")
    return output


def rows_of(folder):
    with open(folder / "table.csv", newline="") as stream:
        return list(csv.DictReader(stream))


def lasting(folder):
    """What is the same wherever a study runs."""
    files = [p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("timing")]
    return {p.relative_to(folder): p for p in files}


@case
def study_is_the_same_however_it_runs(context):
    one, other = planned(context), planned(context, folder="other")
    context.succeeds(["--threads", "1", "study", "run", one])
    context.succeeds(["study", "run", other, "--jobs", "3"])
    for folder in (one, other):
        report(context, folder)
    a, b = lasting(one), lasting(other)
    expect(a.keys() == b.keys() and len(a) > 8 * 6, f"files differ: {sorted(a.keys() ^ b.keys())[:3]}")
    different = [str(name) for name in a if not filecmp.cmp(a[name], b[name], shallow=False)]
    expect(not different, f"bytes differ: {different}")
    rows = rows_of(one)
    varied = [(r["tool.friction"], r["method"], r["seed"]) for r in rows]
    expect(varied == [(f, m, s) for f in ("0.2", "0.5") for m in ("live", "vc") for s in ("3", "4")], f"cases: {varied}")
    summary = json.loads((one / "summary.json").read_text())
    expect(summary["done"] == summary["cases"] == 8 and not summary["missing"] and not summary["failed"], f"{summary}")
    for row, told in zip(rows, summary["rows"], strict=True):
        expect(float(row["force.peak_N"]) == told["force.peak_N"] > 0.1, "table and summary differ")
    context.succeeds(["run", one / "cases/0003/scene.yaml", "--pictures", "0", "--out", context.out])
    expect((context.out / "haptic.csv").read_bytes() == (one / "cases/0003/result/haptic.csv").read_bytes(),
           "palpate run of a case's scene is another run")  # fmt: skip


@case
def study_runs_what_is_not_done(context):
    """Done cases are left alone, those whose inputs changed are not done, missing and failed ones are named."""
    folder = planned(context)
    output = report(context, folder, INCOMPLETE)
    expect("0 of 8" in output and "missing: 1 to 8" in output, output)

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    process = context.start(["study", "run", folder, "--case", "2"], preexec_fn=limit)
    _, errors = process.communicate(timeout=60)
    expect(process.returncode == 1 and "case 2" in errors and "cannot be written" in errors, errors)
    context.succeeds(["study", "run", folder, "--case", "1", "--case", "4", "--case", "5", "--case", "6", "--case", "7"])
    output = report(context, folder, INCOMPLETE)
    expect("5 of 8" in output and "missing: 3, 8" in output and "case 2 failed: " in output, output)
    page = (folder / "report.html").read_text()
    expect("case 2 failed" in page and "cannot be written" in page, "the page does not name the failed case")
    expect("case 2 failed" in (folder / "table.md").read_text(), "table.md does not name the failed case")
    before = {n: (folder / f"cases/000{n}/result/done.json").stat().st_mtime_ns for n in (1, 4)}
    planned(context, STUDY.replace("[0.2, 0.5]", "[0.2, 0.6]"))  # cases 5 to 8 are others now
    expect("missing: 3, 5 to 8" in report(context, folder, INCOMPLETE), "changed cases count as done")
    output = context.succeeds(["study", "run", folder])
    expect(output.count("done already") == 2 and "case 2: done\n" in output, output)
    report(context, folder)
    expect(all((folder / f"cases/000{n}/result/done.json").stat().st_mtime_ns == t for n, t in before.items()), "a done case was touched")
    expect(not list(folder.glob("cases/*/failed.json")), "a failure was left that is none any more")
    (folder / "cases/0004/scene.yaml").write_text("palpate: 1\n")
    expect("case 4 failed: " in report(context, folder, INCOMPLETE), "a damaged case is not named")


@case
def study_case_that_is_killed(context):
    """What a killed case leaves is no result, and gone after the next run of it; Ctrl-C leaves nothing."""
    folder = planned(context, STUDY.replace("duration: 0.1", "duration: 300"))
    at = folder / "cases/0001"
    for sent in (signal.SIGKILL, signal.SIGINT):
        process = context.start(["study", "run", folder, "--case", "1"])
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and not list(at.glob(f".partial-*-{process.pid}/*")):
            time.sleep(0.02)
        process.send_signal(sent)
        process.communicate(timeout=30)
        left = list(at.glob(".partial-*"))
        expect(process.returncode != 0 and not (at / "result").exists(), "there is a result")
        expect(bool(left) == (sent == signal.SIGKILL), f"after signal {sent}: {left}")
    (at / ".partial-elsewhere-1").mkdir()  # of another machine; it is of no use once the case is done
    (at / "scene.yaml").write_text((at / "scene.yaml").read_text().replace("duration: 300", "duration: 0.1"))
    context.succeeds(["study", "run", folder, "--case", "1"])
    left = sorted(p.name for p in at.iterdir())
    expect(left == ["case.json", "result", "scene.yaml"], f"left: {left}")


@case
def study_of_other_kinds(context):
    """Their rows are those of the commands; hands and materials come into the scenes."""
    text = STUDY[: STUDY.index("seeds")].replace("kind: run", "kind: evaluate") + "visual_steps: [0.02]\nhands: [500/8]\nevaluate: {reference_check: true}\n"
    folder = planned(context, text.replace("vary: {tool.friction: [0.2, 0.5]}\n", ""))
    context.succeeds(["study", "run", folder])
    report(context, folder)
    context.succeeds(["evaluate", folder / "cases/0001/scene.yaml", "--methods", "live,vc", "--visual-dt", "0.02", "--hands", "500/8",
                      "--reference-check", "--out", context.out])  # fmt: skip
    summary = context.summary()
    told = json.loads((folder / "summary.json").read_text())["rows"]
    expect(len(told) == 4 and len(summary["rows"]) == 4, f"{len(told)} rows")
    for row, ours in zip(summary["rows"], told, strict=True):
        different = [key for key in row if row[key] != ours[key]]
        expect(not different, f"{different} differ")
        expect(ours["half_step_rms_N"] == summary["references"][0]["half_step_rms_N"], "the reference is not told")
    text = STUDY[: STUDY.index("vary")].replace("kind: run", "kind: stress")
    text += "materials:\n  - {name: soft, youngs_modulus: 1e4}\n  - {name: firm, youngs_modulus: 8.0e+4}\nstress: {steps: 20}\n"
    folder = planned(context, text, "stress")
    context.succeeds(["study", "run", folder])
    report(context, folder)
    rows = rows_of(folder)
    expect([r["material"] for r in rows] == ["soft", "firm"], "materials are missing")
    code, _, errors = context.run(["stress", folder / "cases/0002/scene.yaml", "--steps", "20", "--out", context.out])
    expect(code in (0, INCOMPLETE), errors)
    expect(context.summary()["max_energy_J"] == float(rows[1]["max_energy_J"]) != float(rows[0]["max_energy_J"]), "another stress")


def study_with(change, words):
    def make(context):
        context.file("scene.yaml", SCENE)
        return ["study", "plan", context.file("study.yaml", change(STUDY)), "--out", context.out], words

    return make


rejected_variants("study-rejects", {
    "unknown-key": study_with(lambda t: t + "method: [vc]\n", ("study.yaml", "line 10", '"method"', '"methods"')),
    "no-kind": study_with(lambda t: t.replace("kind: run\n", ""), ("study.yaml", '"kind" is missing')),
    "no-scene": study_with(lambda t: t.replace("scene.yaml", "none.yaml"), ("none.yaml", "no such file")),
    "value-out-of-range": study_with(lambda t: t.replace("0.5]", "-1]"), ("study.yaml", '"tool.friction":-1', "out of range")),
    "key-of-no-scene": study_with(lambda t: t.replace("tool.friction", "tool.frction"), ("frction", '"friction"')),
    "hand-of-a-stress": study_with(lambda t: t.replace("kind: run", "kind: stress").replace("run: {tables: csv}", "hands: [none]"), ("hands", "stress.hand")),
    "settings-of-another-kind": study_with(lambda t: t + "stress: {steps: 3}\n", ("stress (line 10)", "kind run")),
    "scene-twice": study_with(lambda t: t.replace("[scene.yaml]", "[scene.yaml, ./scene.yaml]"), ("scenes", "press")),
    "body-of-no-scene": study_with(lambda t: t + "materials: [{name: a, of: liver, density: 900}]\n", ("materials", "liver")),
    "visual-step-of-the-machine": study_with(lambda t: t.replace("{duration: 0.1}", "{visual.step: auto}"), ("visual.step", "auto")),
})  # fmt: skip


@case
def study_of_the_documents(context):
    """The example of docs/studies.md is a study, of as many cases as its values make."""
    text = (context.source / "docs/studies.md").read_text()
    example = re.search(r"```yaml\n(.*?)```", text, re.DOTALL).group(1).replace("../scenes", str(context.source / "scenes"))
    output = context.succeeds(["study", "plan", context.file("study.yaml", example), "--out", context.out])
    expect(f"{3 * 2 * 2 * 3} cases" in output, output)


@case
def study_folder_and_case_must_be_there(context):
    context.rejects(["study", "report", context.folder], ("study.json",))
    context.rejects(["study", "run", planned(context), "--case", "9"], ("no case 9", "1 to 8"))


@case
def schema_agrees_with_the_reader(context):
    """What is shipped and a scene of every key hold; keys that nobody knows and numbers out of range do not."""
    packages = {"jsonschema": "python3-jsonschema", "yaml": "python3-yaml"}
    schemas = {kind: context.file(f"{kind}.json", context.succeeds(["schema", kind])) for kind in ("scene", "study")}
    text = (context.source / "tests/scene/scene_text.h").read_text()
    full = re.search(r'kFullScene = R"\((.*?)\)"', text, re.DOTALL).group(1)
    scenes = sorted(p for p in (context.source / "scenes").glob("*.yaml") if p.stem != "one-d")
    studies = sorted((context.source / "studies").glob("*.yaml"))
    expect(len(scenes) > 10 and studies, "where are the scenes and studies?")
    good = [*scenes, context.file("full.yaml", full)]
    for schema, files in ((schemas["scene"], good), (schemas["study"], [*studies, context.file("s.yaml", STUDY)])):
        found = json.loads(with_python(packages, "schema_check.py", schema, *files))
        expect(not any(found.values()), f"{[(k, v) for k, v in found.items() if v][:2]}")
    alien = context.scene("alien").read_text()
    places = ["palpate: 1\n", "  material:", "      region:", "        keyframes:", "  - {name: ground, ", "contact: {"]
    wrong = {}
    for index, place in enumerate(p for p in places if p in alien):
        indent = re.match(r" *", place).group()
        if place.endswith("\n"):
            changed = alien.replace(place, place + "nonsense: 1\n", 1)
        elif place.endswith(":"):
            changed = alien.replace(place, f"{indent}nonsense: 1\n{place}", 1)
        else:
            changed = alien.replace(place, place + "nonsense: 1, ", 1)
        wrong[context.file(f"wrong-{index}.yaml", changed)] = "nonsense"
    expect(len(wrong) >= 4, "scenes/alien.yaml has changed")
    wrong[context.file("range.yaml", re.sub(r"density: [0-9.]+", "density: -3", alien, count=1))] = "density"
    wrong[context.file("kind.yaml", alien.replace("duration: 20 ", "duration: long ", 1))] = "duration"
    wrong[context.file("choice.yaml", alien.replace("palpate: 1\n", "palpate: 1\naim: nowhere\n", 1))] = "aim"
    found = json.loads(with_python(packages, "schema_check.py", schemas["scene"], *wrong))
    for file, word in wrong.items():
        expect(any(word in line for line in found[str(file)]), f"{file.name}: the schema says {found[str(file)]}")
        context.rejects(["validate", file], (word,))


rejected_variants("study-rejects", {
    "value-not-utf8": study_with(lambda t: t.encode().replace(b"0.5]", b"1\xff]"), ("study.yaml", "tool.friction", "is not a number")),
})  # fmt: skip


@case
def study_ends_with_its_cases(context):
    """A signal to the program alone ends the cases at work for it, and what is unfinished goes; after SIGKILL, too."""
    folder = planned(context, STUDY.replace("duration: 0.1", "duration: 300"))
    for sent in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGKILL):
        process = context.start(["study", "run", folder, "--jobs", "2"])
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and len(list(folder.glob("cases/*/.partial-*/*"))) < 2:
            time.sleep(0.02)
        workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.send_signal(sent)
        try:
            process.communicate(timeout=30)  # to the end of the cases, which hold its output too
        except subprocess.TimeoutExpired:
            for worker in workers:
                os.kill(int(worker), signal.SIGKILL)
            raise Failure(f"cases run on after signal {sent}")
        code = -sent if sent == signal.SIGKILL else 128 + sent
        expect(process.returncode == code and len(workers) == 2, f"exit code {process.returncode}, workers {workers}")
        left = list(folder.glob("cases/*/.partial-*"))
        expect(not left, f"after signal {sent}: {left}")
