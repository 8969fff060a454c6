import gc
import unittest

import numpy as np
import palpate
from scenes import cube, pressed


class Views(unittest.TestCase):
    def test_nodes_are_rows_in_c_order_without_copy(self):
        world = palpate.World(cube())
        tool = world.tool
        world.step()
        for array in (tool.positions, tool.velocities, tool.forces, tool.rest_positions):
            self.assertEqual(array.shape, (tool.nodes, 3))
            self.assertEqual(array.dtype, np.float64)
            self.assertTrue(array.flags.c_contiguous)
            self.assertFalse(array.flags.owndata)
        self.assertEqual(tool.tetrahedra.shape, (162, 4))
        self.assertEqual(tool.tetrahedra.dtype, np.int32)
        self.assertTrue(np.shares_memory(tool.positions, world.tool.positions))
        self.assertAlmostEqual(tool.masses.sum(), 0.06**3 * 1000, 12)

    def test_views_follow_the_world_in_the_same_memory(self):
        world = palpate.World(cube())
        state = world.save()
        x, v = world.tool.positions, world.tool.velocities
        before = x.copy()
        for k in range(20):
            world.step(world.start.advanced([0, 0, -0.002 * k, 0.02 * k, 0, 0]), parts=1 + k % 3)
            self.assertEqual(world.tool.positions.ctypes.data, x.ctypes.data)
            self.assertEqual(world.tool.velocities.ctypes.data, v.ctypes.data)
        self.assertGreater(abs(x - before).max(), 0.01)
        world.restore(state)
        self.assertEqual(world.tool.positions.ctypes.data, x.ctypes.data)
        np.testing.assert_array_equal(x, before)

    def test_what_the_solver_owns_is_read_only(self):
        world = pressed()
        contacts = world.contacts()
        arrays = [world.tool.positions, world.tool.forces, world.tool.masses, world.tool.tetrahedra, contacts.gap]
        arrays += [contacts.normal, contacts.impulse, contacts.state, contacts.islands[0].W, world.tool.handle_twist]
        arrays += [world.tool.system().data, world.tool.system().indices]
        for array in arrays:
            self.assertFalse(array.flags.writeable)
            with self.assertRaises(ValueError):
                array[0] = 0
            with self.assertRaises(ValueError):
                array.flags.writeable = True

    def test_a_view_keeps_its_owner_alive(self):
        world = pressed()
        x, w = world.tool.positions, world.contacts().islands[0].W
        system = world.tool.system()
        copies = [x.copy(), w.copy(), system.data.copy()]
        del world
        gc.collect()
        others = [pressed() for _ in range(3)]  # would take the memory that was given back
        for array, copy in zip((x, w, system.data), copies):
            np.testing.assert_array_equal(array, copy)
        del others

    def test_the_world_dies_when_nothing_looks_at_it(self):
        def resident():
            with open("/proc/self/statm") as file:
                return int(file.read().split()[1]) * 4096

        pressed()
        gc.collect()
        before = resident()
        for _ in range(30):
            pressed()
        self.assertLess(resident() - before, 8 << 20)

    def test_contacts_stay_those_of_their_step(self):
        world = pressed()
        contacts = world.contacts()
        self.assertIs(world.contacts(), contacts)
        w, gap, impulse = contacts.islands[0].W, contacts.gap, contacts.impulse
        copies = [w.copy(), gap.copy(), impulse.copy()]
        for k in range(5):
            world.step(world.start.advanced([0.003 * k, 0, -0.016 - 0.001 * k, 0, 0, 0]))
        for array, copy in zip((w, gap, impulse), copies):
            np.testing.assert_array_equal(array, copy)
        np.testing.assert_array_equal(contacts.islands[0].W, copies[0])
        self.assertIsNot(world.contacts(), contacts)
        self.assertFalse(np.shares_memory(world.contacts().impulse, impulse))

    def test_a_pose_and_a_model_may_be_written(self):
        model = palpate.HandleModel()
        model.kx[0, 1] = 3.0
        self.assertEqual(model.kx[0, 1], 3.0)
        model.kx = np.arange(36.0).reshape(6, 6)
        self.assertEqual(model.kx[1, 2], 8.0)
        model.pose.position[2] = 0.5
        self.assertEqual(model.pose.position[2], 0.5)
        model.pose.rotation = [0, 0, 1, 0]
        np.testing.assert_allclose(model.pose.matrix, np.diag([-1.0, 1.0, -1.0]), atol=1e-15)


class Matrices(unittest.TestCase):
    def test_system_is_mass_and_stiffness(self):
        world = pressed()
        world.evaluate(step=0.02)
        tool = world.tool
        stiffness, system = palpate.symmetric(tool.stiffness()), palpate.symmetric(tool.system())
        mass = np.repeat(tool.masses[tool.free_nodes], 3)
        wanted = (0.02 * 0.002 + 0.02**2) * stiffness.toarray() + np.diag(mass)
        np.testing.assert_allclose(system.toarray(), wanted, rtol=0, atol=1e-12 * abs(wanted).max())
        self.assertLess(abs(system - system.T).max(), 1e-14 * abs(wanted).max())

    def test_stiffness_is_the_forces_derivative(self):
        # at the rest shape, where rotations do not matter to first order
        world = palpate.World(cube(handle="top"))
        tool = world.tool
        nodes = tool.attached_nodes
        tool.set_handle(palpate.Pose())  # whose frame is not turned at rest
        tool.set_handle(palpate.Pose((tool.rest_positions - tool.positions)[nodes].mean(axis=0)))
        tool.set_state(tool.rest_positions, 0 * tool.velocities)
        np.testing.assert_allclose(tool.positions, tool.rest_positions, atol=1e-12)
        stiffness = palpate.symmetric(tool.stiffness())
        rows = np.repeat(3 * tool.free_nodes, 3) + np.tile([0, 1, 2], len(tool.free_nodes))
        change = np.zeros(3 * tool.nodes)
        change[rows] = 1e-7 * np.random.default_rng(1).standard_normal(len(rows))
        tool.set_state(tool.rest_positions + change.reshape(-1, 3), 0 * tool.velocities)
        world.evaluate()
        force = -stiffness @ change[rows]
        np.testing.assert_allclose(tool.forces.ravel()[rows], force, rtol=0, atol=1e-5 * abs(force).max())

    def test_matrices_share_the_solvers_memory(self):
        world = pressed()
        self.assertTrue(np.shares_memory(world.tool.system().data, world.tool.system().data))
        self.assertFalse(np.shares_memory(world.tool.stiffness().data, world.tool.stiffness().data))

    def test_delassus_is_symmetric_and_positive(self):
        island = pressed().contacts().islands[0]
        self.assertEqual(island.W.shape, (3 * len(island.contacts), 3 * len(island.contacts)))
        self.assertTrue(island.W.flags.c_contiguous)
        np.testing.assert_array_equal(island.W, island.W.T)
        self.assertGreater(np.linalg.eigvalsh(island.W).min(), 0)


if __name__ == "__main__":
    unittest.main()
