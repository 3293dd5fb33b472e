"""Grasps on MuJoCo at a fraction of the cost, in place on your own `MjModel` and `MjData`.

    import mujoco, mujoco_grasp as mg

    model = mujoco.MjModel.from_xml_path("hand.xml")
    data = mujoco.MjData(model)
    grasps = mg.Grasps(model, data, target="ball")
    while data.time < 5:
        data.ctrl[:] = policy(data)
        grasps.step(10)                                # instead of mujoco.mj_step(model, data, 10)

World frame, SI units, angles in radians. A contact's normal points into the target, and forces are those on the target.
`mujoco.rollout` and `mujoco.batch` call plain `mj_step`: they bypass grasps.
"""

from . import errors
from ._load import load as _load
from ._load import served as served_versions
from .errors import (
    BadControlError,
    BufferFullError,
    BusyError,
    DivergedError,
    EngineError,
    EngineWarning,
    Error,
    ModelError,
    ResetError,
    ScenarioError,
    SpecError,
    StateError,
    UnknownNameError,
    VersionError,
)

_load()  # puts the core where the imports find it

from ._core import Batch, Contact, Grasp, Grasps, QualityReport, State, mujoco_version, weld_xml  # noqa: E402
from .scenario import agree, bench, run, scenarios  # noqa: E402
from .sweeps import sweep  # noqa: E402

__all__ = [
    "BadControlError",
    "Batch",
    "BufferFullError",
    "BusyError",
    "Contact",
    "DivergedError",
    "EngineError",
    "EngineWarning",
    "Error",
    "Grasp",
    "Grasps",
    "ModelError",
    "QualityReport",
    "ResetError",
    "ScenarioError",
    "SpecError",
    "State",
    "StateError",
    "UnknownNameError",
    "VersionError",
    "agree",
    "bench",
    "errors",
    "mujoco_version",
    "run",
    "scenarios",
    "served_versions",
    "sweep",
    "weld_xml",
]
