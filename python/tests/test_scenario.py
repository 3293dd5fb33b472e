"""run, bench and agree as dataclasses, from the library's JSON."""

import dataclasses
import threading
import time

import pytest
from conftest import ROOT, in_another_process

import mujoco_grasp as mg
from mujoco_grasp import scenario

CLAW = ROOT / "tests/data/claw.toml"


def test_scenarios_are_listed():
    names = [one.name for one in mg.scenarios()]
    assert {"clutch", "pinch"} <= set(names)
    assert all(one.about for one in mg.scenarios())


def test_run_compares_both_modes(tmp_path):
    report = mg.run(CLAW, push="along", out=tmp_path)
    assert (report.scenario, report.error) == ("claw", None)
    assert report.engine == mg.mujoco_version()
    [pair] = report.runs
    assert pair.push == "along"
    assert isinstance(pair.full, scenario.Run)
    assert isinstance(pair.compare, scenario.Comparison)
    assert pair.compare.same_outcome
    assert pair.grasp.latched_at_s is not None
    assert isinstance(pair.grasp.changes[0], scenario.Change)
    assert pair.full.latched_share is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full-along.csv", "grasp-along.csv"]


def test_run_with_options():
    report = mg.run("clutch", "grasp", "none", duration=6.0, frozen_tolerance=0, noslip=10)
    [pair] = report.runs
    assert (pair.push, pair.full, pair.compare) == ("none", None, None)
    assert pair.grasp.substructured_share == 0
    assert dataclasses.asdict(report)["runs"][0]["grasp"]["outcome"] == "held"


def test_several_grasps_are_reported():
    report = mg.run("two-hands", push="none")
    assert len(report.runs[0].grasp.others) == 1
    assert isinstance(report.runs[0].grasp.others[0], scenario.OtherGrasp)
    assert len(report.runs[0].compare.others) == 1


def test_bench_times_all_variants():
    report = mg.bench(CLAW, steps=500)
    assert report.latched
    for phases in filter(None, (report.still, report.pushed)):
        assert phases.steps >= 500
        assert phases.grasp.step_us > 0
        assert isinstance(phases.full.solver, str)
        assert phases.ratio.step > 0


def test_agree_tells_the_same_story():
    report = mg.agree(CLAW, trials=4, seed=3)
    assert (report.trials, report.seed, len(report.onsets)) == (4, 3, 52)
    assert report.agreement is None or 0 <= report.agreement <= 1
    assert report.held.count + report.slid.count + report.lost.count + report.failed == 4


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: mg.run("clutsh"), "built in are"),
        (lambda: mg.run("clutch", "ful"), '"full", "grasp" or "both"'),
        (lambda: mg.run("clutch", push="fp9"), "fp1"),
        (lambda: mg.run("clutch", duration=-1.0), "^duration is -1"),
        (lambda: mg.run("clutch", frozen_tolerance=float("nan")), "^frozen_tolerance is NaN"),
        (lambda: mg.agree("clutch", trials=0), "from 1 to"),
        (lambda: mg.bench("clutch", steps=0), "^steps is 0; .* from 1 to"),
        (lambda: mg.bench("clutch", substeps=-1), "^substeps is -1"),
        (lambda: mg.run("clutch", noslip=-1), "^noslip is -1"),
        (lambda: mg.run("clutch", noslip=1.5), "^noslip is 1.5"),
        (lambda: mg.agree("clutch", trials=-1), "^trials is -1"),
        (lambda: mg.agree("clutch", seed=-1), "^seed is -1"),
    ],
)
def test_bad_input_is_an_error(call, says):
    with pytest.raises(mg.ScenarioError, match=says):
        call()


def test_the_interpreter_is_not_held_up_meanwhile():
    counted = 0
    thread = threading.Thread(target=lambda: mg.run("clutch", push="none"))
    thread.start()
    while thread.is_alive():
        counted += 1
        time.sleep(0.01)
    assert counted > 3


def test_ctrl_c_ends_a_run():
    code = (
        "import signal, mujoco_grasp as mg\n"
        "signal.setitimer(signal.ITIMER_REAL, 0.5)\n"
        "signal.signal(signal.SIGALRM, signal.default_int_handler)\n"
        "try:\n    mg.agree('clutch', trials=1000000)\n"
        "except KeyboardInterrupt:\n    print('interrupted')"
    )
    assert in_another_process(code) == "interrupted"
