import sys
import threading
import time
import unittest

import numpy as np
import palpate
from scenes import SOURCE, cube, pressed


class States(unittest.TestCase):
    def test_restored_it_goes_on_to_the_bit(self):
        world = pressed()
        state, target = world.save(), world.target

        def go_on():
            world.restore(state)
            for k in range(10):
                world.step(target.pose.advanced([0.002 * k, 0, 0, 0, 0, 0]))
            return world.save()

        self.assertEqual(go_on(), go_on())
        other = palpate.World(cube())
        other.restore(state)
        np.testing.assert_array_equal(other.target.pose.position, target.pose.position)
        other.step()
        world.restore(state)
        world.step()
        self.assertEqual(other.save(), world.save())

    def test_bytes_that_are_no_state_are_refused(self):
        world = pressed()
        state = world.save()
        for bad in (b"", state[:-1], state[:100] + b"\0" + state[101:] + b"x", b"x" * len(state)):
            with self.assertRaises(ValueError):
                world.restore(bad)
        self.assertEqual(world.save(), state)
        other = palpate.World(palpate.Scene(SOURCE / "scenes/block.yaml"))
        with self.assertRaisesRegex(ValueError, "state of this body"):
            other.restore(state)

    def test_evaluate_leaves_the_world_where_it_is(self):
        world = pressed()
        before = world.tool.positions.copy()
        report = world.evaluate(world.start.advanced([0, 0, -0.02, 0, 0, 0]))
        self.assertTrue(report.sound)
        np.testing.assert_array_equal(world.tool.positions, before)

    def test_a_handle_takes_its_nodes_along(self):
        world = palpate.World(cube())
        tool = world.tool
        nodes, pose = tool.attached_nodes, tool.handle_pose
        before = tool.positions[nodes].copy()
        tool.set_handle(pose.advanced([0.01, 0, 0, 0, 0, 0]), [0, 0, 1, 0, 0, 0])
        np.testing.assert_allclose(tool.positions[nodes], before + [0.01, 0, 0], atol=1e-12)
        np.testing.assert_allclose(tool.velocities[nodes][:, 2], 1.0)
        np.testing.assert_array_equal(tool.handle_twist, [0, 0, 1, 0, 0, 0])
        at = tool.positions.copy()
        tool.set_state(at + 0.001)
        np.testing.assert_allclose(tool.positions[nodes], at[nodes], atol=1e-15)
        np.testing.assert_array_equal(tool.positions[tool.free_nodes], at[tool.free_nodes] + 0.001)

    def test_nothing_is_linearized_before_a_step(self):
        world = palpate.World(cube())
        for job in (world.linearize, world.coupling_wrench, world.tool.system):
            with self.assertRaisesRegex(RuntimeError, "no step"):
                job()
        world.evaluate()
        self.assertEqual(world.linearize(time=2.0).time, 2.0)
        world.restore(world.save())
        with self.assertRaisesRegex(RuntimeError, "no step"):
            world.linearize()


class Reports(unittest.TestCase):
    def test_a_report_says_what_the_step_did(self):
        world = pressed()
        report = world.step()
        self.assertEqual(report.status, "ok")
        self.assertTrue(report.converged)
        self.assertEqual(report.contacts, len(world.contacts()))
        self.assertEqual(report.active, np.count_nonzero(world.contacts().state))
        self.assertGreater(report.active, 0)
        self.assertGreater(report.times.total, 0)
        force = world.contacts().impulse[:, 0].sum() / 0.033
        self.assertGreater(force, 0.5)


class Errors(unittest.TestCase):
    def test_a_scene_names_the_key(self):
        text = (SOURCE / "scenes/cube.yaml").read_text()
        for old, new, key in (
            ("density", "densty", r'my: tool.material \(line \d+\): unknown key "densty".*"density"'),
            ("youngs_modulus: 2.0e4", "youngs_modulus: -1", "tool.material.youngs_modulus"),
        ):
            with self.assertRaisesRegex(ValueError, key):
                palpate.Scene.from_text(text.replace(old, new), name="my")

    def test_an_option_is_named_as_in_python(self):
        with self.assertRaisesRegex(ValueError, "^visual_dt: "):
            cube(visual_dt=-1.0)
        with self.assertRaisesRegex(ValueError, "^method: .*live"):
            cube(method="none")
        with self.assertRaisesRegex(TypeError, "^latency: "):
            cube(latency="soon")
        with self.assertRaisesRegex(TypeError, "visual_step"):
            cube(visual_step=0.01)

    def test_a_seed_has_64_bits(self):
        for seed in (0, 2**63, 2**64 - 1):
            scene = cube(seed=seed)
            self.assertEqual(scene.seed, seed)
            self.assertEqual(palpate.Scene.from_text(scene.text()).seed, seed)
        for seed in (-1, 2**64):
            with self.assertRaisesRegex(ValueError, "^seed: "):
                cube(seed=seed)
        with self.assertRaisesRegex(TypeError, "^seed: "):
            cube(seed="many")

    def test_what_is_not_there_or_no_number(self):
        with self.assertRaisesRegex(ValueError, "no_such"):
            palpate.Scene("no_such.yaml")
        world = palpate.World(cube())
        for job in (lambda: world.step("up"), lambda: world.step(step="long"), lambda: world.visual_step(previous=3)):
            with self.assertRaises(TypeError):
                job()
        for bad in (-1.0, 0.0, float("nan")):
            with self.assertRaisesRegex(ValueError, "step"):
                world.step(step=bad)
        with self.assertRaisesRegex(ValueError, "position"):
            palpate.Pose([1, 2])
        with self.assertRaisesRegex(ValueError, "position: .*one dimension"):
            palpate.Pose(np.zeros((3, 1)))
        with self.assertRaisesRegex(ValueError, "rotation"):
            palpate.Pose(rotation=2 * np.eye(3))
        with self.assertRaisesRegex(ValueError, "positions"):
            world.tool.set_state(np.zeros((3, 3)))
        for key in ("positions", "velocities"):
            with self.assertRaisesRegex(ValueError, f"{key}: must be {world.tool.nodes} x 3"):
                world.tool.set_state(**{key: np.zeros((3, world.tool.nodes))})
        with self.assertRaisesRegex(ValueError, "finite"):
            world.step(palpate.Pose([np.nan, 0, 0]))

    def test_text_reads_as_the_scene(self):
        scene = cube(method="vc", visual_dt=0.02)
        again = palpate.Scene.from_text(scene.text())
        self.assertEqual((again.method, again.visual_step), ("vc", 0.02))
        self.assertEqual(again.replaced(method="hsl").method, "hsl")
        self.assertEqual(again.method, "vc")


class Gil(unittest.TestCase):
    def test_other_threads_run_while_the_world_steps(self):
        # a single long call, so that no switch between calls can help
        run = palpate.Run(cube(method="vc", visual_dt=0.001, duration=1.5))
        counts, done = [0], threading.Event()

        def count():
            while not done.is_set():
                counts[0] += 1
                time.sleep(0.0005)

        thread = threading.Thread(target=count)
        thread.start()
        begin = time.monotonic()
        run.finish()
        during, elapsed = counts[0], time.monotonic() - begin
        done.set()
        thread.join()
        self.assertGreater(elapsed, 0.02)
        self.assertGreater(during, elapsed / 0.05)

    def test_each_job_lets_other_threads_run(self):
        # nobody is made to give way, so others run only while the job itself releases the GIL
        world, scene = pressed(), cube(duration=0.2)
        jobs = {
            "nothing": lambda: sum(range(100)),
            "step": world.step,
            "evaluate": world.evaluate,
            "linearize": world.linearize,
            "visual_step": world.visual_step,
            "World": lambda: palpate.World(scene),
            "Run": lambda: palpate.Run(scene),
            "rollout": lambda: palpate.rollout(scene),
        }
        counts, done = [0], threading.Event()

        def count():
            while not done.is_set():
                counts[0] += 1
                time.sleep(1e-4)

        before = sys.getswitchinterval()
        thread = threading.Thread(target=count)
        thread.start()
        try:
            sys.setswitchinterval(1000)
            for name, job in jobs.items():
                world.evaluate()  # which lets the other thread get to its sleep
                begin, end = counts[0], time.monotonic() + (0.05 if name == "nothing" else 20)
                while counts[0] < begin + 3 and time.monotonic() < end:
                    job()
                with self.subTest(name):
                    (self.assertLess if name == "nothing" else self.assertGreaterEqual)(counts[0], begin + 3)
        finally:
            sys.setswitchinterval(before)
            done.set()
            thread.join()

    def test_a_world_in_use_is_not_touched(self):
        run = palpate.Run(cube(method="vc", visual_dt=0.001, duration=8))
        world = run.world
        thread = threading.Thread(target=run.finish)
        thread.start()
        refused = 0
        while thread.is_alive():
            try:
                world.save()
            except RuntimeError as error:
                self.assertIn("another thread", str(error))
                refused += 1
            time.sleep(0.001)
        thread.join()
        self.assertGreater(refused, 0)
        world.step()


if __name__ == "__main__":
    unittest.main()
