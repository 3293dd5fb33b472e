"""A gymnasium environment whose steps are those of its grasps: one base more, nothing else.

python examples/python/gym_env.py
"""

import pathlib

import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box

from mujoco_grasp.gym import GraspMixin

MODEL = pathlib.Path(__file__).parents[1] / "gripper.xml"


class LiftEnv(GraspMixin, MujocoEnv):
    """Lift a ball with a gripper: the reward is its height, m."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"], "render_fps": 50}
    grasp_options = {"target": "ball", "palm": "palm"}

    def __init__(self, **kwargs):
        space = Box(-np.inf, np.inf, shape=(22,), dtype=np.float64)
        super().__init__(str(MODEL), frame_skip=10, observation_space=space, **kwargs)

    def step(self, action):
        self.do_simulation(action, self.frame_skip)
        height = self.data.body("ball").xpos[2]
        return self.observe(), height, False, False, {"phase": self.grasps[0].phase}

    def reset_model(self):
        self.set_state(self.init_qpos, self.init_qvel)
        return self.observe()

    def observe(self):
        forces = sum((contact.force for contact in self.grasps[0].contacts()), np.zeros(3))
        return np.concatenate([self.data.qpos, self.data.qvel, forces])


def main():
    """Two episodes; the phases at their ends."""
    env = LiftEnv()
    phases = []
    for _ in range(2):
        env.reset(seed=0)
        for step in range(75):
            _, reward, _, _, info = env.step(np.array([0.001 * max(0, step - 25), 0.01, 0.01]))
        phases.append(info["phase"])
        print(f"height {reward:.3f} m, {info['phase']}")
    env.close()
    return phases


if __name__ == "__main__":
    main()
