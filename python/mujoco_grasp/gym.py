"""Grasps in a gymnasium `MujocoEnv`."""

from typing import Any, ClassVar

import mujoco
import numpy.typing as npt

from . import Grasps, SpecError


class GraspMixin:
    """Steps a `gymnasium.envs.mujoco.MujocoEnv` by its grasps.

    It comes before the environment among the bases, which stays as it is:

        class HandEnv(GraspMixin, MujocoEnv):
            grasp_options = {"target": "ball"}
    """

    grasp_options: ClassVar[dict[str, Any]] = {}
    """Options of `mujoco_grasp.Grasps`, with the target."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        step = "_step_mujoco_simulation"
        stepper = next(base for base in cls.__mro__ if step in vars(base))
        if not issubclass(stepper, GraspMixin):
            others = ", ".join(base.__name__ for base in cls.__bases__ if base is not GraspMixin)
            raise TypeError(
                f"{cls.__name__} would step without grasps, as {stepper.__name__} comes before GraspMixin among its bases; "
                f"right is class {cls.__name__}(GraspMixin, {others})"
            )

    # of the environment
    model: mujoco.MjModel
    data: mujoco.MjData

    _grasps: Grasps | None = None

    @property
    def grasps(self) -> Grasps:
        """The grasps of the environment's present model and data."""
        if self._grasps is None or self._grasps.data is not self.data:
            self._grasps = self.make_grasps()
        return self._grasps

    def make_grasps(self) -> Grasps:
        """Those of `grasp_options`; to be overridden for several."""
        if self.grasp_options.get("target") is None:
            raise SpecError(
                f"grasp_options of {type(self).__name__} is {self.grasp_options!r}; it must be a dictionary with the target, "
                'as {"target": "ball"}'
            )
        return Grasps(self.model, self.data, **self.grasp_options)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Resets the environment, and with it the grasps."""
        self.grasps.reset()
        return super().reset(seed=seed, options=options)  # type: ignore[misc, no-any-return]

    def _step_mujoco_simulation(self, ctrl: npt.ArrayLike, n_frames: int) -> None:
        self.data.ctrl[:] = ctrl
        self.grasps.step(n_frames)
        # As MujocoEnv does: cfrc_ext and the like, which mj_step computes only for sensors.
        mujoco.mj_rnePostConstraint(self.model, self.data)
