"""robosuite: a Panda that lifts a cube, stepped by its grasp.

    python examples/python/robosuite_lift.py

robosuite's environments call step1, let the controller act, and call step2 ("lite_physics"), or forward and step without.
Steps of grasps are whole, so they take the place of step2 and of step; step1 stays, as the controller reads what it computes.
"""

import types

import mujoco
import numpy as np
import robosuite
from robosuite.controllers import load_composite_controller_config
from robosuite.controllers.parts import controller
from robosuite.utils.binding_utils import MjData, MjModel

import mujoco_grasp as mg

# robosuite 1.5.2 is older than MuJoCo 3.17, and needs three lines for it: among MuJoCo's enums numpy's integers are not found
# any more, and the inertia matrix is not called qM.
MjModel.jnt_type = property(lambda model: model._model.jnt_type.tolist())
MjData.qM = property(lambda data: data._data)
controller.mujoco = types.SimpleNamespace(mj_fullM=lambda model, dense, data: mujoco.mj_fullM(model, data, dense))


def add_grasps(env, target, **options):
    """Steps the environment's present simulation by a grasp; to be called after each (hard) reset."""
    sim = env.sim
    grasps = mg.Grasps(sim.model._model, sim.data._data, target, **options)
    sim.step2 = grasps.step
    sim.step = lambda with_udd=True: grasps.step()
    return grasps


def main(steps=120):
    """Goes down to the cube, closes, lifts; returns the grasps and the cube's height over the table, m."""
    env = robosuite.make(
        "Lift",
        robots="Panda",
        controller_configs=load_composite_controller_config(controller="BASIC", robot="Panda"),
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        use_object_obs=True,
        horizon=steps + 1,
        seed=1,
    )
    observed = env.reset()
    hand = next(body for body in env.sim.model.body_names if body.endswith("right_hand"))
    grasps = add_grasps(env, env.cube.root_body, palm=hand)
    height = observed["cube_pos"][2]
    for step in range(steps):
        to_cube = observed["cube_pos"] - observed["robot0_eef_pos"]
        action = np.zeros(env.action_dim)
        if step < 60:
            action[:3] = np.clip(8 * to_cube, -1, 1)
        elif step > 80:
            action[2] = 0.4
        action[-1] = 1.0 if step >= 60 else -1.0
        observed, *_ = env.step(action)
    lifted = observed["cube_pos"][2] - height
    print(f"{grasps[0].phase} since {grasps[0].latched_at} s, lifted by {lifted:.3f} m")
    return grasps, lifted


if __name__ == "__main__":
    main()
