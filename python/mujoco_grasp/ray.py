"""Sweeps on a Ray cluster: `pip install "mujoco-grasp[ray]"`."""

import os
import typing

import ray

from .scenario import whole
from .sweeps import SweepReport
from .sweeps import sweep as _sweep


def sweep(
    spec: str | os.PathLike[str],
    out: str | os.PathLike[str],
    shards: int,
    *,
    mode: typing.Literal["grasp", "full"] = "grasp",
    num_cpus: int = 1,
    **options: typing.Any,
) -> list[SweepReport]:
    """Runs `mujoco_grasp.sweep` with one Ray task for each shard, and gives their reports in order.

    Files that are there are not made again: a task that Ray starts anew, or the same call, goes on where it was.

    Args:
        spec: The path of a sweep's spec, at the same place on every machine, as are its scenario and model.
        out: The folder of results, on storage that all machines share.
        shards: How many; more than there are cores, so that none of them waits long for the last.
        mode: As in `mujoco_grasp.sweep`.
        num_cpus: Cores and threads of one task.
        options: Further options of the tasks, as for `ray.remote`.

    Raises:
        ScenarioError: Fewer than one shard.
        ray.exceptions.RayTaskError: What a task raised, as `ScenarioError`.
    """
    shards = whole("shards", shards, 1, 2**63 - 1)
    environment = {"env_vars": {"RAYON_NUM_THREADS": str(num_cpus)}}
    task: typing.Any = ray.remote(_sweep).options(num_cpus=num_cpus, runtime_env=environment, **options)
    # a task runs in a folder of its own
    paths = os.path.abspath(spec), os.path.abspath(out)
    reports: list[SweepReport] = ray.get([task.remote(*paths, (shard, shards), mode=mode) for shard in range(shards)])
    return reports
