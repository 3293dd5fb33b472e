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

_core = _load()
Batch = _core.Batch
Contact = _core.Contact
Grasp = _core.Grasp
Grasps = _core.Grasps
QualityReport = _core.QualityReport
State = _core.State
mujoco_version = _core.mujoco_version
weld_xml = _core.weld_xml

from .errors import *  # noqa: E402, F403
from .scenario import agree, bench, run, scenarios  # noqa: E402
from .sweeps import sweep  # noqa: E402

__all__ = [
    "Batch",
    "Contact",
    "Grasp",
    "Grasps",
    "QualityReport",
    "State",
    "agree",
    "bench",
    "errors",
    "mujoco_version",
    "run",
    "scenarios",
    "served_versions",
    "sweep",
    "weld_xml",
    *errors.__all__,
]
