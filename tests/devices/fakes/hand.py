"""A device's mass with a hand behind it, for the fakes: m a = f + kh (xt - x) + bh (vt - v) - b v."""

import math


class Hand:
    """Semi-implicit Euler in steps of at most a quarter of a millisecond; plain lists, as it runs thousands of times a second."""

    def __init__(self, mass=0.15, damping=0.3, stiffness=200.0, hand_damping=5.0, amplitude=0.02, period=1.0, home=(0.0, 0.0, 0.0)):
        self.mass, self.damping, self.stiffness, self.hand_damping = mass, damping, stiffness, hand_damping
        self.amplitude, self.period, self.home = amplitude, period, list(home)
        self.position, self.velocity, self.time = list(home), [0.0, 0.0, 0.0], 0.0

    def target(self, t):
        """Down and up along z, beginning at rest."""
        w = 2 * math.pi / self.period
        z = -0.5 * self.amplitude * (1 - math.cos(w * t))
        return (0.0, 0.0, z), (0.0, 0.0, -0.5 * self.amplitude * w * math.sin(w * t))

    def advance(self, force, dt):
        steps = min(400, max(1, math.ceil(dt / 2.5e-4)))
        h = min(dt, 0.1) / steps
        for _ in range(steps):
            self.time += h
            where, speed = self.target(self.time)
            for k in range(3):
                pull = (force[k] + self.stiffness * (self.home[k] + where[k] - self.position[k])
                        + self.hand_damping * (speed[k] - self.velocity[k]) - self.damping * self.velocity[k])
                self.velocity[k] += h * pull / self.mass
                self.position[k] += h * self.velocity[k]
