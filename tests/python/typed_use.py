"""Never run: what mypy is to accept."""

import numpy as np
import palpate
from numpy.typing import NDArray

scene = palpate.Scene("scenes/cube.yaml", method="hsl", visual_dt=0.02)
world = palpate.World(scene)
report: palpate.StepReport = world.step(world.start.advanced(np.zeros(6)), step=0.033)
positions: NDArray[np.float64] = world.tool.positions
model: palpate.HandleModel = world.linearize()
model.kx = np.zeros((6, 6))
loop = palpate.HapticLoop.of(world)
force: float = float(loop.tick(model, palpate.DeviceState(world.start)).sent[0])


class Hand:
    def sample(self, t: float) -> palpate.Pose:
        return palpate.Pose([0, 0, t])

    def apply(self, wrench: NDArray[np.float64], t: float, dt: float) -> None:
        pass


traces: list[palpate.Trace] = palpate.rollout([scene, scene])
palpate.Run(scene, slow_device=Hand()).advance(10)
