"""Pictures of a grasp without a display, as in a notebook, where `frames[-1]` is shown by `mediapy` or Pillow.

MUJOCO_GL=egl python examples/python/notebook.py
"""

import pathlib

import mujoco

import mujoco_grasp as mg
from mujoco_grasp.viewer import draw

MODEL = pathlib.Path(__file__).parents[1] / "gripper.xml"


def main():
    """Frames, 25 a second: arrays of shape (height, width, 3)."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    grasps = mg.Grasps(model, data, target="ball")
    frames = []
    with mujoco.Renderer(model, 240, 320) as renderer:
        while data.time < 1.0:
            data.ctrl[:] = [0.05 * max(0.0, data.time - 0.5), 0.01, 0.01]
            grasps.step(20)
            renderer.update_scene(data)
            draw(grasps, renderer.scene)
            frames.append(renderer.render())
    print(f"{len(frames)} frames, {grasps[0].phase}, Q = {grasps[0].quality:.2f} N")
    return frames


if __name__ == "__main__":
    main()
