"""What a call from Python costs beside the Rust step, with a latched hand: python/tests/measure.py REFERENCE.

REFERENCE is the program `reference` of the crate, which prints the time of its own steps. Both run in turns, and the least of
the turns' medians counts; on a machine that has other work, two processes cannot be compared to a microsecond. So what a call
costs without a step is timed by itself, too: `monitor()` with nothing that touches, alone and after an `mj_step`, which leaves
the caches to others. MuJoCo's package for Python has the engine time its own stages, in its `mj_step` as in ours (a microsecond
a step); Rust has not, so it is switched off here.
"""

import pathlib
import sys
import tempfile
import time

import mujoco
import numpy as np
from conftest import Clutch

STEPS, TURNS = 5000, 5


def python(inputs, n):
    """Time of a call while latched, us: the medians of the second half."""
    clutch = Clutch()
    times = []
    before = None
    for row in inputs:
        if not np.array_equal(row, before):
            clutch.apply(row)
        before = row
        began = time.perf_counter_ns()
        clutch.grasps.step(n)
        times.append(time.perf_counter_ns() - began)
    return np.median(times[len(times) // 2 :]) / 1e3


def rust(program, inputs, n):
    """The same of the reference."""
    with tempfile.TemporaryDirectory() as folder:
        return Clutch().reference(program, inputs, n, pathlib.Path(folder))[1]


def without_a_step(first):
    """Time of a call that only looks, us, the clock's own taken off; `first` runs before each."""
    clutch = Clutch()
    clutch.data.qpos[clutch.q : clutch.q + 3] += 1.0
    mujoco.mj_forward(clutch.model, clutch.data)

    def median(call):
        times = []
        for _ in range(4000):
            first(clutch.model, clutch.data)
            began = time.perf_counter_ns()
            call()
            times.append(time.perf_counter_ns() - began)
        return np.median(times) / 1e3

    return median(clutch.grasps.monitor) - median(lambda: None)


def main():
    program = sys.argv[1]
    mujoco.set_mjcb_time(None)
    alone, cold = without_a_step(lambda m, d: None), without_a_step(mujoco.mj_step)
    print(f"MuJoCo {mujoco.__version__}: a call without a step {alone:.2f} us, after an mj_step {cold:.2f} us")
    for n in (1, 10):
        inputs = Clutch().inputs(STEPS, n)
        # Calls alone, without what a policy does to the caches in between.
        held = 1500 // n
        inputs[held:] = inputs[held]
        turns = [(rust(program, inputs, n), python(inputs, n)) for _ in range(TURNS)]
        of_rust, of_python = np.min(turns, axis=0)
        print(f"MuJoCo {mujoco.__version__}: step({n}): Rust {of_rust:.2f} us, Python {of_python:.2f} us a call, ", end="")
        print(f"{of_python - of_rust:+.2f} us, {100 * (of_python / of_rust - 1):+.1f} %")


if __name__ == "__main__":
    main()
