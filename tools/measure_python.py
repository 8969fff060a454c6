#!/usr/bin/env python3
"""What Python adds: to world.step() with its report against the same steps timed in C++, and to start a program.

    PYTHONPATH=build/release/python /usr/bin/python3 tools/measure_python.py [--steps N] [--scene FILE]

Both loops take the same steps from the same state, in turns of a thousand, each call timed by itself. Prints JSON: times
in microseconds, import in seconds.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

import numpy as np
import palpate

ROOT = pathlib.Path(__file__).resolve().parent.parent
TURN = 1000  # steps


def python_steps(world, count):
    times = []
    clock = time.perf_counter_ns
    for _ in range(count):
        begin = clock()
        report = world.step()
        end = clock()
        times.append(end - begin)
    assert report.sound
    return np.array(times)


def step_times(scene, count):
    world = palpate.World(scene)
    state = world.save()
    ours, theirs = [], []
    for _ in range(max(1, count // TURN)):
        for times, run in ((theirs, world._time_steps), (ours, lambda n: python_steps(world, n))):
            world.restore(state)
            times.append(run(min(TURN, count)))
    return 1e-3 * np.concatenate(ours), 1e-3 * np.concatenate(theirs)


def rollout_times(scene, threads):
    scene = scene.replaced(duration=2.0)
    times = []
    for count in (1, threads):
        begin = time.perf_counter()
        palpate.rollout([scene] * (4 * threads), threads=count)
        times.append(time.perf_counter() - begin)
    return times


def import_times(module, times):
    code = f"import time; begin = time.perf_counter(); import {module}; print(time.perf_counter() - begin)"
    return [float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in range(times)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=10000)
    parser.add_argument("--scene", default=ROOT / "scenes/cube.yaml", help="default: the smallest that is shipped")
    options = parser.parse_args()
    scene = palpate.Scene(options.scene)
    python, cpp = step_times(scene, options.steps)
    loop, model, device = palpate.HapticLoop(), palpate.HandleModel(), palpate.Pose()
    model.time = 1e9  # never too old
    ticks = []
    for _ in range(options.steps):
        begin = time.perf_counter_ns()
        loop.tick(model, device)
        ticks.append(1e-3 * (time.perf_counter_ns() - begin))
    result = {"scene": scene.name, "steps": len(python), "python_us": np.median(python), "cpp_us": np.median(cpp)}
    result["added_us"] = result["python_us"] - result["cpp_us"]
    result["tick_us"] = np.median(ticks)
    result["threads"] = len(os.sched_getaffinity(0))
    result["rollout_one_s"], result["rollout_all_s"] = rollout_times(scene, result["threads"])
    result["import_s"] = np.median(import_times("palpate", 11))
    result["import_numpy_s"] = np.median(import_times("numpy", 11))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
