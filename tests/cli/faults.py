"""Faults: what a run does when the system or the people around it do not do their part (docs/faults.md)."""

import base64
import json
import os
import pathlib
import re
import resource
import signal
import socket
import struct
import subprocess
import time

from harness import SCENE, Skip, case, expect

HEAVY = "{sphere: {radius: 0.05}}\n  tetrahedra: 200000"  # half a minute of meshing
SHAPE = "{bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}"


class WebSocket:
    """As much of a viewer as a test needs."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
                             f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n").encode())
        self.stream = self.socket.makefile("rb")
        while self.stream.readline() not in (b"\r\n", b""):
            pass

    def send(self, **message):
        payload = json.dumps(message).encode()
        mask = os.urandom(4)
        size = bytes([0x80 | len(payload)]) if len(payload) < 126 else b"\xfe" + struct.pack(">H", len(payload))
        self.socket.sendall(b"\x81" + size + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload)))

    def close(self):
        self.stream.close()
        self.socket.close()

    def read(self):
        """The next message: a dictionary, or the bytes of a binary one. Frames are acknowledged."""
        head = self.stream.read(2)
        expect(len(head) == 2, "the connection ended")
        size = head[1] & 127
        if size > 125:
            size = int.from_bytes(self.stream.read(2 if size == 126 else 8), "big")
        payload = self.stream.read(size)
        if head[0] & 15 == 1:
            return json.loads(payload)
        if head[0] & 15 == 2 and payload[0] == 2:
            self.send(type="ack", frame=struct.unpack_from("<I", payload, 8)[0])
        return payload

    def until(self, what, seconds, condition):
        """The first message of which it holds."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            message = self.read()
            if condition(message):
                return message
        expect(False, f"no {what} within {seconds} s")


def is_json(kind, **values):
    return lambda m: isinstance(m, dict) and m["type"] == kind and all(m.get(k) == v for k, v in values.items())


def served(context, *arguments, **options):
    process = context.start([*arguments, "--port", "0"], **options)
    line = process.stdout.readline()
    found = re.search(r":(\d+)/", line)
    expect(found, f"no address in {line!r}: {'' if found else process.communicate()[1]}")
    return process, int(found.group(1))


def ends(process, within, sent=signal.SIGINT):
    """Seconds that it takes to end after a signal, and its standard error."""
    process.send_signal(sent)
    begin = time.monotonic()
    try:
        errors = process.communicate(timeout=60)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        errors = ""
    took = time.monotonic() - begin
    expect(took < within, f"took {took:.1f} s to end after signal {sent}")
    return errors


def recorded_rows(context, folder):
    """Times of the ticks in a recording; every row is whole."""
    header, rows = context.table("haptic.csv", folder)
    expect(rows, "no row was recorded")
    context.table("visual.csv", folder)
    return [float(row[0]) for row in rows]


def fill_the_disk(context, out, **options):
    """A recording viewer whose disk fills up after a second or two: it says so, goes on, and fails in the end."""
    process, port = served(context, "view", context.file("scene.yaml", SCENE), "--record", "--out", out, **options)
    try:
        viewer = WebSocket(port)
        told = {}  # in either order

        def both(message):
            if is_json("notice", level="error")(message) or is_json("state", recording=None)(message):
                told[message["type"]] = message
            return len(told) == 2

        viewer.until("message of the full disk, and state without a recording", 20, both)
        expect("recording ended" in told["notice"]["text"] and str(out) in told["notice"]["text"], f"{told['notice']}")
        for _ in range(20):  # frames go on
            viewer.until("frame", 5, lambda m: isinstance(m, bytes) and m[0] == 2)
        viewer.send(type="reset")
        viewer.until("new scene", 10, is_json("scene"))
        errors = ends(process, 3)
    finally:
        process.kill()
    expect(process.returncode == 1, f"exit code {process.returncode} after a recording that failed")
    expect("recording ended" in errors, f"standard error does not say it: {errors!r}")
    folders = list(pathlib.Path(out).iterdir())
    expect(len(folders) == 1, f"recordings {folders}")
    expect(not list(folders[0].glob(".*")), f"left behind: {list(folders[0].glob('.*'))}")
    summary = context.summary(folders[0])
    expect(summary["ended_by"] == "failure" and summary["failure"], f"summary: {summary.get('ended_by')}")
    times = recorded_rows(context, folders[0])
    expect(times[-1] > summary["end_s"] - 1, f"recorded up to {times[-1]} s of {summary['end_s']} s")
    recording = (folders[0] / "recording.palpate").read_bytes()
    at = 8
    while at < len(recording):
        at += 8 + -(-struct.unpack_from("<I", recording, at + 4)[0] // 8) * 8
    expect(at == len(recording), "recording.palpate ends in the middle of a record")


@case
def fault_file_too_large_while_view_records(context):
    """A limit on the size of files, as a quota sets one."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))

    fill_the_disk(context, context.out, preexec_fn=limit)


@case
def fault_disk_full_while_view_records(context):
    """1 MB of tmpfs, where the system lets us have one."""
    small = context.folder / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", small], capture_output=True)
    if mounted.returncode != 0:
        return
    try:
        fill_the_disk(context, small / "recorded")
    finally:
        subprocess.run(["umount", "-l", small], check=True)


@case
def fault_disk_full_while_a_scene_runs(context):
    """It ends at once, with what fits, and fails."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))

    arguments = ["run", context.file("scene.yaml", SCENE), "--duration", "600", "--out", context.out]
    process = context.start(arguments, preexec_fn=limit)
    _, errors = process.communicate(timeout=60)
    expect(process.returncode == 1 and "cannot be written" in errors, f"exit code {process.returncode}: {errors!r}")
    summary = context.summary()
    expect(summary["ended_by"] == "failure" and not summary["interrupted"], f"ended by {summary['ended_by']}")
    expect(recorded_rows(context, context.out)[-1] > summary["end_s"] - 1, "rows are missing")


@case
def fault_flood_of_resets(context):
    """One viewer asks for 200 resets: others are answered, and Ctrl-C ends it."""
    scene = context.file("scene.yaml", SCENE.replace(SHAPE, "{sphere: {radius: 0.04}}\n  tetrahedra: 2000"))
    process, port = served(context, "view", scene)
    try:
        rude = WebSocket(port)
        for _ in range(200):
            rude.send(type="reset")
        other = WebSocket(port)
        other.send(type="set", friction=3)
        begin = time.monotonic()
        other.until("answer", 12, is_json("state", friction=3.0))
        for _ in range(200):
            rude.send(type="reset")
            rude.send(type="set", handle="top", friction=1)
            rude.send(type="scene", name="press")
        time.sleep(0.3)
        ends(process, 2, signal.SIGTERM)
    finally:
        process.kill()
    expect(process.returncode == 0, f"exit code {process.returncode}")


def interrupted_run(context, *options, sent=signal.SIGINT):
    """A run of ten minutes that a signal ends after a second: the exit code is a shell's, and what there is is there."""
    arguments = ["run", context.file("scene.yaml", SCENE), "--duration", "600", "--out", context.out, *options]
    process = context.start(arguments)
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and not (context.out.exists() and any(context.out.iterdir())):
        time.sleep(0.02)
    time.sleep(1)
    expect(process.poll() is None, "ended by itself")
    errors = ends(process, 4, sent)
    expect(process.returncode == 128 + sent, f"exit code {process.returncode} after signal {sent}: {errors!r}")
    expect("interrupted" in errors, f"standard error does not say it: {errors!r}")
    expect(not list(context.out.glob(".*")), f"left behind: {list(context.out.glob('.*'))}")
    summary = context.summary()
    expect(summary["interrupted"] and summary["ended_by"] == signal.Signals(sent).name, f"by {summary['ended_by']}")
    expect("ended early" in (context.out / "report.html").read_text(), "the report does not say it")
    rows = recorded_rows(context, context.out)
    expect(len(rows) == summary["haptic"]["ticks"] > 100, f"{len(rows)} rows of {summary['haptic']['ticks']} ticks")
    return summary


def sent_forces(context):
    header, rows = context.table("haptic.csv")
    at = header.index("sent_fx_N")
    return [(float(row[0]), [float(x) for x in row[at:at + 3]]) for row in rows]


def largest_change(forces):
    """Of the force from one row to the next [N]."""
    return max(sum((x - y) ** 2 for x, y in zip(a[1], b[1])) ** 0.5 for a, b in zip(forces, forces[1:]))


@case
def fault_interrupted_run(context):
    for sent in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        interrupted_run(context, sent=sent)


@case
def fault_interrupted_run_in_real_time(context):
    """The force leaves in a tenth of a second, without a jump."""
    interrupted_run(context, "--realtime")
    forces = sent_forces(context)
    expect(forces[-1][1] == [0, 0, 0], f"the last force is {forces[-1][1]} N")
    fading = [f for f in forces if f[0] > forces[-1][0] - 0.15]
    expect(max(abs(x) for x in fading[0][1]) > 0.1, f"there was no force to leave: {fading[0][1]}")
    expect(largest_change(fading) < 0.1, f"it leaves by {largest_change(fading)} N in a tick")


@case
def fault_second_signal_ends_at_once(context):
    """It takes back all that is unfinished, and spares the files of an earlier run."""
    scene = context.file("scene.yaml", SCENE)
    context.succeeds(["run", scene, "--out", context.out])
    before = {p.name: p.read_bytes() for p in context.out.iterdir()}
    process = context.start(["run", scene, "--duration", "600", "--out", context.out])
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and len(list(context.out.iterdir())) <= len(before):
        time.sleep(0.005)
    process.send_signal(signal.SIGTERM)
    ends(process, 1)
    expect(process.returncode in (-signal.SIGINT, -signal.SIGTERM, 143), f"exit code {process.returncode}")
    if process.returncode < 0:  # else it had ended before the second one came
        expect({p.name: p.read_bytes() for p in context.out.iterdir()} == before, "the earlier files changed")


@case
def fault_stopped_process(context):
    """Two seconds without the process, in real time: the force starts from zero with a ramp, and the run says so."""
    scene = context.file("scene.yaml", SCENE)
    process = context.start(["run", scene, "--realtime", "--duration", "4", "--out", context.out])
    time.sleep(1.2)
    process.send_signal(signal.SIGSTOP)
    time.sleep(2)
    process.send_signal(signal.SIGCONT)
    output, errors = process.communicate(timeout=30)
    expect(process.returncode == 0, f"exit code {process.returncode}: {errors!r}")
    forces = sent_forces(context)
    gap = max(range(1, len(forces)), key=lambda i: forces[i][0] - forces[i - 1][0])
    lost = forces[gap][0] - forces[gap - 1][0]
    expect(lost > 1.5, f"the longest gap is {lost} s")
    expect(forces[gap][1] == [0, 0, 0], f"after the gap the force begins with {forces[gap][1]} N")
    after = [f for f in forces[gap:] if f[0] < forces[gap][0] + 0.5]
    expect(largest_change(after) < 0.1, f"it changes by {largest_change(after)} N in a tick")
    haptic = context.summary()["haptic"]
    expect(haptic["missed_share"] > 0.3 and haptic["gaps"] >= 1, f"summary: {haptic}")
    expect(abs(haptic["longest_gap_s"] - lost) < 0.002, f"longest gap {haptic['longest_gap_s']} s and not {lost} s")
    for line in ("! haptic ticks missed", "! gaps"):
        expect(line in output, f"the table does not say '{line}': {output}")
    expect('class="bad"' in (context.out / "report.html").read_text(), "nothing is red in the report")


@case
def fault_killed_process(context):
    """SIGKILL leaves nobody to write anything: all but the last second is in the hidden files."""
    process = context.start(["run", context.file("scene.yaml", SCENE), "--realtime", "--duration", "600", "--out", context.out])
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and not (context.out.exists() and list(context.out.glob(".haptic.csv.*"))):
        time.sleep(0.02)
    time.sleep(3)
    process.kill()
    process.communicate()
    for name in ("haptic", "visual", "motion", "timing"):
        found = list(context.out.glob(f".{name}.csv.partial-*"))
        expect(len(found) == 1, f"{name}.csv: {found}")
        last = found[0].read_text().splitlines()[-1]
        expect(float(last.split(",")[0]) > 1.9, f"{name}.csv ends at {last[:60]}")


@case
def fault_clock_steps(context):
    """The wall clock steps by an hour, there and back, at each look: a run in real time does not see it."""
    shim = pathlib.Path(context.program).parent / "tests/cli/libclock_steps.so"
    if not shim.exists():
        raise Skip("the build has no tests")
    scene = context.file("scene.yaml", SCENE)
    process = context.start(["run", scene, "--realtime", "--duration", "1.5", "--out", context.out],
                            env={**os.environ, "LD_PRELOAD": str(shim)})
    begin = time.monotonic()
    _, errors = process.communicate(timeout=30)
    expect(process.returncode == 0, f"exit code {process.returncode}: {errors!r}")
    expect("the wall clock steps" in errors, f"it does not: {errors!r}")
    expect(time.monotonic() - begin < 10, "it waited for a clock")
    summary = context.summary()["haptic"]
    expect(summary["gaps"] == 0 and summary["missed_share"] < 0.2, f"summary: {summary}")
    forces = sent_forces(context)
    expect(all(a[0] < b[0] for a, b in zip(forces, forces[1:])) and forces[-1][0] <= 1.5, "times are out of order")


@case
def fault_visual_loop_too_slow(context):
    """Steps take ten times what they may: the model is too old nearly always, and everybody is told."""
    scene = context.file("scene.yaml", SCENE.replace(SHAPE, "{sphere: {radius: 0.04}}\n  tetrahedra: 3000"))
    output = context.succeeds(["run", scene, "--realtime", "--visual-dt", "0.001", "--duration", "1.5", "--out", context.out])
    summary = context.summary()
    expect(summary["haptic"]["stale_share"] > 0.2, f"stale share {summary['haptic']['stale_share']}")
    for line in ("! model too old", "! visual steps longer than 1 ms"):
        expect(line in output, f"the table does not say '{line}': {output}")
    report = (context.out / "report.html").read_text()
    expect(re.search(r'<tr class="bad"><th[^>]*>model too old', report), "it is not red in the report")


@case
def fault_closed_descriptors(context):
    """Text for people does not land in the files, though they are the first that are opened."""
    scene = context.file("scene.yaml", SCENE)

    def close():
        for descriptor in range(3):
            os.close(descriptor)

    process = subprocess.Popen([str(context.program), "run", str(scene), "--out", str(context.out)], cwd=context.folder,
                               preexec_fn=close)
    expect(process.wait(timeout=60) == 0, f"exit code {process.returncode}")
    plain = context.folder / "plain"
    context.succeeds(["run", scene, "--out", plain])
    for name in ("haptic.csv", "visual.csv", "motion.csv"):
        expect((context.out / name).read_bytes() == (plain / name).read_bytes(), f"{name} is another")
    context.table("timing.csv")


@case
def fault_interrupted_build(context):
    """Ctrl-C while a scene is built, by run and by view, at its start and on a viewer's wish."""
    heavy = context.file("heavy.yaml", SCENE.replace(SHAPE, HEAVY).replace("name: press", "name: heavy"))
    for arguments in (["run", heavy, "--out", context.out], ["view", heavy, "--port", "0"]):
        for wait in (0.4, 2.0):
            process = context.start(arguments)
            time.sleep(wait)
            expect(process.poll() is None, f"ended by itself: {process.returncode}")
            ends(process, 1)
            expect(not context.out.exists(), "something was left behind")
    for wait in (0.4, 2.0):
        process, port = served(context, "view", context.file("scene.yaml", SCENE))
        try:
            viewer = WebSocket(port)
            viewer.send(type="scene", name="heavy")
            viewer.until("sign of work", 10, lambda m: is_json("state")(m) and m["busy"])
            time.sleep(wait)
            viewer.close()
            ends(process, 1)
        finally:
            process.kill()
        expect(process.returncode == 0, f"exit code {process.returncode}")
