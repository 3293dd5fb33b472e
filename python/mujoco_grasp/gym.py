"""Grasps in a gymnasium `MujocoEnv`."""

from typing import Any, ClassVar

import mujoco
import numpy.typing as npt

from . import Grasps


class GraspMixin:
    """Steps a `gymnasium.envs.mujoco.MujocoEnv` by its grasps.

    It comes before the environment among the bases, which stays as it is:

        class HandEnv(GraspMixin, MujocoEnv):
            grasp_options = {"target": "ball"}
    """

    grasp_options: ClassVar[dict[str, Any]] = {}
    """Options of `mujoco_grasp.Grasps`, with the target."""

    # of the environment
    model: mujoco.MjModel
    data: mujoco.MjData

    _grasps: Grasps | None = None

    @property
    def grasps(self) -> Grasps:
        """The grasps of the environment's present model and data."""
        if self._grasps is None or self._grasps.data is not self.data:
            self._grasps = Grasps(self.model, self.data, **self.grasp_options)
        return self._grasps

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Resets the environment, and with it the grasps."""
        self.grasps.reset()
        return super().reset(seed=seed, options=options)  # type: ignore[misc, no-any-return]

    def _step_mujoco_simulation(self, ctrl: npt.ArrayLike, n_frames: int) -> None:
        self.data.ctrl[:] = ctrl
        self.grasps.step(n_frames)
        # As MujocoEnv does: cfrc_ext and the like, which mj_step computes only for sensors.
        mujoco.mj_rnePostConstraint(self.model, self.data)
