"""Many simulations at once are those of each alone, bit for bit, at any number of threads."""

import signal
import threading
import time

import mujoco
import numpy as np
import pytest
from conftest import GRIPPER, two_targets

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
    assert caught.value.__notes__ == ["in simulation 1 of the batch; the others have gone on to the end"]
    assert caught.value.failed == (1,)
    assert batch.time == pytest.approx([0.01, 0.002, 0.01])
    for wrong in ({"ctrl": np.zeros((3, 2))}, {"ctrl": np.zeros((2, 3))}, {"xfrc_applied": np.zeros((3, 6, 1))}):
        with pytest.raises(mg.SpecError, match="are needed"):
            batch.step(**wrong)
    with pytest.raises(mg.UnknownNameError, match="keyframe"):
        batch.reset("open")


def test_all_that_have_failed_are_named():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    batch = mg.Batch(model, 4, "ball")
    batch.data[1].qpos[0] = np.nan
    ctrl = np.zeros((4, 3))
    ctrl[3, 1] = np.nan
    with pytest.raises(mg.DivergedError) as caught:
        batch.step(100, ctrl=ctrl)
    assert caught.value.failed == (1, 3)
    first, second = caught.value.__notes__
    assert first == "in simulation 1 of the batch; 2 have failed, see `failed`; the others have gone on to the end"
    assert second.startswith("simulation 3: BadControlError: ")
    assert batch.time == pytest.approx([0.2, 0.002, 0.2, 0.002])
    # what is raised before any of them goes on has no such note
    with pytest.raises(mg.UnknownNameError, match="keyframe") as caught:
        batch.reset("open")
    assert not hasattr(caught.value, "__notes__")
    assert caught.value.failed == ()


def test_arrays_of_wrong_shapes_and_types_are_named():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    batch = mg.Batch(model, 3, "ball")
    shapes = (0.0, np.zeros(3), np.zeros((3, 3, 1)), [[0.0] * 3] * 2, [[0.0], [0.0, 1.0]])
    for wrong in (*shapes, "x", [["a"] * 3] * 3, np.zeros((3, 3), complex)):
        with pytest.raises(mg.SpecError, match=r"^ctrl .*shape \[3, 3\] are needed"):
            batch.step(ctrl=wrong)
    with pytest.raises(mg.SpecError, match=rf"^xfrc_applied .*shape \[3, {model.nbody}, 6\] are needed"):
        batch.step(xfrc_applied=np.zeros((3, 6)))
    with pytest.raises(mg.SpecError, match=r"^qvel has the shape \[2\]"):
        batch.qvel = np.zeros(2)
    assert not batch.time.any()
    rows = np.arange(9.0).reshape(3, 3) / 1000
    orders = (np.asfortranarray(rows), np.repeat(rows, 2, 0)[::2])
    for right in (*orders, rows.tolist(), rows.astype(np.float32), rows.astype(object)):
        batch.step(ctrl=right)
        assert np.allclose([data.ctrl for data in batch.data], rows)
    batch.step(ctrl=np.zeros((3, 3), int))


def test_wrong_numbers_are_named():
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    for name, values in {"nsim": (0, -1, 2**70), "threads": (0, -1, 10_000)}.items():
        for value in values:
            with pytest.raises(mg.SpecError, match=f"^{name} is {value}; it must be a whole number from 1 to"):
                mg.Batch(model, **{"nsim": 1, name: value})
    batch = mg.Batch(model, 2, "ball", threads=1000)
    assert "on 2 threads" in repr(batch)
    with pytest.raises(mg.SpecError, match=r"^n is -1"):
        batch.step(-1)


def test_grasps_of_one_simulation_only():
    batch = mg.Batch(two_targets(), 3, "ball")
    batch.grasps[1].add("other")
    for name in ("quality", "is_grasped"):
        with pytest.raises(mg.SpecError, match="simulation 1 of the batch has 2 grasps, and simulation 0 has 1"):
            getattr(batch, name)


@pytest.mark.parametrize("limits", ["cones", "box", "rigid"])
def test_a_call_of_many_steps_is_one_whatever_it_is_parted_in(limits):
    text = GRIPPER.read_text().replace("</mujoco>", mg.weld_xml("ball") + "</mujoco>")
    model = mujoco.MjModel.from_xml_string(text)
    ends = []

    def work():
        batch = mg.Batch(model, 3, "ball", limits=limits)
        batch.step(300, ctrl=[[0.0, 0.01, 0.01]] * 3)
        assert batch.is_grasped.all()
        batch.step(20_000, ctrl=[[0.001 * i, 0.01, 0.01] for i in range(3)])
        ends.append(np.hstack([batch.qpos, batch.qvel, batch.quality, batch.time[:, None]]))

    work()
    # signals are seen to on the main thread alone
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert np.array_equal(*ends)


def test_ctrl_c_ends_a_batch_after_as_many_steps_of_each():
    batch = mg.Batch(mujoco.MjModel.from_xml_path(str(GRIPPER)), 3, "ball")
    before, start = signal.signal(signal.SIGALRM, signal.default_int_handler), time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            batch.step(10**9, ctrl=[[0.0, 0.01, 0.01]] * 3)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - start < 5
    assert batch.time[0] > 0.1
    assert len(set(batch.time)) == 1
    batch.step()
