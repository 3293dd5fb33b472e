"""Steps from Python are those of Rust, and of MuJoCo where nothing is latched, bit for bit."""

import mujoco
import numpy as np
import pytest
from conftest import Clutch, ShadowBlock, latched, reference

import mujoco_grasp as mg

STEPS = 5000


@pytest.mark.parametrize("n", [1, 10])
@pytest.mark.parametrize("make", [Clutch, ShadowBlock])
def test_5000_steps_are_those_of_rust(make, n, tmp_path):
    scene = make()
    inputs = scene.inputs(STEPS, n)
    expected = reference(scene, inputs, n, tmp_path)
    latched = 0
    for call, row in enumerate(inputs):
        scene.apply(row)
        scene.grasps.step(n)
        latched += scene.grasps[0].is_grasped
        assert np.array_equal(scene.outputs(), expected[call]), f"call {call}"
    assert latched * n > 3000, "the grasp is to be latched for most of it"
    assert (scene.grasps.frozen_steps > 1500) == (n == 10)


def test_until_the_first_latch_data_is_that_of_mj_step():
    clutch, alone = Clutch(), Clutch()
    steps = 0
    for row in clutch.inputs(STEPS, 1):
        for one in (clutch, alone):
            one.apply(row)
        clutch.grasps.step()
        if clutch.grasps[0].is_grasped:
            # this step was still the engine's
            assert np.array_equal(clutch.data.qpos, alone_step(alone).qpos)
            break
        alone_step(alone)
        steps += 1
        for name in ("qpos", "qvel", "qacc", "qacc_warmstart", "xpos", "sensordata", "efc_force", "cfrc_ext", "time"):
            assert np.array_equal(getattr(clutch.data, name), getattr(alone.data, name)), f"{name} after {steps} steps"
        assert clutch.data.ncon == alone.data.ncon
    assert 100 < steps < STEPS


def alone_step(clutch):
    mujoco.mj_step(clutch.model, clutch.data)
    return clutch.data


def test_a_replay_from_a_saved_state_is_the_same_bit_for_bit():
    model, data, grasps = latched()
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state, saved = np.empty(mujoco.mj_stateSize(model, kind)), grasps.save()
    mujoco.mj_getState(model, data, state, kind)

    def replay(data, grasps):
        for _ in range(200):
            grasps.step()
        return np.concatenate([data.qpos, data.qvel, [grasps[0].quality, grasps[0].latched_time]])

    expected = replay(data, grasps)
    mujoco.mj_setState(model, data, state, kind)
    grasps.restore(saved)
    assert np.array_equal(replay(data, grasps), expected)
    # and in data and grasps of their own
    other = mujoco.MjData(model)
    again = mg.Grasps(model, other, target="ball")
    mujoco.mj_setState(model, other, state, kind)
    again.restore(mg.State.from_json(saved.to_json()))
    assert again[0].is_grasped
    assert np.array_equal(replay(other, again), expected)


def edits():
    """Changes of model and data between two calls."""
    yield "friction", lambda m, d: m.geom_friction.__setitem__((slice(None), 0), 0.3)
    yield "size", lambda m, d: m.geom_size.__setitem__((m.geom("ball").id if m.geom("ball").name else -1, 0), 0.0304)
    yield "mass", lambda m, d: m.body_mass.__setitem__(m.body("ball").id, 0.5)
    yield "armature", lambda m, d: m.dof_armature.__setitem__(0, 0.1)
    yield "gear", lambda m, d: m.actuator_gear.__setitem__((1, 0), 1.01)
    yield "limits", lambda m, d: m.jnt_solimp.__setitem__((0, 0), 0.8)
    yield "gravity", lambda m, d: m.opt.gravity.__setitem__(2, -3.0)
    yield "position", lambda m, d: d.qpos.__setitem__(0, d.qpos[0] + 1e-4)
    yield "forward", mujoco.mj_forward
    yield "step1", mujoco.mj_step1
    yield "collision", lambda m, d: (mujoco.mj_collision(m, d), mujoco.mj_makeConstraint(m, d))


EDITS = dict(edits())


@pytest.mark.parametrize("name", EDITS)
def test_what_is_changed_between_two_calls_counts_from_the_next_step(name):
    results = []
    # what an edit does must not wait for the next whole step: it is the same where all steps are whole from then on
    for frozen in (True, False):
        model, data, grasps = latched()
        grasps.step(10)
        grasps.step(10)
        before = grasps.frozen_steps, grasps.whole_steps.get("changed", 0)
        assert before[0] > 0
        EDITS[name](model, data)
        if not frozen:
            grasps.frozen_tolerance = 0
        grasps.step(2)
        results.append(np.concatenate([data.qpos, data.qvel]))
        assert grasps.whole_steps.get("changed", 0) == before[1] + frozen
        assert grasps.frozen_steps == before[0]
    assert np.array_equal(*results)


def test_inputs_do_not_keep_steps_from_being_frozen():
    model, data, grasps = latched()
    grasps.step(10)
    before = grasps.whole_steps.get("changed", 0)
    for i in range(20):
        data.ctrl[1:] = 0.01 + 1e-5 * np.sin(i)
        data.xfrc_applied[-1, 0] = 0.01 * np.sin(i)
        # read anew in every step, too
        model.dof_damping[0] = 60 + np.sin(i)
        model.actuator_gainprm[1, 0] = 300 + np.sin(i)
        grasps.step(10)
    assert grasps.whole_steps.get("changed", 0) == before
    assert grasps.frozen_steps > 150
