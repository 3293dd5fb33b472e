"""The examples run, with the real packages."""

import contextlib
import importlib
import sys

import mujoco
import mujoco.viewer
import numpy as np
import pytest
from conftest import ROOT, in_another_process, latched

import mujoco_grasp as mg
from mujoco_grasp.gym import GraspMixin
from mujoco_grasp.viewer import draw

sys.path.insert(0, str(ROOT / "examples/python"))


def example(name, *needs):
    for need in needs:
        pytest.importorskip(need)
    return importlib.import_module(name)


def test_load_and_hold():
    grasps = example("load_and_hold").main()
    assert grasps[0].is_grasped
    assert grasps.data.body("ball").xpos[2] > 0.05
    assert grasps.frozen_steps > 500


def test_gym_env():
    assert example("gym_env", "gymnasium", "imageio").main() == ["grasped", "grasped"]


def test_gym_env_without_latch_is_the_environment_alone():
    gym_env = example("gym_env", "gymnasium", "imageio")
    from gymnasium.envs.mujoco import MujocoEnv

    class Alone(gym_env.LiftEnv):
        _step_mujoco_simulation = MujocoEnv._step_mujoco_simulation

    env, alone = gym_env.LiftEnv(), Alone()
    for one in (env, alone):
        one.reset(seed=0)
    for _ in range(3):
        action = np.array([0.0, 0.004, 0.004])
        assert env.step(action)[4]["phase"] == "ungrasped"
        alone.step(action)
        assert np.array_equal(env.data.qpos, alone.data.qpos)
        assert np.array_equal(env.data.cfrc_ext, alone.data.cfrc_ext)


def test_gym_env_that_would_step_without_grasps_is_an_error():
    gym_env = example("gym_env", "gymnasium", "imageio")
    from gymnasium.envs.mujoco import MujocoEnv

    with pytest.raises(TypeError, match=r"would step without grasps.*class Wrong\(GraspMixin, MujocoEnv\)"):
        type("Wrong", (MujocoEnv, GraspMixin), {"grasp_options": {"target": "ball"}})
    for options in ({}, {"palm": "palm"}):
        env = type("NoTarget", (gym_env.LiftEnv,), {"grasp_options": options})()
        with pytest.raises(mg.SpecError, match=r"grasp_options of NoTarget is .* with the target"):
            env.reset()


def test_dm_physics():
    physics, grasp = example("dm_physics", "dm_control").main()
    assert grasp.is_grasped
    assert physics.legacy_step
    assert physics.named.data.xpos["ball", "z"] > 0.05
    # as dm_control leaves it: what depends on positions is of the present ones
    before = physics.data.xpos.copy()
    mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
    assert np.array_equal(physics.data.xpos, before)
    physics.reset()
    physics.step()
    assert not grasp.is_grasped


def test_robosuite_lift():
    grasps, lifted = example("robosuite_lift", "robosuite").main()
    assert grasps[0].is_grasped
    assert grasps[0].latched_time > 0.5
    assert lifted > 0.03


def test_a_target_without_mass_is_drawn():
    model, _, grasps = latched()
    model.body_subtreemass[:] = 0
    assert draw(grasps, mujoco.MjvScene(model, 100)) == 5


def test_viewer_draws_contacts_forces_and_phase():
    viewer = example("viewer")
    model, data, grasps = viewer.load()
    scene = mujoco.MjvScene(model, maxgeom=50)
    assert draw(grasps, scene) == 1
    assert scene.geoms[0].label == "ball: ungrasped, Q = 0.00 N"
    while data.time < 1.0:
        viewer.control(data)
        grasps.step(10)
    assert draw(grasps, scene, metres_per_newton=0.01, clear=True) == 5
    kinds = [geom.type for geom in scene.geoms[: scene.ngeom]]
    ball, arrow = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ARROW
    assert kinds == [ball, arrow, ball, arrow, mujoco.mjtGeom.mjGEOM_LABEL]
    assert scene.geoms[4].label.startswith("ball: grasped, Q = ")
    for geom, contact in zip(scene.geoms[0:4:2], grasps[0].contacts(), strict=True):
        assert geom.pos == pytest.approx(contact.position, abs=1e-6)
    # the arrow is along the force, a centimetre for each newton
    force = grasps[0].contacts()[0].force
    assert scene.geoms[1].mat[:, 2] == pytest.approx(force / np.linalg.norm(force), abs=1e-5)
    assert scene.geoms[1].size[2] == pytest.approx(2 * 0.01 * np.linalg.norm(force), rel=1e-5)  # drawn half as long


class WithoutWindow:
    """What the passive viewer's handle has, as far as the example uses it, for a display that is not there."""

    def __init__(self, model, data):
        self.data, self.user_scn, self.synced = data, mujoco.MjvScene(model, maxgeom=50), []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def lock(self):
        return contextlib.nullcontext()

    def is_running(self):
        return self.data.time < 0.3

    def sync(self):
        self.synced.append(self.user_scn.ngeom)


def test_viewer_runs_a_loop(monkeypatch):
    viewer = example("viewer")
    made = []
    monkeypatch.setattr(mujoco.viewer, "launch_passive", lambda m, d: made.append(WithoutWindow(m, d)) or made[0])
    viewer.main()
    assert made[0].data.time == pytest.approx(0.3)
    # each frame has its own shapes and no others
    assert len(made[0].synced) == 15
    assert set(made[0].synced) == {5}


def test_a_scene_that_is_full_takes_no_more():
    model, _, grasps = latched()
    scene = mujoco.MjvScene(model, maxgeom=3)
    assert draw(grasps, scene) == 3
    assert draw(grasps, scene) == 0
    assert draw(grasps, scene, labels=False, clear=True) == 3


def test_notebook():
    pytest.importorskip("OpenGL")
    code = (
        "import sys; sys.path.insert(0, 'examples/python')\n"
        "import notebook\n"
        "frames = notebook.main()\n"
        # the overlay is seen: green, while the grasp holds
        "green = lambda f: int(((f[..., 1] > 120) & (f[..., 0] < 110) & (f[..., 2] < 130)).sum())\n"
        "print(len(frames), frames[-1].shape, green(frames[-1]) > green(frames[0]))"
    )
    says, frames = in_another_process(code, MUJOCO_GL="egl").splitlines()
    assert says.startswith("25 frames, grasped, Q = ")
    assert frames == "25 (240, 320, 3) True"
