"""What grasps say, and what they leave alone."""

import copy
import gc
import pickle

import mujoco
import numpy as np
import pytest
from conftest import GRIPPER, gripper, latched

import mujoco_grasp as mg


def test_a_grasp_latches_holds_and_lets_go():
    _, data, grasps = gripper()
    grasp = grasps[0]
    assert (grasp.phase, grasp.is_grasped, grasp.latched_at) == ("ungrasped", False, None)
    while data.time < 0.5:
        grasps.step()
    assert (grasp.target, grasp.palm, grasp.effectors) == ("ball", "palm", ["left", "right"])
    assert (grasp.phase, grasp.would_latch, grasp.limits) == ("grasped", True, "cones")
    assert grasp.quality > grasp.latch_quality > grasp.release_quality > 0
    assert grasp.latched_time == pytest.approx(data.time - grasp.latched_at)
    assert (grasp.merged_time, grasp.bounds, grasp.merged_wrench) == (0, None, None)
    data.ctrl[1:] = -0.01
    while data.time < 0.8:
        grasps.step(10)
    assert grasp.phase == "ungrasped"
    assert 0 < grasp.latched_time < 0.8


def test_contacts_have_live_forces_that_hold_the_ball():
    model, data, grasps = latched()
    data.ctrl[0] = 0.02  # off the floor
    grasps.step(1000)
    contacts = grasps[0].contacts()
    assert [contact.link for contact in contacts] == ["left", "right"]
    weight = model.body("ball").mass[0] * 9.81
    assert sum(contact.force for contact in contacts) == pytest.approx([0, 0, weight], abs=0.05 * weight)
    for contact in contacts:
        assert contact.axes @ contact.axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.array_equal(contact.axes[0], contact.normal)
        assert contact.axes.T @ contact.force_rows[:3] == pytest.approx(contact.force)
        assert contact.normal_force == contact.force_rows[0] > 0
        # the normal points into the target
        assert contact.normal @ (data.body("ball").xipos - contact.position) > 0
        assert contact.slip_velocity.shape == (3,)
        assert contact.friction.shape == (5,)
        assert (contact.condim, contact.is_sliding) == (4, False)
        assert contact.dist < 0
    # MuJoCo's own list has them with the same forces
    force = np.zeros(6)
    found = []
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        found.append(force[0])
    for contact in contacts:
        assert any(f == pytest.approx(contact.normal_force) for f in found)


def test_quality_in_all_measures():
    _, _, grasps = latched()
    measures = grasps[0].measures()
    assert measures.min_singular_value_n == pytest.approx(grasps[0].quality)
    assert measures.force_closure
    assert measures.holds_own_weight
    assert measures.contacts == 2
    assert 0 < measures.isotropy < 1
    assert "force_closure=True" in repr(measures)


def test_model_options_and_warning_counters_are_as_the_user_set_them():
    model, data, grasps = gripper()
    options = model.opt
    options.noslip_iterations = 7
    options.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    set_by_user = {name: copy.copy(getattr(options, name)) for name in dir(options) if not name.startswith("_")}
    data.warning[0].number = 3
    for n in [1] * 200 + [10] * 20:
        grasps.step(n)
        for name, value in set_by_user.items():
            assert np.array_equal(getattr(options, name), value), name
    assert grasps[0].is_grasped
    assert data.warning[0].number == 3


def test_box_and_rigid_leave_the_users_options():
    text = GRIPPER.read_text().replace("</mujoco>", mg.weld_xml("ball", "palm") + "</mujoco>")
    for limits in ("box", "rigid"):
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.noslip_iterations = 5
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        data = mujoco.MjData(model)
        data.ctrl[:] = [0.0, 0.01, 0.01]
        grasps = mg.Grasps(model, data, target="ball", limits=limits)
        for _ in range(250):
            grasps.step()
            assert (model.opt.noslip_iterations, model.opt.jacobian) == (5, mujoco.mjtJacobian.mjJAC_SPARSE)
            assert not data.eq_active.any()
            # what MuJoCo computes then is sound, as rows are stored as the options say
            mujoco.mj_step2(model, mujoco.MjData(model))
        assert grasps[0].is_grasped
        assert grasps[0].merged_time == grasps[0].latched_time > 0
        assert grasps[0].merged_wrench.shape == (6,)
        assert (grasps[0].bounds is not None) == (limits == "box")
        assert data.body("ball").xpos[2] > 0.02


def test_several_grasps_of_one_data():
    text = (
        "<mujoco><option cone='elliptic'/><default><geom condim='4'/></default><worldbody>"
        + "".join(
            f"""<body name="palm{i}" pos="{i} 0 0.3"><geom type="box" size="0.06 0.02 0.01"/>
            <body name="l{i}" pos="-0.0415 0 -0.06"><joint name="l{i}" type="slide" axis="1 0 0" damping="5"/>
            <geom size="0.012" mass="0.05"/></body>
            <body name="r{i}" pos="0.0415 0 -0.06"><joint name="r{i}" type="slide" axis="-1 0 0" damping="5"/>
            <geom size="0.012" mass="0.05"/></body></body>
            <body name="ball{i}" pos="{i} 0 0.24"><freejoint/><geom size="0.03" mass="0.1"/></body>"""
            for i in (0, 1)
        )
        + "</worldbody><actuator>"
        + "".join(f'<position joint="{side}{i}" kp="300"/>' for i in (0, 1) for side in "lr")
        + "</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    grasps = mg.Grasps(model, data)
    first = grasps.add("ball0", palm="palm0")
    second = grasps.add(target="ball1", effectors=["l1", "r1"], latch_time=0.3)
    assert (len(grasps), first.index, second.index, second.palm) == (2, 0, 1, "palm1")
    assert [grasp.target for grasp in grasps] == ["ball0", "ball1"]
    assert grasps[-1].target == "ball1"
    data.ctrl[:] = 0.01
    while data.time < 0.2:
        grasps.step()
    assert (first.is_grasped, second.is_grasped) == (True, False)
    while data.time < 0.6:
        grasps.step(10)
    assert second.is_grasped
    assert second.latched_time < first.latched_time
    first.allow_latch(False)
    first.release()
    while data.time < 0.7:
        grasps.step()
    assert (first.is_grasped, second.is_grasped) == (False, True)


def test_states_are_pickled_copied_and_written():
    _, _, grasps = latched()
    state = grasps.save()
    assert pickle.loads(pickle.dumps(state)) == state == copy.copy(state) == copy.deepcopy(state)
    assert mg.State.from_json(state.to_json()) == state
    assert len(state) == 1
    grasps.step()
    assert grasps.save() != state


def test_monitor_reads_without_latching():
    model, data, grasps = gripper()
    while data.time < 0.5:
        mujoco.mj_step(model, data)
        grasps.monitor()
    assert not grasps[0].is_grasped
    assert grasps[0].would_latch
    assert len(grasps[0].contacts()) == 2


def test_substeps_are_for_loops_that_change_inputs_in_each_step():
    _, data, grasps = latched()
    grasps.step()
    grasps.substep()
    for i in range(200):
        data.xfrc_applied[-1, 2] = 0.05 * np.sin(i / 10)
        grasps.step() if i % 10 == 9 else grasps.substep()
    assert grasps.frozen_steps > 150
    assert grasps[0].is_grasped


def test_the_library_keeps_model_and_data_alive():
    grasps = gripper()[2]
    gc.collect()
    junk = [mujoco.MjData(grasps.model) for _ in range(20)]
    for _ in range(250):
        grasps.step()
    assert grasps[0].is_grasped
    assert grasps.data.time == pytest.approx(0.5)
    del junk


def test_what_the_engine_warns_of_is_a_warning_of_python():
    model, data, grasps = gripper()
    model.body_mass[:] = 0
    model.body_inertia[:] = 0
    model.dof_armature[:] = 0
    model.dof_M0[:] = 0
    with pytest.warns(mg.EngineWarning, match="Inertia"), pytest.raises(mg.DivergedError, match="bad qacc"):
        grasps.step()
    assert data.warning[int(mujoco.mjtWarning.mjWARN_INERTIA)].number > 0
