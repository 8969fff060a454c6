"""What the tests of the Python package share."""

import os
import pathlib

import palpate

SOURCE = pathlib.Path(__file__).resolve().parent.parent.parent
PROGRAM = os.environ.get("PALPATE_PROGRAM", "")


def cube(**options):
    """The shipped cube, pressed onto the ground from 0.62 s on."""
    return palpate.Scene(SOURCE / "scenes/cube.yaml", **options)


def pressed(**options):
    """A world in which the cube is pressed onto the ground, after a step."""
    world = palpate.World(cube(**options))
    world.step(world.start.advanced([0, 0, -0.014, 0, 0.02, 0]))
    return world
