import _thread
import csv
import subprocess
import tempfile
import threading
import time
import unittest

import numpy as np
import palpate
from scenes import PROGRAM, SOURCE, cube


def motion_rows(count, dt=0.001):
    """A device that sinks from the cube's start, turns and comes back."""
    start = palpate.World(cube()).start
    rows = np.zeros((count, 13))
    for i in range(count):
        depth = -0.02 * np.sin(np.pi * i / count)
        pose = start.advanced([0.002 * i / count, 0, depth, 0, 0.1 * i / count, 0])
        rows[i, :3], rows[i, 3:7] = pose.position, pose.rotation
    rows[:-1, 7:10] = np.diff(rows[:, :3], axis=0) / dt
    return rows


class Program(unittest.TestCase):
    @unittest.skipUnless(PROGRAM, "PALPATE_PROGRAM is not given")
    def test_numbers_are_those_of_palpate_run(self):
        for scene, method in (("cube", "live"), ("cube", "hsl"), ("block", "hsl-exact")):
            file = SOURCE / f"scenes/{scene}.yaml"
            with self.subTest(scene=scene, method=method), tempfile.TemporaryDirectory() as folder:
                command = [PROGRAM, "run", file, "--method", method, "--duration", "1.0", "--pictures", "0"]
                subprocess.run([*command, "--out", folder], check=True, capture_output=True)
                with open(f"{folder}/haptic.csv") as rows:
                    header, *rows = csv.reader(rows)
                trace = palpate.Run(palpate.Scene(file, method=method, duration=1.0)).finish()
                self.assertEqual((*trace.COLUMNS, "flags"), tuple(header))
                wanted = np.array(rows, dtype=float)
                np.testing.assert_array_equal(trace.ticks, wanted[:, :-1])
                np.testing.assert_array_equal(trace.flags, wanted[:, -1])
                self.assertGreater(abs(trace.sent).max(), 0.1)


class Runs(unittest.TestCase):
    def test_in_parts_it_is_the_same(self):
        scene = cube(duration=0.8)
        whole, run = palpate.Run(scene).finish(), palpate.Run(scene)
        parts = [run.advance(100), run.advance(33), run.finish()]
        self.assertEqual([len(p) for p in parts], [100, 33, 667])
        self.assertEqual((run.tick, run.ticks), (800, 800))
        np.testing.assert_array_equal(np.concatenate([p.ticks for p in parts]), whole.ticks)
        self.assertEqual(len(run.advance(10)), 0)
        self.assertEqual(len(whole.models), 25)
        np.testing.assert_array_equal(whole.models[3].force, whole.coupling[3])

    def test_a_motion_may_come_bit_by_bit(self):
        rows, scene = motion_rows(400), cube(duration=0.1)
        whole, run = palpate.Run(scene, motion=rows).finish(), palpate.Run(scene)
        parts = [run.advance(motion=rows[:150]), run.advance(33, motion=rows[150:200]), run.advance(motion=rows[183:])]
        self.assertEqual(run.tick, 400)
        np.testing.assert_array_equal(np.concatenate([p.ticks for p in parts]), whole.ticks)
        self.assertEqual(len(run.finish()), 0)

    def test_a_motion_has_unit_quaternions(self):
        rows, scene = motion_rows(20)[:, :7], cube()
        rounded = rows.copy()
        rounded[:, 3:] = 0.95 * rows[:, 3:]
        trace = palpate.Run(scene, motion=rounded).finish()
        np.testing.assert_allclose(trace.device, rows, atol=1e-15)
        for factor in (0.0, 2.0, -1.2):
            bad = rows.copy()
            bad[7, 3:] *= factor
            for job in (lambda: palpate.Run(scene, motion=bad), lambda: palpate.Run(scene).advance(motion=bad),
                        lambda: palpate.rollout(scene, motion=bad)):  # fmt: skip
                with self.assertRaisesRegex(ValueError, "^motion: row 7: .* norm 1"):
                    job()

    def test_restored_it_goes_on_to_the_bit(self):
        for method in ("live", "hsl"):
            scene = cube(method=method, device="simulated", duration=1.0)
            run = palpate.Run(scene)
            run.advance(650)
            state = run.save()
            wanted = run.finish()
            run.restore(state)
            np.testing.assert_array_equal(run.finish().ticks, wanted.ticks)
            other = palpate.Run(scene)
            other.restore(state)
            np.testing.assert_array_equal(other.finish().ticks, wanted.ticks)
            [rolled] = palpate.rollout(scene, state=state)
            np.testing.assert_array_equal(rolled.ticks, wanted.ticks)

    def test_ctrl_c_ends_a_run_and_a_rollout(self):
        scene = cube(method="vc", visual_dt=0.001, duration=600)
        for job in (palpate.Run(scene).finish, lambda: palpate.rollout([scene, scene], threads=2)):
            timer = threading.Timer(0.3, _thread.interrupt_main)
            timer.start()
            begin = time.monotonic()
            with self.assertRaises(KeyboardInterrupt):
                job()
            self.assertLess(time.monotonic() - begin, 5)


class SlowDevices(unittest.TestCase):
    class Replay:
        def __init__(self, rows):
            self.rows, self.felt = rows, []

        def sample(self, t):
            row = self.rows[min(round(t / 0.001), len(self.rows) - 1)]
            return palpate.DeviceState(palpate.Pose(row[:3], row[3:7]), row[7:])

        def apply(self, wrench, t, dt):
            self.felt.append(wrench)

    def test_a_device_in_python_gives_the_same_bits(self):
        rows = motion_rows(400)
        device = self.Replay(rows)
        slow = palpate.Run(cube(duration=0.4), slow_device=device).finish()
        fast = palpate.Run(cube(), motion=rows).finish()
        np.testing.assert_array_equal(slow.ticks, fast.ticks)
        np.testing.assert_array_equal(device.felt, fast.sent)
        np.testing.assert_array_equal(fast.device, rows[:, :7])

    def test_what_it_raises_ends_the_run(self):
        class Broken(self.Replay):
            def sample(self, t):
                if t > 0.0495:
                    raise KeyError("gone")
                return super().sample(t)

        run = palpate.Run(cube(duration=0.4), slow_device=Broken(motion_rows(400)))
        with self.assertRaisesRegex(KeyError, "gone"):
            run.finish()
        self.assertLessEqual(run.tick, 52)


class Rollouts(unittest.TestCase):
    def test_many_are_as_one_by_one(self):
        rows = motion_rows(300)
        batch = np.stack([rows * [1, 1, 1, 1, 1, 1, 1, s, s, s, s, s, s] for s in (0.0, 0.5, 1.0, 1.0)])
        scene = cube(method="hsl")
        for threads in (1, 2):
            traces = palpate.rollout(scene, motion=batch, threads=threads)
            self.assertEqual(len(traces), 4)
            for one, trace in zip(batch, traces):
                np.testing.assert_array_equal(palpate.Run(scene, motion=one).finish().ticks, trace.ticks)
        self.assertTrue((traces[0].sent != traces[2].sent).any())

    def test_scenes_and_motions_go_together(self):
        scenes = [cube(method=m, duration=0.2) for m in ("vc", "hsl")]
        for trace, scene in zip(palpate.rollout(scenes), scenes):
            np.testing.assert_array_equal(trace.ticks, palpate.Run(scene).finish().ticks)
        self.assertEqual([len(t) for t in palpate.rollout(scenes, motion=motion_rows(50))], [50, 50])
        for bad, cause in (
            (np.zeros((2, 5)), "columns"),
            (np.zeros((0, 5, 7)), "columns"),
            (np.zeros((3, 5, 7)), "3 of them"),
            (np.full((5, 7), np.nan), "finite"),
        ):
            with self.assertRaisesRegex(ValueError, cause):
                palpate.rollout(scenes, motion=bad)
        with self.assertRaises(ValueError):
            palpate.rollout([])

    def test_a_bad_scene_is_raised(self):
        bad = palpate.Scene.from_text((SOURCE / "scenes/cube.yaml").read_text().replace("0.0599", "0.9"))
        with self.assertRaisesRegex(ValueError, "region|node"):
            palpate.rollout([cube(duration=0.1), bad])


class OneDimension(unittest.TestCase):
    def test_published_figures(self):
        results = palpate.one_d()
        drag = {(run["method"], run["visual_dt"]): run["drag"] for run in results["runs"]}
        self.assertAlmostEqual(drag["vc", 0.01], 5.80, 2)
        self.assertAlmostEqual(drag["hsl", 0.02], 0.24, 2)
        self.assertAlmostEqual(abs(results["reference"]["force"]).max(), 8.73, 2)
        with self.assertRaisesRegex(ValueError, "handle_mass"):
            palpate.one_d("handle_mass: -1")


if __name__ == "__main__":
    unittest.main()
