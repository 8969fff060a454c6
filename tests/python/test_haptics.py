import unittest

import numpy as np
import palpate
from scenes import cube


class Loops(unittest.TestCase):
    def test_a_tick_is_the_proxys_implicit_step(self):
        # along x only: m (v' - v) / dt = F*(x', v') - k (x' - xd) - b (v' - vd)
        link = palpate.Link(stiffness=400.0, damping=3.0)
        mass, dt = 0.07, 0.001
        loop = palpate.HapticLoop(link=link, mass=mass, gravity=[0, 0, 0], dt=dt, peak_force=100)
        model = palpate.HandleModel()
        model.force[0], model.kx[0, 0], model.kv[0, 0] = -2.0, -300.0, -1.5
        loop.start(palpate.Pose())
        x = v = 0.0
        for i in range(50):
            xd, vd = 1e-4 * i, 0.1
            f = model.force[0] + model.kx[0, 0] * x + model.kv[0, 0] * v - 400 * (x - xd) - 3 * (v - vd)
            c = mass / dt - model.kv[0, 0] + 3 + dt * (400 - model.kx[0, 0])
            v += (f + dt * v * (model.kx[0, 0] - 400)) / c
            x += dt * v
            record = loop.tick(model, palpate.DeviceState(palpate.Pose([xd, 0, 0]), [vd, 0, 0, 0, 0, 0]))
            self.assertAlmostEqual(record.time, i * dt, 12)
            self.assertAlmostEqual(record.raw[0], 400 * (x - xd) + 3 * (v - vd), 9)
            self.assertAlmostEqual(record.proxy.position[0], x, 12)

    def test_before_the_first_model_there_is_none(self):
        loop = palpate.HapticLoop(gravity=[0, 0, 0])
        record = loop.tick(None, palpate.Pose([0.1, 0, 0]))
        self.assertIn("model_missing", record.flag_names)
        self.assertEqual(loop.counters["model_missing"], 1)
        self.assertEqual(record.model_age, np.inf)
        np.testing.assert_allclose(record.sent, 0, atol=1e-12)

    def test_a_device_that_says_nonsense_is_not_followed(self):
        loop = palpate.HapticLoop()
        model = palpate.HandleModel()
        loop.tick(model, palpate.Pose())
        record = loop.tick(model, palpate.Pose([np.nan, 0, 0]))
        self.assertIn("device_rejected", record.flag_names)
        self.assertTrue(np.isfinite(record.sent).all())

    def test_saved_it_goes_on_to_the_bit(self):
        loop, model = palpate.HapticLoop(), palpate.HandleModel()
        model.kx = -np.diag([300.0] * 3 + [0.1] * 3)
        for i in range(20):
            loop.tick(model, palpate.Pose([1e-4 * i, 0, 0]))
        state = loop.save()
        first = [loop.tick(model, palpate.Pose([0, 1e-4 * i, 0])).sent.copy() for i in range(20)]
        loop.restore(state)
        again = [loop.tick(model, palpate.Pose([0, 1e-4 * i, 0])).sent.copy() for i in range(20)]
        np.testing.assert_array_equal(first, again)

    def test_settings_are_checked(self):
        for options, cause in (
            ({"method": "live"}, "Run"),
            ({"method": "best"}, "hsl"),
            ({"dt": 0.0}, "dt"),
            ({"mass": -1.0}, "mass"),
            ({"inertia": np.zeros(3)}, "inertia"),
        ):
            with self.assertRaisesRegex(ValueError, cause):
                palpate.HapticLoop(**options)

    def test_own_loops_make_the_run(self):
        """The run of a scene, put together in Python from World.visual_step() and HapticLoop.tick()."""
        scene = cube(method="hsl", duration=0.9)
        trace = palpate.Run(scene).finish()
        world = palpate.World(scene)
        loop = palpate.HapticLoop.of(world)
        world.evaluate()
        newest = last = world.linearize()
        loop.start(world.start, world.tool.handle_pose)
        arrival = None
        for i, (row, twist) in enumerate(zip(trace.device, trace.device_twist)):
            device = palpate.DeviceState(palpate.Pose(row[:3], row[3:]), twist)
            if i % 33 == 0:
                if arrival is not None:
                    newest = arrival
                arrival = last = world.visual_step(device, time=i * 0.001, previous=last)[0]
            record = loop.tick(newest, device)
            np.testing.assert_array_equal(record.sent, trace.sent[i])
        self.assertGreater(np.linalg.norm(record.sent[:3]), 0.5)


if __name__ == "__main__":
    unittest.main()
