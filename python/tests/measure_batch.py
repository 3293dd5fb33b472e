"""Many simulations at once against `mujoco.rollout`, which steps them all by plain `mj_step`: python/tests/measure_batch.py [NSIM].

Each simulation holds the clutch's ball under a small push of its own, which changes in every call of ten steps. Both have the
same threads and take turns; steps of all simulations per second are compared, and where the balls end.
"""

import os
import sys
import time

import mujoco
import numpy as np
from conftest import Clutch
from mujoco import rollout

import mujoco_grasp as mg

CALLS, STEPS = 20, 10


def held():
    """The clutch, latched and at rest, and the controls that hold the ball."""
    clutch = Clutch()
    for row in clutch.inputs(2000, 1):
        clutch.apply(row)
        clutch.grasps.step()
    assert clutch.grasps[0].is_grasped
    return clutch


def main():
    nsim, threads = int(sys.argv[1]) if len(sys.argv) > 1 else 1000, os.cpu_count()
    clutch = held()
    model, data = clutch.model, clutch.data
    batch = mg.Batch(model, nsim, "ball", "palm", threads=threads, latch_time=0.0)
    batch.qpos, batch.qvel = np.tile(data.qpos, (nsim, 1)), np.tile(data.qvel, (nsim, 1))
    for one in batch.data:
        one.qacc_warmstart[:] = data.qacc_warmstart
    ctrl = np.tile(data.ctrl, (nsim, 1))
    # latching takes a moment; where both begin is then the same
    batch.step(20, ctrl=ctrl)
    state = mujoco.mjtState.mjSTATE_FULLPHYSICS
    size = mujoco.mj_stateSize(model, state)
    start = np.empty((nsim, size))
    for i, one in enumerate(batch.data):
        mujoco.mj_getState(model, one, start[i], state)
    warm = np.array([one.qacc_warmstart for one in batch.data])
    scratch = [mujoco.MjData(model) for _ in range(threads)]
    rng = np.random.default_rng(1)
    times = {"grasp": 0.0, "full": 0.0}
    latched = 0.0
    with rollout.Rollout(nthread=threads) as pool:
        for _ in range(CALLS):
            push = np.zeros((nsim, model.nbody, 6))
            push[:, clutch.body, :3] = 0.3 * rng.standard_normal((nsim, 3))
            began = time.perf_counter()
            batch.step(STEPS, ctrl=ctrl, xfrc_applied=push)
            times["grasp"] += time.perf_counter() - began
            latched += batch.is_grasped.mean() / CALLS
            control = np.hstack([ctrl, push.reshape(nsim, -1)])[:, None].repeat(STEPS, axis=1)
            spec = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED
            began = time.perf_counter()
            states, _ = pool.rollout(
                model, scratch, start, control, control_spec=spec, nstep=STEPS, initial_warmstart=warm
            )
            times["full"] += time.perf_counter() - began
            start = states[:, -1]
            warm = None
    steps = nsim * CALLS * STEPS
    ball = slice(1 + clutch.q, 4 + clutch.q)
    apart = np.linalg.norm(batch.qpos[:, clutch.q : clutch.q + 3] - start[:, ball], axis=1)
    print(f"MuJoCo {mujoco.__version__}, {nsim} simulations, {threads} threads")
    for name, seconds in times.items():
        print(f"  {name}: {steps / seconds:.0f} steps a second")
    print(f"  full / grasp {times['full'] / times['grasp']:.2f}, latched share {latched:.3f}")
    print(f"  balls apart at the end: median {1e6 * np.median(apart):.1f} um, largest {1e6 * apart.max():.1f} um")


if __name__ == "__main__":
    main()
