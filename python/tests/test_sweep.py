"""sweep: the same rows from Python, Ray and submitit as on one machine."""

import importlib
import pathlib
import sys

import pytest
from conftest import ROOT

import mujoco_grasp as mg

SPEC = ROOT / "examples/sweep/ball.toml"


def files(out):
    return {path.name: path.read_bytes() for path in pathlib.Path(out).glob("part-*.parquet")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    return mg.sweep(SPEC, out), files(out)


def test_a_sweep_tells_which_grasps_survive(whole, tmp_path):
    report, parts = whole
    assert (report.grasps, report.tested, report.files) == (96, 96, 6)
    assert len(parts) == 6
    assert report.verdicts["held"] >= 20
    assert report.verdicts["lost"] >= 20
    assert sum(report.verdicts.values()) == 96
    assert report.latched_share.median > 0.95
    first = mg.sweep(SPEC, tmp_path, (0, 2))
    assert (first.grasps, first.tested) == (48, 48)
    assert mg.sweep(SPEC, tmp_path, "0/2").tested == 0
    rest = mg.sweep(SPEC, tmp_path)
    assert (rest.grasps, rest.tested, rest.verdicts) == (96, 48, report.verdicts)
    assert files(tmp_path) == parts


def test_bad_input_is_a_scenario_error(tmp_path):
    for shard in [(2, 2), (-1, 2), "2/2", "0", (0, 2, 3), (0,), 5, (0.0, 2), ("a", "b")]:
        with pytest.raises(mg.ScenarioError, match=r"^shard is .*from 0 to N - 1"):
            mg.sweep(SPEC, tmp_path, shard)
    with pytest.raises(mg.ScenarioError, match="mode"):
        mg.sweep(SPEC, tmp_path, mode="both")
    with pytest.raises(mg.ScenarioError, match=r"none\.toml"):
        mg.sweep(tmp_path / "none.toml", tmp_path)


def test_ray_tasks_write_the_same_files(whole, tmp_path):
    ray = pytest.importorskip("ray")
    import mujoco_grasp.ray

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        reports = mujoco_grasp.ray.sweep(SPEC, tmp_path, shards=3)
        assert [report.tested for report in reports] == [32, 32, 32]
        assert [report.threads for report in reports] == [1, 1, 1]
        with pytest.raises(mg.ScenarioError, match="its mode is grasp, not full"):
            mujoco_grasp.ray.sweep(SPEC, tmp_path, shards=1, mode="full")
    finally:
        ray.shutdown()
    assert files(tmp_path) == whole[1]


def test_slurm_sweep_on_this_machine(whole, tmp_path):
    pytest.importorskip("submitit")
    sys.path.insert(0, str(ROOT / "examples/python"))
    reports = importlib.import_module("slurm_sweep").main(SPEC, tmp_path / "out", 2, cluster="local")
    assert sum(report.tested for report in reports) == 96
    assert files(tmp_path / "out") == whole[1]
