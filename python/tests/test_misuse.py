"""Ways of misuse: an exception each that says what is wrong, and the interpreter lives."""

import collections.abc
import copy
import gc
import pickle
import signal
import threading
import time

import mujoco
import numpy as np
import pytest
from conftest import GRIPPER, gripper, in_another_process, latched, two_targets

import mujoco_grasp as mg


def test_data_of_another_model():
    model, data, _ = gripper()
    other = mujoco.MjModel.from_xml_path(str(GRIPPER))
    for wrong in (other, copy.copy(model), pickle.loads(pickle.dumps(model))):
        with pytest.raises(mg.ModelError, match="data is that of another MjModel"):
            mg.Grasps(wrong, data, target="ball")
    for wrong in [(data, model), (None, data), (model, "data"), (1, 2)]:
        with pytest.raises(mg.ModelError, match="is needed, and this is a"):
            mg.Grasps(*wrong, target="ball")


def test_pickled_and_copied_grasps():
    _, _, grasps = gripper()
    for attempt in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(mg.ModelError, match="save"):
            attempt(grasps)
        with pytest.raises(mg.ModelError, match="save"):
            attempt(grasps[0])
        with pytest.raises(mg.ModelError, match="save"):
            attempt(mg.Batch(grasps.model, 1, "ball"))


def test_names_that_do_not_exist():
    model, data, grasps = gripper()
    for options in [{"target": "bal"}, {"target": "ball", "palm": "plam"}, {"target": "ball", "effectors": ["lefft"]}]:
        with pytest.raises(mg.UnknownNameError, match="did you mean"):
            mg.Grasps(model, data, **options)
    for target in (99, 2**40):
        with pytest.raises(mg.UnknownNameError, match="does not exist"):
            mg.Grasps(model, data, target)
    for target in (-1, 1.5, ["ball"], b"ball"):
        with pytest.raises(mg.SpecError, match="name of a body"):
            mg.Grasps(model, data, target)
    with pytest.raises(IndexError):
        grasps[1]
    with pytest.raises(TypeError, match="latch_qualty"):
        mg.Grasps(model, data, "ball", latch_qualty=1)
    with pytest.raises(TypeError, match="without its target"):
        mg.Grasps(model, data, latch_quality=1)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("latch_quality", np.nan),
        ("latch_quality", -1.0),
        ("latch_quality", "much"),
        ("release_quality", np.inf),
        ("latch_time", np.nan),
        ("release_time", -0.1),
        ("solref", [0.02]),
        ("solref", [0.02, np.nan]),
        ("solimp", [[0.9, 0.95, 0.001, 0.5, 2]]),
        ("solimp", 0.9),
        ("axes", [1, 0, 0]),
        ("axes", [0, 0, 0, 0]),
        ("axes", [np.nan, 0, 0, 1]),
        ("relaxed", ["x", "w"]),
        ("relaxed", 3),
        ("limits", "cone"),
        ("effectors", "left"),
        ("effectors", ["ball"]),
        ("frozen_tolerance", np.nan),
        ("frozen_tolerance", -1e-3),
        ("frozen_tolerance", 0.2),
        ("frozen_tolerance", 1),
        ("frozen_tolerance", "a"),
        ("frozen_tolerance", None),
    ],
)
def test_wrong_shapes_and_values(option, value):
    model, data, _ = gripper()
    with pytest.raises(mg.SpecError):
        mg.Grasps(model, data, "ball", **{option: value})


def test_wrong_numbers_of_steps():
    _, data, grasps = gripper()
    with pytest.raises(mg.SpecError, match="n is -1"):
        grasps.step(-1)
    with pytest.raises(TypeError):
        grasps.step(1.5)
    with pytest.raises(mg.SpecError, match="n is 1208"):
        grasps.step(2**80)
    grasps.step(0)
    assert data.time == 0


def test_nan_is_reported_as_mj_step_treats_it():
    _, data, grasps = latched()
    data.ctrl[0] = np.nan
    with pytest.raises(mg.BadControlError, match='actuator "lift" is NaN'):
        grasps.step()
    data.ctrl[0] = 0
    data.qpos[1] = np.nan
    with pytest.raises(mg.DivergedError, match="bad qpos"):
        grasps.step(10)
    # MuJoCo has reset the data, and the grasp with it
    assert data.time == pytest.approx(0.002)
    assert not grasps[0].is_grasped
    grasps.step(10)


def test_a_grasp_kept_after_a_reset():
    model, data, grasps = latched()
    mujoco.mj_resetData(model, data)
    for _ in range(2):
        with pytest.raises(mg.ResetError, match=r"gone back from 0\.5"):
            grasps.step()
    assert data.time == 0
    grasps.reset()
    assert grasps[0].latched_time == 0
    grasps.step()
    assert data.time == pytest.approx(0.002)


@pytest.mark.parametrize("name", ["control", "contactfilter", "passive", "sensor", "act_dyn", "act_gain", "act_bias"])
def test_a_callback_is_refused(name):
    """Some would be left out, and the others be called with a model that Python does not know, which ended the interpreter."""
    _, data, grasps = latched()
    setter = getattr(mujoco, f"set_mjcb_{name}")
    setter(lambda *_: 0)
    try:
        with pytest.raises(mg.ModelError, match=f"mjcb_{name} is set"):
            grasps.step()
    finally:
        setter(None)
    before = data.time
    grasps.step()
    assert data.time > before


@pytest.mark.parametrize("n", [1, 10])
def test_a_bad_load_is_named_and_does_not_stay(n):
    model, data, grasps = latched()
    grasps.step(10)
    time, load = data.time, data.xfrc_applied[model.body("ball").id]
    for bad, text in ((np.nan, r"xfrc_applied\[\d+\] is NaN"), (1e300, "a load that is too large")):
        load[0] = bad
        with pytest.raises(mg.DivergedError, match=text):
            grasps.step(n)
        assert data.time == time
        load[0] = 0
        grasps.step(n)
        assert grasps[0].is_grasped
        time = data.time


def test_episodes_after_a_reset_are_alike():
    model, data, grasps = gripper()
    start, episodes = data.ctrl.copy(), []
    for _ in range(3):
        mujoco.mj_resetData(model, data)
        grasps.reset()
        data.ctrl[:] = start
        for _ in range(60):
            grasps.step(10)
        assert grasps[0].is_grasped
        episodes.append(np.concatenate([data.qpos, data.qvel]))
    assert np.array_equal(episodes[0], episodes[1])
    assert np.array_equal(episodes[1], episodes[2])


def test_a_model_that_is_not_served():
    flex = "<mujoco><worldbody><flexcomp name='f' type='grid' count='3 3 1' spacing='.1 .1 .1' dim='2'/></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(flex)
    with pytest.raises(mg.ModelError, match="flex"):
        mg.Grasps(model, mujoco.MjData(model))
    model, data, _ = gripper()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(mg.ModelError, match=r"RK4.* mjINT_IMPLICITFAST or mjINT_EULER"):
        mg.Grasps(model, data, "ball")


def test_limits_without_a_weld_are_told_what_python_has_for_it():
    model, data, _ = gripper()
    for limits in ("box", "rigid"):
        with pytest.raises(mg.SpecError, match=r'target body "ball".*put mujoco_grasp\.weld_xml\(target\) at the end'):
            mg.Grasps(model, data, "ball", limits=limits)
    weld = mg.weld_xml("ball").replace('active="false"', "")
    model = mujoco.MjModel.from_xml_string(GRIPPER.read_text().replace("</mujoco>", f"{weld}</mujoco>"))
    with pytest.raises(mg.SpecError, match=r"see mujoco_grasp\.weld_xml"):
        mg.Grasps(model, mujoco.MjData(model), "ball", limits="box")


def test_a_hand_holds_a_target_once():
    _, _, grasps = gripper()
    with pytest.raises(mg.SpecError, match="a link may belong to one grasp of a target"):
        grasps.add("ball")
    assert len(grasps) == 1


def test_handles_of_one_grasp_are_equal():
    model = two_targets()
    data = mujoco.MjData(model)
    grasps, other = mg.Grasps(model, data, "ball"), mg.Grasps(model, data, "ball")
    grasps.add("other")
    assert grasps[0] == grasps[0] != grasps[1]
    assert grasps[0] != other[0]
    assert grasps[0] != "ball"
    assert len({grasps[0], grasps[-2], grasps[1]}) == 2
    assert grasps[1] in grasps
    assert other[0] not in grasps
    assert isinstance(grasps, collections.abc.Iterable)
    assert list(grasps) == [grasps[0], grasps[1]]


@pytest.mark.parametrize("limits", ["cones", "box"])
def test_ctrl_c_ends_a_call_of_many_steps_after_a_whole_one(limits):
    text = GRIPPER.read_text().replace("</mujoco>", mg.weld_xml("ball") + "</mujoco>")
    model = mujoco.MjModel.from_xml_string(text)

    def held(n):
        data = mujoco.MjData(model)
        grasps = mg.Grasps(model, data, "ball", limits=limits)
        data.ctrl[:] = [0.0, 0.01, 0.01]
        for _ in range(250):
            grasps.step()
        assert grasps[0].is_grasped
        grasps.step(n)
        return data, grasps

    raised = []

    def handler(*_):
        raised.append(grasps[0].quality)  # a handler may read
        raise KeyboardInterrupt

    data, grasps = held(1)
    before, start = signal.signal(signal.SIGALRM, handler), time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            grasps.step(10**9)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - start < 5
    assert len(raised) == 1
    # as after a call of so many steps in one part, which other threads make
    n = round((data.time - 0.502) / model.opt.timestep)
    assert n > 100
    whole = []
    thread = threading.Thread(target=lambda: whole.extend(held(1)))
    thread.start()
    thread.join()
    thread = threading.Thread(target=whole[1].step, args=(n,))
    thread.start()
    thread.join()
    assert whole[0].time == data.time
    assert np.array_equal(whole[0].qpos, data.qpos)
    assert np.array_equal(whole[0].qvel, data.qvel)
    assert np.array_equal(whole[0].cfrc_ext, data.cfrc_ext)
    assert whole[1].whole_steps == grasps.whole_steps
    grasps.step(10)


def test_a_child_of_a_fork_goes_on():
    out = in_another_process(
        "import os, signal, mujoco, mujoco_grasp as mg\n"
        f"model = mujoco.MjModel.from_xml_path({str(GRIPPER)!r})\n"
        "batch = mg.Batch(model, 4, 'ball', threads=2)\n"
        "batch.step(5)\n"
        "mg.run('clutch', 'grasp', 'none')\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    signal.alarm(60)\n"
        "    batch.step(5)\n"
        "    report = mg.run('clutch', 'grasp', 'none')\n"
        "    del batch\n"
        "    print('child', report.runs[0].grasp.outcome, flush=True)\n"
        "    os._exit(0)\n"
        "assert os.waitpid(child, 0)[1] == 0\n"
        "batch.step(5)\n"
        "print(round(batch.time[0], 6))"
    )
    assert out.splitlines() == ["child held", "0.02"]


def test_states_of_others():
    model, data, grasps = latched()
    state = grasps.save()
    with pytest.raises(mg.StateError, match="latch_quality"):
        mg.Grasps(model, data, "ball", latch_quality=0.2).restore(state)
    with pytest.raises(mg.StateError, match="number of grasps"):
        mg.Grasps(model, data).restore(state)
    text = state.to_json()
    for damaged in ("", "{}", text[:-2], text.replace('"clocks":[{', '"clocks":[{},{')):
        with pytest.raises(mg.StateError):
            mg.State.from_json(damaged)
    with pytest.raises(TypeError):
        grasps.restore(text)
    assert grasps.save() == state


def test_an_error_that_is_raised_inside_mujoco():
    model, data, grasps = gripper()
    grasps.step(20)
    model.opt.solver = 99
    for _ in range(2):
        with pytest.raises(mg.EngineError, match=r"MuJoCo fault in mj_forward: .*99"):
            grasps.step()
        # the thread's own handling is back: MuJoCo's own calls raise their own error
        with pytest.raises(mujoco.FatalError, match="99"):
            mujoco.mj_step(model, data)
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    grasps.step(100)
    assert grasps[0].is_grasped


def test_memory_that_is_full():
    text = GRIPPER.read_text()
    spheres = "".join(f'<body pos="0 0 {5 + i / 100}"><freejoint/><geom size="1"/></body>' for i in range(12))
    text = text.replace("</worldbody>", spheres + "</worldbody>")
    model = mujoco.MjModel.from_xml_string(text.replace("<worldbody>", '<size memory="20K"/><worldbody>', 1))
    data = mujoco.MjData(model)
    # versions differ in what is full first
    with pytest.raises((mg.EngineError, mg.BufferFullError), match="raise memory in the model"):
        mg.Grasps(model, data, "ball").step()


def test_two_threads_that_step_one_data():
    _, data, grasps = latched()
    other = mg.Grasps(grasps.model, data, "ball")
    caught = []
    begun = threading.Event()

    def work():
        begun.set()
        grasps.step(50_000)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    while thread.is_alive():
        for stepped in (grasps, other):
            try:
                stepped.step()
            except mg.BusyError as error:
                caught.append(str(error))
        # reading waits
        assert grasps[0].quality >= 0
    thread.join()
    assert caught
    assert "one at a time" in caught[0]


def test_threads_with_data_of_their_own_share_a_model():
    model = gripper()[0]
    ends = {}

    def work(number):
        data = mujoco.MjData(model)
        grasps = mg.Grasps(model, data, "ball")
        data.ctrl[:] = [0.0, 0.01, 0.01]
        for _ in range(100):
            grasps.step(10)
        ends[number] = data.qpos.copy()

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert len(ends) == 4
    assert all(np.array_equal(end, ends[0]) for end in ends.values())


def test_a_version_that_is_not_served():
    out = in_another_process(
        "import mujoco, sys\n"
        "sys.path[:0] = sys.argv[1:]\n"
        "mujoco.mj_version = lambda: 3001006\n"
        "try:\n    import mujoco_grasp\nexcept ImportError as error:\n    print(type(error).__name__, error)"
    )
    assert out.startswith("VersionError MuJoCo 3.1.6 is installed")
    assert all(f"=={version}" in out for version in mg.served_versions())


def test_a_core_of_another_version_does_not_load():
    others = [version for version in mg.served_versions() if version != mujoco.__version__]
    if not others:
        pytest.skip("one core only is installed")
    out = in_another_process(
        "import mujoco\n"
        f"mujoco.mj_version = lambda: {number(others[0])}\n"
        "try:\n    import mujoco_grasp\nexcept ImportError as error:\n    print(error)"
    )
    assert "libmujoco.so" in out


def number(version):
    major, minor, patch = map(int, version.split("."))
    return 1_000_000 * major + 1000 * minor + patch


def test_a_model_freed_under_its_grasps():
    out = in_another_process(
        "import gc, mujoco, mujoco_grasp as mg\n"
        f"model = mujoco.MjModel.from_xml_path({str(GRIPPER)!r})\n"
        "data = mujoco.MjData(model)\n"
        "grasps = mg.Grasps(model, data, 'ball')\n"
        "del model, data\n"
        "gc.collect()\n"
        "grasps.step(100)\n"
        "grasp = grasps[0]\n"
        "del grasps\n"
        "gc.collect()\n"
        "print(grasp.phase, round(grasp.grasps.data.time, 6))"
    )
    assert out == "ungrasped 0.2"
    gc.collect()
