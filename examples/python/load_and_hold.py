"""The whole of it: one line in the place of mj_step.

python examples/python/load_and_hold.py
"""

import pathlib

import mujoco

import mujoco_grasp as mg

MODEL = pathlib.Path(__file__).parents[1] / "gripper.xml"


def main():
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    grasps = mg.Grasps(model, data, target="ball")
    while data.time < 2.0:
        lift = 0.05 * min(1.0, max(0.0, data.time - 0.5))
        data.ctrl[:] = [lift, 0.01, 0.01]
        grasps.step(10)  # mujoco.mj_step(model, data, 10)
    grasp = grasps[0]
    print(f"{grasp.phase} since {grasp.latched_at:.3f} s, Q = {grasp.quality:.2f} N, {grasps.frozen_steps} frozen steps")
    for contact in grasp.contacts():
        print(f"{contact.link}: {contact.normal_force:.2f} N, sliding: {contact.is_sliding}")
    return grasps


if __name__ == "__main__":
    main()
