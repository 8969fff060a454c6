"""Devices: what the program does with each device's protocol and its faults, against the fakes (docs/devices.md)."""

import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

from fakes import PRESS, Fake
from faults import WebSocket, ends, served
from harness import CASES, case, expect


def inverse3(fake, **options):
    options = {"port": fake.about["port"], "events_port": fake.about["events_port"], "rate": 1000, **options}
    return "inverse3:" + ",".join(f"{key}={value}" for key, value in options.items())


def held(context, fake, device, duration=1.0, code=0, signal_at=None):
    """Presses a ball into the ground with a device. @returns summary, the fake's log, standard error"""
    scene = context.file("held.yaml", PRESS.format(duration=duration))
    process = context.start(["run", scene, "--device", device, "--out", context.out])
    if signal_at is not None:
        time.sleep(signal_at)
        process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    expect(process.returncode == code, f"exit code {process.returncode} and not {code}: {errors[-500:]}")
    log = fake.end()
    expect(not log["violations"], f"the fake saw {log['violations'][:3]}")
    expect(not any(log["last_force"]), f"the last force was {log['last_force']}")
    expect(log["uncentered_forces"] == 0, f"{log['uncentered_forces']} forces in a session that had not centered the device")
    return context.summary(), log, errors


def smooth(log, summary=None, bound=0.25, slope=40.0):
    """From one message to the next [N]; a busy machine leaves time between them, in which the hand goes on pressing [N/s].

    The force of one message answers what the tick had read one period before, or as much longer as it waited for its turn
    (`summary` says how long at most); by then the answer to the message before that one had arrived."""
    if log["largest_step"] <= bound:
        return
    expect("history" in log, f"the force jumped by {log['largest_step']} N")  # a library that calls by itself has none
    tick = 1e-3 + (1e-6 * summary["haptic"]["wake_us"]["max"] if summary else 0.0)
    history = [[-1, 0, 0, 0], *log["history"]]
    read = 0
    for k in range(1, len(history)):
        before, after = history[k - 1], history[k]
        while read + 1 < k and history[read + 1][0] <= before[0] - tick:
            read += 1
        # up to the first force behind the gate no time is told, and none is granted
        passed = 0.0 if after[0] < 0 else after[0] - max(0.0, history[max(0, read - 1)][0])
        step = math.dist(before[1:], after[1:])
        expect(step <= bound + slope * passed, f"the force jumped by {step} N in {passed} s")


@case
def devices_lists_all(context):
    text = context.succeeds(["devices", "--report", context.folder / "report.json"])
    expect("nothing listens at localhost:10001" in text or "Inverse3" in text, text)
    report = json.loads((context.folder / "report.json").read_text())
    kinds = [device["kind"] for device in report["devices"]]
    expect(kinds[0] == "inverse3" and all("not_there" in d or "limits" in d for d in report["devices"]), str(report))


@case
def devices_options(context):
    text = context.succeeds(["devices", "--options"])
    expect("motion_scale" in text and "events_port" in text, text)
    context.rejects(["devices", "--device", "inverse3:prot=1"], ["--device", "prot", "nearest known option is \"port\""])
    context.rejects(["devices", "--device", "inverse3:turn=north"], ["--device", "turn"])
    context.rejects(["devices", "--device", "simulated:port=1"], ["no options"])
    code, _, errors = context.run(["evaluate", context.file("s.yaml", PRESS.format(duration=1) + "device: {type: inverse3}\n")])
    expect(code == 2 and "only for palpate run and palpate view" in errors, errors)
    context.rejects(["validate", context.file("t.yaml", PRESS.format(duration=1) + "device: {type: inverse3, options: {prot: 1}}\n")],
                    ["device.options", "port"])
    context.succeeds(["validate", context.file("u.yaml", PRESS.format(duration=1) + "device: {type: inverse3, options: {port: 1}}\n")])


@case
def devices_inverse3_report(context):
    """What a trial sends: everything that changes forces, and nothing that tells whose it is."""
    with Fake(context, "fake_inverse3", "--grip") as fake:
        file = context.folder / "report.json"
        text = context.succeeds(["devices", "--test", inverse3(fake, host="127.0.0.1"), "--report", file])
        expect("049D" in text and "radius 0.1 m" in text, text)
        report = json.loads(file.read_text())["devices"][0]
        expect("049D" not in file.read_text() and "127.0.0.1" not in file.read_text(), "the report holds private data")
        expect(report["says"]["gravity compensation"] == "true" and report["says"]["grip"] == "verse_grip", str(report))
        expect(report["test"]["with_a_state"] > 1500, str(report["test"]))
        log = fake.end()
    expect(not log["violations"] and log["profile"] == "org.palpate:run" and log["preset"] == "arm_front_centered", str(log["violations"]))
    expect(log["max_force"] <= 0.1001, "a test gave a force")


@case
def devices_report_hides(context):
    """What a reason names is hidden as well: other devices' names, folders, the machine."""
    file = context.folder / "report.json"
    with Fake(context, "fake_inverse3", "--fault", "second") as fake:
        code, _, errors = context.run(["devices", "--device", inverse3(fake), "--report", file])
        expect(code == 1 and "049D, 04EA" in errors, errors)
    text = file.read_text()
    expect("049D" not in text and "04EA" not in text and "choose one" in text, text)
    for device in (f"touch:library={context.folder}/libHD.so", f"spacenavigator:socket={context.folder}/none"):
        context.run(["devices", "--device", device, "--report", file])
        text = file.read_text()
        expect("not_there" in text and str(context.folder) not in text and os.uname().nodename not in text, text)


@case
def devices_start_gate(context):
    """On a device on a desk the force waits until somebody has hold of it."""
    scene = PRESS.replace("safety: {{start_gate: false}}\n", "")
    expect(scene != PRESS, "the scene has no gate to leave out")
    with Fake(context, "fake_inverse3", "--amplitude", "0.008") as fake:
        file = context.file("held.yaml", scene.format(duration=3.0).replace("0.005]", "-0.004]"))
        context.succeeds(["run", file, "--device", inverse3(fake), "--out", context.out])
        log = fake.end()
    expect(not log["violations"] and not any(log["last_force"]), str(log["violations"]))
    header, rows = context.table("haptic.csv")
    time_s, force = header.index("time_s"), [k for k, name in enumerate(header) if name in ("sent_fx_N", "sent_fy_N", "sent_fz_N")]
    strongest = {False: 0.0, True: 0.0}
    for row in rows:
        late = float(row[time_s]) > 0.55
        strongest[late] = max(strongest[late], math.hypot(*[float(row[k]) for k in force]))
    expect(strongest[False] <= 0.1001 and strongest[True] > 0.2, f"forces {strongest} before and behind the gate")


@case
def devices_link_is_cut(context):
    """A link that is stiffer than the device bears is cut, and that is told."""
    with Fake(context, "fake_inverse3") as fake:
        scene = context.file("held.yaml", PRESS.format(duration=0.3) + "link: {stiffness: 5000, damping: 1}\n")
        process = context.start(["run", scene, "--device", inverse3(fake), "--out", context.out])
        _, errors = process.communicate(timeout=30)
        expect(process.returncode == 0, errors)
    hardware = context.summary()["hardware"]
    expect(hardware["link"]["stiffness_N_m"] == 500 and hardware["link"]["damping_Ns_m"] == 1, str(hardware["link"]))
    expect("5000 N/m is cut" in errors and "5000 N/m is cut" in " ".join(hardware["notes"]), errors)


def refused(name, words, *faults, device=None):
    """A device that is not to be had, and the reason that is told."""

    def run(context):
        with Fake(context, "fake_inverse3", *faults) as fake:
            code, _, errors = context.run(["devices", "--test", inverse3(fake, **(device or {}))], timeout=30)
            expect(code == 1 and words in errors, f"exit code {code}, {errors!r}")
            log = fake.end()
        expect(not log["violations"], str(log["violations"]))
        expect(not any(log["last_force"]), "a force was left")

    CASES["devices-inverse3-" + name] = run


refused("no-device", "has no Inverse3", "--fault", "no-device")
refused("no-power", "no power supply", "--fault", "no-power")
refused("uncalibrated", "not calibrated", "--fault", "uncalibrated")
refused("in-use", "in use by another program", "--fault", "in-use")
refused("legacy", "legacy format 3.0", "--fault", "legacy")
refused("two", "choose one with inverse3:id=", "--fault", "second")
refused("other-id", "there is no device 1234", device={"id": "1234"})


def spelled(name, version, spelling, used):
    def run(context):
        with Fake(context, "fake_inverse3", "--version", version, "--spelling", spelling) as fake:
            context.succeeds(["devices", "--test", inverse3(fake)])
            log = fake.end()
        expect(not log["violations"] and log["spellings"][-1] == used, f"{log['spellings']} {log['violations']}")

    CASES["devices-inverse3-" + name] = run


spelled("values", "3.4.8", "values", "values")
spelled("vector", "3.5.0", "vector", "vector")
spelled("both", "3.5.1", "both", "vector")
spelled("old-service-vector", "3.4.8", "vector", "vector")  # what the version says is not what it does
spelled("new-service-values", "3.5.0", "values", "values")


@case
def devices_inverse3_run(context):
    """The hand presses the ball 1.5 cm into the ground and lifts it again."""
    with Fake(context, "fake_inverse3", "--fault", "integers", "--fault", "unknown", "--grip") as fake:
        summary, log, _ = held(context, fake, inverse3(fake, rate=4000), duration=2.5)
    smooth(log, summary)
    hardware = summary["hardware"]
    expect(summary["realtime"] and summary["device"] == "inverse3", "not in real time")
    expect(hardware["says"]["spelling of a force"] == "vector" and hardware["losses"] == 0, str(hardware))
    expect(0.5 < log["max_force"] < 5.01, f"the largest force was {log['max_force']} N")
    expect(abs(log["first_force"] - 0.1) < 1e-9, "the first force is the gate's")
    expect(log["forces"] > 250, f"{log['forces']} messages")  # up to 10,000 on a machine with time for them
    expect(summary["lost_torque"]["peak_Nm"] >= 0, "no lost torque")


def fails(name, fault, judge, duration=1.6, code=0, options=(), step=6.0, **device):
    """A fault a while after the first contact."""

    def run(context):
        with Fake(context, "fake_inverse3", "--fault", f"{fault}@0.3", *options) as fake:
            summary, log, errors = held(context, fake, inverse3(fake, **device), duration, code)
        judge(summary, log, errors)
        expect(log["max_force"] > 0.2, "there was no force before the fault")
        expect(log["largest_step"] <= step, f"the force jumped by {log['largest_step']} N")

    CASES["devices-inverse3-" + name] = run


def lost(times, note=""):
    """So often, and once more for each answer that the program says was late: a busy machine makes its own."""

    def judge(summary, log, _):
        hardware = summary["hardware"]
        late = re.search(r"answers later than 50 ms(?: \((\d+) times\))?", " ".join(hardware["notes"]))
        most = math.inf if times > 1 else times + (int(late[1] or 1) if late and note not in late[0] else 0)
        expect(times <= hardware["losses"] <= most, f"lost {hardware['losses']} times and not {times}: {hardware}")
        expect(note in " ".join(hardware["notes"]), f"no {note!r} in {hardware['notes']}")
        expect(log["non_zero_while_away"] <= 4, f"{log['non_zero_while_away']} forces while there was no device")

    return judge


def gave_up(reason):
    def judge(summary, log, errors):
        expect(reason in errors and summary["failure"], errors)
        expect(summary["end_s"] < 5, "it went on")
        expect(log["non_zero_while_away"] <= 4, "forces while there was no device")

    return judge


fails("unplugged", "unplug", gave_up("unplugged"), 20, 1, patience=0.3)
fails("taken", "taken", gave_up("taken by another program"), 20, 1, patience=0.3)
fails("silent", "never", gave_up("answers late"), 20, 1, patience=0.3)
fails("garbage", "garbage", gave_up("no longer answers"), 20, 1, patience=0.3)
fails("comes-back", "replug", lost(1, "came back as 05FF"), 2.2)
fails("connection-restarts", "restart", lost(1, "connected again"), 2.2)
fails("events-end", "events-end", lost(0, "the events ended"))
fails("late", "late", lost(1, "later than 50 ms"))
fails("slow", "slow", lost(3, "later than 50 ms"))
fails("twice", "twice", lost(0, "nobody had asked for"))
fails("cut", "cut", lost(0, "could not be read"))
fails("ebrake", "ebrake", lost(1, "ebrake_triggered"))
fails("nan", "nan", gave_up("no longer answers"), 20, 1, patience=0.3)


@case
def devices_inverse3_jump(context):
    with Fake(context, "fake_inverse3", "--fault", "jump@0.3") as fake:
        summary, log, _ = held(context, fake, inverse3(fake), 1.5)
    expect(summary["hardware"]["jumps"] == 1, str(summary["hardware"]))
    expect(log["largest_step"] < 3.0, f"the force jumped by {log['largest_step']} N")


@case
def devices_inverse3_interrupted(context):
    """Ctrl+C: the force leaves, and the last one is zero."""
    with Fake(context, "fake_inverse3") as fake:
        summary, log, _ = held(context, fake, inverse3(fake), 30, 130, signal_at=2.2)
    expect(summary["interrupted"], "not interrupted")
    smooth(log, summary)


@case
def devices_inverse3_killed_loop(context):
    """A process that stands sends nothing; when it goes on, the force begins from zero."""
    with Fake(context, "fake_inverse3") as fake:
        scene = context.file("held.yaml", PRESS.format(duration=3.0))
        process = context.start(["run", scene, "--device", inverse3(fake), "--out", context.out])
        time.sleep(2.0)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        process.send_signal(signal.SIGCONT)
        _, errors = process.communicate(timeout=30)
        log = fake.end()
    expect(process.returncode == 0, errors)
    log["history"] = [h for h in log["history"] if h[0] >= 0]  # from the first force on
    times = [h[0] for h in log["history"]]
    gap = max(range(1, len(times)), key=lambda i: times[i] - times[i - 1])
    expect(times[gap] - times[gap - 1] > 0.4, "it did not stand")
    after = [max(map(abs, h[1:])) for h in log["history"][gap:] if times[gap] + 0.001 < h[0] < times[gap] + 0.011]
    around = log["history"][gap - 2:gap + 60:6]
    expect(max(after) < 0.2, f"after the gap the force was {max(after)} N: {around}")


# Libraries that stand for the vendors' (tests/devices/fakes), told what to play by the environment.


def library(context, name):
    file = pathlib.Path(context.program).resolve().parent / "fakes" / f"libfake_{name}.so"
    expect(file.exists(), f"{file} was not built")
    return file


def with_library(context, arguments, fault, code, timeout=40, signal_at=None):
    """@returns the library's log, standard output and standard error"""
    log = context.folder / "library.json"
    environment = {**os.environ, "PALPATE_FAKE_FAULT": fault, "PALPATE_FAKE_LOG": str(log)}
    process = context.start(arguments, env=environment)
    if signal_at is not None:
        time.sleep(signal_at)
        process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=timeout)
    expect(process.returncode == code, f"exit code {process.returncode} and not {code}: {errors[-600:]}")
    # written by the library before the program ends, whatever becomes of it
    result = json.loads(log.read_text()) if log.exists() else {"violations": [], "calls": [], "last_force": [0, 0, 0]}
    expect(not result["violations"], f"the library saw {result['violations'][:3]}")
    expect(not any(result["last_force"]), f"the last force was {result['last_force']}")
    return result, output, errors


def library_refused(device, fake, name, fault, words, options=""):
    def run(context):
        arguments = ["devices", "--test", f"{device}:library={library(context, fake)}{options}"]
        _, _, errors = with_library(context, arguments, fault, 1)
        expect(words in errors, errors)

    CASES[f"devices-{device.replace('_', '-')}-{name}"] = run


def library_run(device, fake, name, fault, judge, duration=1.6, code=0, options="", signal_at=None):
    def run(context):
        scene = context.file("held.yaml", PRESS.format(duration=duration))
        arguments = ["run", scene, "--device", f"{device}:library={library(context, fake)}{options}", "--out", context.out]
        log, _, errors = with_library(context, arguments, fault, code, signal_at=signal_at)
        expect(log["max_force"] > 0.2, "there was no force")
        expect(log["largest_step"] < 4.0, f"the force jumped by {log['largest_step']} N")
        judge(context.summary(), log, errors)

    CASES[f"devices-{device.replace('_', '-')}-{name}"] = run


def well(summary, log, _):
    """Nothing is lost but what the firmware's watchdog took: a busy machine may keep a tick from it for so long."""
    hardware = summary["hardware"]
    expect(hardware["losses"] <= log["starved"], f"{log['starved']} times starved: {hardware}")
    expect(hardware["notes"] == [] or log["starved"], str(hardware))
    expect(log["largest_step"] < 0.3 or log["starved"], f"the force jumped by {log['largest_step']} N")


def calibrated(summary, log, _):
    expect("update-calibration" in log["calls"], str(log["calls"]))
    expect(summary["hardware"]["says"].get("calibration") == "updated at the start", str(summary["hardware"]["says"]))


def once_lost(note):
    def judge(summary, log, _):
        hardware = summary["hardware"]
        most = max(log["starved"], 1) if note == "watchdog" else 1 + log["starved"]
        expect(1 <= hardware["losses"] <= most, f"lost {hardware['losses']} times, not {most}: {hardware['notes']}")
        expect(note in " ".join(hardware["notes"]), f"no {note!r} in {hardware['notes']}")

    return judge


def ended(reason):
    def judge(summary, log, errors):
        expect(reason in errors and summary["failure"], errors)
        expect(summary["end_s"] < 5, "it went on")

    return judge


library_refused("force_dimension", "dhd", "none", "none-connected", "no device is connected")
library_refused("force_dimension", "dhd", "in-use", "in-use", "in use by another program")
library_refused("force_dimension", "dhd", "no-power", "no-power", "no power")
library_refused("force_dimension", "dhd", "uninitialized", "uninitialized", "keep clear of it")
library_refused("force_dimension", "hd", "wrong-library", "", "is it the right library?")


@case
def devices_force_dimension_list(context):
    log, text, _ = with_library(context, ["devices", "--device", f"force_dimension:library={library(context, 'dhd')}"], "uninitialized", 0)
    expect("omega.3 4711" in text and "12 N" in text and "SDK: 3.17.0.1" in text, text)
    expect(log["calls"] == ["open", "close"], str(log["calls"]))


@case
def devices_force_dimension_init(context):
    log, _, _ = with_library(context, ["devices", "--test", f"force_dimension:library={library(context, 'dhd')},auto_init=yes"],
                             "uninitialized", 0)
    order = ["open", "auto-init", "watchdog", "velocity-threshold", "force-on", "force-off", "close"]
    expect(log["calls"] == order, str(log["calls"]))


library_run("force_dimension", "dhd", "run", "", well)
library_run("force_dimension", "dhd", "button", "button@0.3", ended("device's button"), 20, 1, ",patience=0.3")
library_run("force_dimension", "dhd", "velocity", "velocity@0.3", once_lost("moved too fast"))
library_run("force_dimension", "dhd", "deadman", "deadman@0.3", once_lost("nobody holds it"))
library_run("force_dimension", "dhd", "software", "software@0.3", once_lost("by software"))
library_run("force_dimension", "dhd", "usb", "usb@0.3", once_lost("USB"))
library_run("force_dimension", "dhd", "unplugged", "unplug@0.3", ended("is it unplugged?"), 20, 1, ",patience=0.3")
library_run("force_dimension", "dhd", "watchdog", "late@0.3", once_lost("watchdog"))
library_run("force_dimension", "dhd", "position", "position@0.3", ended("no state"), 20, 1, ",patience=0.3")
library_run("force_dimension", "dhd", "interrupted", "", lambda s, *_: expect(s["interrupted"], "not interrupted"), 20, 130, signal_at=1.5)

library_refused("touch", "hd", "none", "no-device", "is it unplugged?")
library_refused("touch", "hd", "in-use", "in-use", "in use by another program")
library_refused("touch", "hd", "license", "license", "no license")
library_refused("touch", "hd", "uncalibrated", "uncalibrated", "inkwell")
library_run("touch", "hd", "outdated", "outdated", calibrated)
library_refused("touch", "hd", "by-hand", "by-hand", "positions do not change")
library_refused("touch", "hd", "other-name", "", "not configured", ",name=Other")
library_refused("touch", "dhd", "wrong-library", "", "is it the right library?")


@case
def devices_touch_old_name(context):
    _, text, _ = with_library(context, ["devices", "--device", f"touch:library={library(context, 'hd')}"], "old-name", 0)
    expect("PHANTOM Omni" in text and "3.3 N, 0.88 N for long, no torque, 500 N/m, 5 N s/m" in text, text)


def well_kept(summary, log, _):
    well(summary, log, _)
    expect(log["calls"] == ["init", "check-calibration", "enable-force", "schedule", "start", "stop", "unschedule", "disable"],
           str(log["calls"]))
    expect(log["last_zeros"] >= 20, "zero was not sent for some ticks at the end")
    ticks = summary["haptic"]["ticks"]
    expect(0.95 * 1600 < ticks < 1.05 * 1600, f"{ticks} ticks in 1.6 s")


def survived(note):
    def judge(summary, log, _):
        expect(summary["hardware"]["losses"] == 0, str(summary["hardware"]))
        expect(note in " ".join(summary["hardware"]["notes"]), str(summary["hardware"]))

    return judge


library_run("touch", "hd", "run", "", well_kept)
library_run("touch", "hd", "warm", "warm@0.2", survived("motors too warm"))
library_run("touch", "hd", "max-force", "force@0.2", survived("force above"))
library_run("touch", "hd", "velocity", "velocity@0.2", survived("too fast"))
library_run("touch", "hd", "unplugged", "unplug@0.3", ended("unplugged"), 20, 1, ",patience=0.3")
library_run("touch", "hd", "nan", "nan@0.3", ended("no longer answers"), 20, 1, ",patience=0.3")
library_run("touch", "hd", "interrupted", "", lambda s, *_: expect(s["interrupted"], "not interrupted"), 20, 130, signal_at=1.5)


@case
def devices_touch_silent(context):
    """The library calls no more: nothing can be sent, and the run ends with the reason."""
    scene = context.file("held.yaml", PRESS.format(duration=20))
    log = context.folder / "library.json"
    environment = {**os.environ, "PALPATE_FAKE_FAULT": "silent@0.3", "PALPATE_FAKE_LOG": str(log)}
    process = context.start(["run", scene, "--device", f"touch:library={library(context, 'hd')}", "--out", context.out], env=environment)
    _, errors = process.communicate(timeout=30)
    expect(process.returncode == 1 and "calls no more" in errors, errors)
    expect(context.summary()["end_s"] < 5, "it went on")


@case
def devices_touch_step(context):
    """A device that ticks by itself does not do so at another rate."""
    scene = context.file("held.yaml", PRESS.format(duration=1) + "haptic: {step: 0.0005}\n")
    arguments = ["run", scene, "--device", f"touch:library={library(context, 'hd')}", "--out", context.out]
    code, _, errors = context.run(arguments)
    expect(code == 2 and "ticks by itself at 1000 Hz" in errors, errors)


# spacenavd


def navigated(name, protocol, *faults, code=0, judge=None):
    def run(context):
        path = str(context.folder / "spnav.sock")
        arguments = ["--socket", path, "--protocol", str(protocol), *[a for f in faults for a in ("--fault", f)]]
        with Fake(context, "fake_spacenavd", *arguments) as fake:
            scene = context.file("held.yaml", PRESS.format(duration=2.0).replace("0.005]", "0.1]"))
            process = context.start(["run", scene, "--device", "spacenavigator:speed=0.1,spin=90", "--out", context.out],
                                    env={**os.environ, "SPNAV_SOCKET": path})
            _, errors = process.communicate(timeout=30)
            expect(process.returncode == code, errors)
            log = fake.end()
        expect(not log["violations"], str(log["violations"]))
        header, rows = context.table("motion.csv")
        first, last = rows[0], rows[-1]
        way = [float(last[header.index(k)]) - float(first[header.index(k)]) for k in ("x_m", "y_m", "z_m")]
        turn = [float(last[header.index(k)]) for k in ("qw", "qx", "qy", "qz")]
        (judge or moved)(way, turn, log, context.summary(), errors)

    CASES["devices-spacenavigator-" + name] = run


def moved(way, turn, log, summary, _):
    """Right by 0.4 s at half of 0.1 m/s; away by 0.4 s at all of it, and up at half; and then nothing more."""
    for k, wanted in enumerate((0.020, 0.040, 0.020)):
        expect(abs(way[k] - wanted) < 0.008, f"it moved by {way}")
    angle = 2 * math.atan2(turn[3], turn[0])
    expect(abs(math.degrees(angle) - 18) < 6, f"it turned by {math.degrees(angle)} degrees about z")
    expect(summary["hardware"]["losses"] == 0, str(summary["hardware"]))


def says(fact, value, then=moved):
    def judge(way, turn, log, summary, errors):
        expect(summary["hardware"]["says"].get(fact) == value, str(summary["hardware"]["says"]))
        then(way, turn, log, summary, errors)

    return judge


def half_way(note):
    def judge(way, turn, log, summary, errors):
        expect(way[0] < 0.02 and abs(way[1]) < 0.002, f"it went on by {way}")
        expect(note in errors + " ".join(summary["hardware"]["notes"]), errors)

    return judge


navigated("protocol-1", 1, judge=says("USB", "046d:c626"))
navigated("protocol-0", 0, judge=says("protocol", "0"))
navigated("no-answer", 1, "silent", judge=says("protocol", "0"))
navigated("pieces", 1, "pieces")
navigated("chatter", 1, "chatter", "noise", judge=says("buttons", "2"))
navigated("unplugged", 1, "unplug@0.2", judge=half_way("unplugged"))
navigated("restart", 1, "restart@0.2", code=1, judge=half_way("connection to spacenavd is lost"))


@case
def devices_spacenavigator_none(context):
    code, _, errors = context.run(["devices", "--device", f"spacenavigator:socket={context.folder}/none"])
    expect(code == 1 and "is spacenavd installed and running?" in errors, errors)


def view_in_hand(context, device, environment=None):
    """Holds a scene in the viewer, with a pause and a reset."""
    scene = context.file("held.yaml", PRESS.format(duration=30))
    process, port = served(context, "view", scene, "--device", device, env={**os.environ, **(environment or {})})
    viewer = WebSocket(port)
    time.sleep(2.2)
    viewer.send(type="pause")
    time.sleep(0.6)
    viewer.send(type="resume")
    viewer.send(type="reset")
    time.sleep(1.0)
    ends(process, 5)
    viewer.close()


def judge_view(log):
    expect(not log["violations"] and not any(log["last_force"]), f"{log['violations']} {log['last_force']}")
    expect(log["max_force"] > 0.2, "there was no force")
    smooth(log, bound=0.5)


@case
def devices_view(context):
    """It goes on over a reset; the force leaves for a pause and at the end."""
    with Fake(context, "fake_inverse3") as fake:
        view_in_hand(context, inverse3(fake))
        judge_view(fake.end())


@case
def devices_view_servo(context):
    """The same where the device's library calls."""
    file = context.folder / "library.json"
    view_in_hand(context, f"touch:library={library(context, 'hd')}", {"PALPATE_FAKE_LOG": str(file), "PALPATE_FAKE_FAULT": ""})
    log = json.loads(file.read_text())
    judge_view(log)
    expect(log["calls"].count("init") == 1 and log["calls"].count("start") == log["calls"].count("stop") >= 2, str(log["calls"]))


@case
def devices_replay(context):
    """A run with a device is looked at and exported without it."""
    with Fake(context, "fake_inverse3") as fake:
        held(context, fake, inverse3(fake), duration=0.4)
    context.succeeds(["export", context.out, "--out", context.folder / "series"])
    context.succeeds(["run", context.file("again.yaml", PRESS.format(duration=0.4)), "--device",
                      f"recorded:{context.out / 'motion.csv'}", "--out", context.folder / "again"])


# The fakes themselves: what a wrong client does, they must see.


def wrong_client(context, *messages):
    with Fake(context, "fake_inverse3") as fake:
        client = WebSocket(fake.about["port"])
        expect("session_id" in client.read(), "no inventory")
        for message in messages:
            client.send(**message)
            time.sleep(0.05)
        client.close()
        return fake.end()["violations"]


def force(body, device="049D", **more):
    return {"inverse3": [{"device_id": device, "commands": {"set_cursor_force": body}, **more}]}


@case
def devices_fake_inverse3_is_strict(context):
    zero = {"x": 0, "y": 0, "z": 0}
    good = force({"vector": zero})
    expect(not wrong_client(context, good, good), "a right client was refused")
    session = {"session": {"configure": {"profile": {"name": "a:b"}}}}
    for wrong, words in (([force({"vektor": zero})], "a force with"), ([force({"vector": {"x": 0, "y": 0}})], "a force of"),
                         ([force({"vector": {**zero, "x": "1"}})], "a force of"), ([force({"vector": zero}, "0000")], "no device"),
                         ([{"inverse4": []}], "unknown keys"), ([good, session], "after the first message"),
                         ([{"inverse3": [{"device_id": "049D", "commands": {"set_force": {}}}]}], "unknown command"),
                         ([good, force({"vector": zero}, configure={"preset": {"preset": "x"}})], "a preset after")):
        violations = wrong_client(context, *wrong)
        expect(violations and words in violations[0], f"{wrong}: {violations}")


WRONG_HD = """
import ctypes, sys
hd = ctypes.CDLL(sys.argv[1])
three = (ctypes.c_double * 16)()
hd.hdInitDevice(b"Default Device")
hd.hdGetDoublev(0x2050, three)
hd.hdBeginFrame(0)
hd.hdBeginFrame(0)
three[0] = 1.0
hd.hdSetDoublev(0x2700, three)
hd.hdEndFrame(0)
hd.hdEndFrame(0)
hd.hdInitDevice(b"Default Device")
hd.hdDisableDevice(0)
hd.hdBeginFrame(0)
"""
WRONG_DHD = """
import ctypes, sys
dhd = ctypes.CDLL(sys.argv[1])
dhd.dhdSetBrakes(0, -1)
dhd.drdOpenID(-1)
dhd.dhdSetWatchdog(100, -1)
dhd.dhdEnableForce(1, -1)
dhd.dhdSetForceAndTorqueAndGripperForce(*[ctypes.c_double(1.0)] * 7, -1)
dhd.dhdClose(-1)
"""


def wrong_library(context, name, script):
    log = context.folder / "wrong.json"
    environment = {**os.environ, "PALPATE_FAKE_LOG": str(log), "PALPATE_FAKE_FAULT": ""}
    subprocess.run([sys.executable, "-c", script, str(library(context, name))], env=environment, timeout=20, check=True)
    return " ".join(json.loads(log.read_text())["violations"])


@case
def devices_fake_libraries_are_strict(context):
    seen = wrong_library(context, "hd", WRONG_HD)
    for words in ("a get outside a frame", "a frame within a frame", "a force before it was enabled", "more than one init",
                  "the end of no frame", "disabled with a force on it", "a frame of no device"):
        expect(words in seen, f"no {words!r} in {seen}")
    seen = wrong_library(context, "dhd", WRONG_DHD)
    for words in ("on a device that is not open", "watchdog without expert mode", "without the watchdog", "a torque for a device without",
                  "closed with a force on it"):
        expect(words in seen, f"no {words!r} in {seen}")
