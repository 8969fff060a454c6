"""Palpate: hold a soft object by a handle, push it into things, and feel it at 1 kHz.

    import palpate
    trace = palpate.Run(palpate.Scene("scenes/cube.yaml")).finish()
    print(abs(trace.sent[:, :3]).max(), "N")

docs/python.md says what there is; units are m, kg, s, N, N m, rad; quaternions are w x y z.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._palpate import (
    Body,
    Contacts,
    DeviceState,
    HandleModel,
    HapticLoop,
    HapticState,
    Island,
    Link,
    Pose,
    Run,
    RunError,
    RunState,
    Scene,
    StepReport,
    StepTimes,
    TickRecord,
    Trace,
    World,
    __version__,
    one_d,
    rollout,
)

if TYPE_CHECKING:
    from typing import Any

__all__ = [
    "Body",
    "Contacts",
    "DeviceState",
    "HandleModel",
    "HapticLoop",
    "HapticState",
    "Island",
    "Link",
    "Pose",
    "Run",
    "RunError",
    "RunState",
    "Scene",
    "StepReport",
    "StepTimes",
    "TickRecord",
    "Trace",
    "World",
    "__version__",
    "one_d",
    "rollout",
    "symmetric",
]


def symmetric(upper: Any) -> Any:
    """The whole matrix, as CSR, of an upper triangle by blocks (Body.system(), Body.stiffness())."""
    whole = upper.tocsr()
    below = upper.copy()
    # the diagonal's blocks hold all their entries already
    below.data[below.indptr[:-1]] = 0.0
    return whole + below.tocsr().T


for _name in __all__:
    if isinstance(globals()[_name], type):
        globals()[_name].__module__ = "palpate"
