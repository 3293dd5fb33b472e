"""dm_control: a Physics whose steps are those of its grasps.

    python examples/python/dm_physics.py

dm_control's legacy step calls mj_step2 for the state at hand and then mj_step1 for the next, so that all that depends on
positions is of the present state. Steps of grasps are whole, so here mj_step1 alone remains.
"""

import pathlib

import mujoco
from dm_control.mujoco import Physics

import mujoco_grasp as mg

MODEL = pathlib.Path(__file__).parents[1] / "gripper.xml"


class GraspPhysics(Physics):
    """A dm_control Physics with grasps; all else is dm_control's."""

    grasps = None

    def add_grasp(self, target, **options):
        """A grasp of the present model and data; call it again after a reload."""
        if self.grasps is None or self.grasps.data is not self.data.ptr:
            self.grasps = mg.Grasps(self.model.ptr, self.data.ptr)
        return self.grasps.add(target, **options)

    def reset(self, keyframe_id=None):
        super().reset(keyframe_id)
        if self.grasps is not None:
            self.grasps.reset()

    def step(self, nstep=1):
        if self.grasps is None:
            super().step(nstep)
            return
        with self.check_invalid_state():
            self.grasps.step(nstep)
            if self.legacy_step:
                mujoco.mj_step1(self.model.ptr, self.data.ptr)


def main():
    """The physics and its grasp after two seconds."""
    physics = GraspPhysics.from_xml_path(str(MODEL))
    grasp = physics.add_grasp("ball", palm="palm")
    with physics.reset_context():
        physics.named.data.qpos["lift"] = 0.0
    while physics.time() < 2.0:
        physics.set_control([0.05 * min(1.0, max(0.0, physics.time() - 0.5)), 0.01, 0.01])
        physics.step(10)
    print(f"{grasp.phase}, ball at {physics.named.data.xpos['ball', 'z']:.3f} m")
    return physics, grasp


if __name__ == "__main__":
    main()
