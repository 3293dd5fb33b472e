"""A sweep as an array job of Slurm, by submitit; without Slurm, as processes of this machine.

python examples/python/slurm_sweep.py examples/sweep/ball.toml out/ball 4
"""

import pathlib
import sys

import submitit

import mujoco_grasp as mg


def main(spec, out, shards, cluster=None):
    """`cluster` is "slurm" or "local"; None: Slurm where it is installed."""
    spec, out = pathlib.Path(spec).resolve(), pathlib.Path(out).resolve()
    executor = submitit.AutoExecutor(folder=out.with_name(out.name + "-jobs"), cluster=cluster)
    # What a job that ran out of time has finished stays: submit again, and it goes on.
    executor.update_parameters(timeout_min=60, cpus_per_task=1, slurm_array_parallelism=100)
    jobs = executor.map_array(lambda shard: mg.sweep(spec, out, (shard, shards)), range(shards))
    reports = [job.result() for job in jobs]
    for verdict in reports[0].verdicts:
        print(f"{verdict:7} {sum(report.verdicts[verdict] for report in reports)}")
    return reports


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
