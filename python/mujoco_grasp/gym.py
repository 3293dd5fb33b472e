"""Grasps in a gymnasium `MujocoEnv`."""

from typing import Any, ClassVar

import mujoco

from . import Grasps


class GraspMixin:
    """Steps a `gymnasium.envs.mujoco.MujocoEnv` by its grasps.

    It comes before the environment among the bases, which stays as it is:

        class HandEnv(GraspMixin, MujocoEnv):
            grasp_options = {"target": "ball"}
    """

    grasp_options: ClassVar[dict[str, Any]] = {}
    """Options of `mujoco_grasp.Grasps`, with the target."""

    _grasps: Grasps | None = None

    @property
    def grasps(self) -> Grasps:
        """The grasps of the environment's present model and data."""
        if self._grasps is None or self._grasps.data is not self.data:
            self._grasps = Grasps(self.model, self.data, **self.grasp_options)
        return self._grasps

    def reset(self, *, seed=None, options=None):
        """Resets the environment, and with it the grasps."""
        self.grasps.reset()
        return super().reset(seed=seed, options=options)

    def _step_mujoco_simulation(self, ctrl, n_frames):
        self.data.ctrl[:] = ctrl
        self.grasps.step(n_frames)
        # As MujocoEnv does: cfrc_ext and the like, which mj_step computes only for sensors.
        mujoco.mj_rnePostConstraint(self.model, self.data)
