"""A grasp in MuJoCo's passive viewer, with its contacts, forces and phase drawn over the scene.

    python examples/python/viewer.py

Needs a display; `main` can also be run with another scene to draw into.
"""

import pathlib
import time

import mujoco
import mujoco.viewer

import mujoco_grasp as mg
from mujoco_grasp.viewer import draw

MODEL = pathlib.Path(__file__).parents[1] / "gripper.xml"


def load():
    """Model, data and grasps; the gripper closes and lifts."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    return model, data, mg.Grasps(model, data, target="ball")


def control(data):
    """Close at once, lift after half a second."""
    data.ctrl[:] = [0.05 * max(0.0, data.time - 0.5), 0.01, 0.01]
    data.ctrl[0] = min(data.ctrl[0], 0.05)


def main():
    model, data, grasps = load()
    with mujoco.viewer.launch_passive(model, data) as viewer:
        while viewer.is_running() and data.time < 10:
            began = time.perf_counter()
            with viewer.lock():
                control(data)
                grasps.step(10)
                draw(grasps, viewer.user_scn, clear=True)
            viewer.sync()
            time.sleep(max(0.0, 10 * model.opt.timestep - (time.perf_counter() - began)))


if __name__ == "__main__":
    main()
