"""The safety stage in whole runs (docs/haptics.md): it stops what swings by itself, and nothing else."""

import re

from harness import CASES, SCENE, case, expect
from subcommands import SCENES

TAPPED = ("block", "cube", "bunny")  # with one handle


def motion(context, scene, keys, hand):
    """A shipped scene with another motion, in a simulated hand (N/m, N s/m), or prescribed."""
    lines, done = [], False
    for line in context.scene(scene).read_text().splitlines():
        if not re.search(r"- \{t: ", line):
            lines.append(line)
        elif not done:
            lines += [f"          - {{t: {t:.4f}, position: {p}}}" for t, p in keys]
            done = True
    text = "\n".join(lines) + "\n"
    kind = "  type: prescribed\n" if hand is None else f"  hand_stiffness: {hand[0]}\n  hand_damping: {hand[1]}\n"
    text = re.sub(r"(?m)^  (type: prescribed|limits: .*)\n", "", text)
    if not re.search(r"(?m)^device:", text):
        text += "device:\n"
    text = re.sub(r"(?m)^device:.*\n", "device:\n" + kind, text)
    return context.file(f"{scene}.yaml", text)


def ran(context, *arguments, out=None):
    """Summary, times and rows of a run, with the force at each."""
    out = out or context.out
    output = context.succeeds(["run", *arguments, "--pictures", "0", "--out", out], timeout=200)
    header, rows = context.table("haptic.csv", out)
    at, flags = header.index("sent_fx_N"), header.index("flags")
    forces = [(float(r[0]), [float(x) for x in r[at:at + 3]], int(r[flags])) for r in rows]
    return context.summary(out), output, forces


def size(force):
    return sum(x * x for x in force) ** 0.5


# Bodies fall on this tool. What that strains is energy that no model knew of, and a few models are refused or slowed down
# for it; how many depends on the processor, as all of a heap's motion does.
STRUCK = ("pile",)


def never_case(name):
    def run(context):
        output = context.succeeds(["run", context.scene(name), "--pictures", "0", "--out", context.out], timeout=280)
        flags = context.summary()["haptic"]["flags"]
        row = re.search(r"out of the ordinary, ticks +(.*)", output)
        odd = row.group(1).split(", ") if row else []
        if name in STRUCK:
            odd = [thing for thing in odd if not thing.startswith("models ")]
            models = len(context.table("visual.csv")[1])
            refused = flags["model_rejected"] + flags["model_damped"]
            expect(refused <= 0.03 * models, f"{refused} of {models} models were refused or slowed down")
        expect(not odd, f"something was out of the ordinary: {output}")
        for flag in ("oscillation", "calmed", "device_lost", "gate_closed", "button_released", "outside_workspace"):
            expect(flags[flag] == 0, f"{flags[flag]} ticks with {flag}")

    CASES[f"swing-never-in-{name}"] = run


for name in SCENES:
    if name != "block-10140":  # the motion of block-2592
        never_case(name)


@case
def swing_never_while_tapping(context):
    """At 3 Hz, in hands and as given, with the default method; and as given with the one that swings in hands."""
    keys = [(0.3, [0, 0, 0])]
    for tap in range(9):
        keys += [(0.3 + (tap + 0.5) / 3, [0, 0, -0.015]), (0.3 + (tap + 1) / 3, [0, 0, 0.005])]
    for scene in TAPPED:
        for hand in ((500, 8), (100, 2), None):
            for method in ("live", "hsl") if hand is None else ("live",):
                file = motion(context, scene, keys, hand)
                summary, _, forces = ran(context, file, "--duration", "3.4", "--method", method)
                expect(max(size(f[1]) for f in forces) > 0.2, f"{scene}: nothing was tapped")
                times = summary["haptic"]["flags"]["oscillation"]
                expect(times == 0, f"{scene}, hand {hand}, {method}: acted {times} times")


@case
def swing_is_stopped(context):
    """hsl at 33 ms in a relaxed hand swings up to the device's peak: not for longer than half a second, and it is said."""
    keys = [(0.3, [0, 0, 0]), (1.1, [0, 0, -0.025])]
    for scene in ("cube", "block"):
        file = motion(context, scene, keys, (100, 2))
        summary, output, forces = ran(context, file, "--duration", "5", "--method", "hsl", "--visual-dt", "0.033")
        acts = [t for t, _, flags in forces if flags >> 23 & 1]
        peak = next(t for t, force, _ in forces if size(force) > 3.29)
        expect(acts and acts[0] < peak + 0.4, f"{scene}: at its peak from {peak} s on, acts at {acts} s")
        gone = next(t for t, force, _ in forces if t > acts[0] and size(force) == 0)
        expect(gone < peak + 0.5 and gone < acts[0] + 0.11, f"{scene}: zero only at {gone} s")
        late = [size(force) for t, force, _ in forces if t > 4]
        expect(max(late) - min(late) < 1.5, f"{scene}: it swings on, from {min(late)} to {max(late)} N")
        expect(summary["haptic"]["flags"]["oscillation"] == len(acts), "the summary counts another number")
        expect("! force swung by itself" in output, f"the table does not say it: {output}")


@case
def presence_of_a_hand(context):
    """A run whose dead-man button nobody presses, or that leaves its workspace, has no force and says why."""
    for key, line in (("dead_man: 1", "dead-man button not pressed"), ("workspace: 0.001", "out of the workspace")):
        scene = context.file("scene.yaml", SCENE + f"safety: {{{key}}}\n")
        _, output, forces = ran(context, scene, "--duration", "0.4")
        expect(size(forces[-1][1]) == 0, f"{key}: {forces[-1][1]} N")
        expect(line in output, f"the table does not say '{line}': {output}")


@case
def presence_start_gate(context):
    """No force but a small push before somebody holds the device still; then it comes slowly."""
    scene = context.file("scene.yaml", SCENE + "safety: {start_gate: true}\n")
    _, output, forces = ran(context, scene, "--duration", "3")
    early = [size(f) for t, f, _ in forces if t < 0.49]
    expect(0.05 < max(early) <= 0.1001, f"a push of {max(early)} N")
    change = max(size([x - y for x, y in zip(a[1], b[1])]) for a, b in zip(forces, forces[1:]))
    expect(size(forces[-1][1]) > 0.2 and change < 0.01, f"{forces[-1][1]} N, by {change} N in a tick")
    expect("start gate closed" in output, output)
