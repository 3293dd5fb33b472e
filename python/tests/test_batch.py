"""Many simulations at once are those of each alone, bit for bit, at any number of threads."""

import mujoco
import numpy as np
import pytest
from conftest import GRIPPER

import mujoco_grasp as mg

NSIM = 6


def inputs(model):
    """Controls and pushes of each simulation, call by call."""
    rng = np.random.default_rng(1)
    ball = model.body("ball").id
    for call in range(60):
        ctrl = np.tile([0.0005 * max(0, call - 30), 0.01, 0.01], (NSIM, 1)) + 0.0005 * rng.standard_normal((NSIM, 3))
        xfrc = np.zeros((NSIM, model.nbody, 6))
        xfrc[:, ball, :3] = 0.05 * rng.standard_normal((NSIM, 3))
        yield ctrl, xfrc


def test_results_are_those_of_each_alone_at_any_number_of_threads():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    results = []
    for threads in (1, 2, 5):
        batch = mg.Batch(model, NSIM, "ball", threads=threads)
        for ctrl, xfrc in inputs(model):
            batch.step(10, ctrl=ctrl, xfrc_applied=xfrc)
        assert batch.is_grasped.all()
        assert batch.time == pytest.approx(1.2)
        results.append(np.hstack([batch.qpos, batch.qvel, batch.quality]))
    alone = []
    for i in range(NSIM):
        data = mujoco.MjData(model)
        grasps = mg.Grasps(model, data, "ball")
        for ctrl, xfrc in inputs(model):
            data.ctrl[:], data.xfrc_applied[:] = ctrl[i], xfrc[i]
            grasps.step(10)
        alone.append(np.concatenate([data.qpos, data.qvel, [grasps[0].quality]]))
    assert len(np.unique(np.array(alone)[:, 0])) == NSIM, "each has another fate"
    for result in results:
        assert np.array_equal(result, alone)


def test_data_and_grasps_are_at_hand():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    batch = mg.Batch(model, 3, "ball", "palm", latch_time=0.02)
    assert (len(batch), len(batch.data), len(batch.grasps)) == (3, 3, 3)
    assert batch.grasps[1].data is batch.data[1]
    batch.qpos = batch.qpos + np.array([[0.0], [0.001], [0.002]])
    batch.data[2].qvel[0] = 0.1
    assert batch.qpos[2, 0] == 0.002
    assert batch.qvel[2, 0] == 0.1
    batch.qvel = np.zeros((3, model.nv))
    assert not batch.qvel.any()
    batch.step(100, ctrl=[[0, 0.01, 0.01]] * 3)
    assert batch.sensordata.shape == (3, model.nsensordata)
    assert batch.is_grasped.shape == batch.quality.shape == (3, 1)
    assert batch.grasps[0][0].contacts()
    batch.reset()
    assert not batch.is_grasped.any()
    assert not batch.time.any()
    batch.step()


def test_an_error_of_one_lets_the_others_go_on():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    batch = mg.Batch(model, 3, "ball")
    batch.data[1].qpos[0] = np.nan
    with pytest.raises(mg.DivergedError, match="bad qpos") as caught:
        batch.step(5)
    assert "in simulation 1" in caught.value.__notes__[0]
    assert batch.time == pytest.approx([0.01, 0.002, 0.01])
    for wrong in ({"ctrl": np.zeros((3, 2))}, {"ctrl": np.zeros((2, 3))}, {"xfrc_applied": np.zeros((3, 6, 1))}):
        with pytest.raises(mg.SpecError, match="is needed"):
            batch.step(**wrong)
    with pytest.raises(mg.UnknownNameError, match="keyframe"):
        batch.reset("open")
    for wrong in ({"nsim": 0}, {"nsim": 1, "threads": 0}):
        with pytest.raises(mg.SpecError, match="at least 1"):
            mg.Batch(model, target="ball", **wrong)
