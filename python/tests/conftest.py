"""What the tests share: scenes, and inputs that are the same in every language."""

import os
import pathlib
import subprocess
import sys

import mujoco
import numpy as np
import pytest

import mujoco_grasp as mg

ROOT = pathlib.Path(__file__).parents[2]
CLUTCH = ROOT / "models/clutch.xml"
GRIPPER = ROOT / "examples/gripper.xml"
FINGERS = ("thumb", "index", "middle", "ring", "little")


def gripper(**options):
    """A gripper that presses on a ball, with its grasps."""
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    data = mujoco.MjData(model)
    data.ctrl[:] = [0.0, 0.01, 0.01]
    return model, data, mg.Grasps(model, data, target="ball", **options)


def latched(**options):
    """As `gripper`, once it has latched."""
    model, data, grasps = gripper(**options)
    while data.time < 0.5:
        grasps.step()
    assert grasps[0].is_grasped
    return model, data, grasps


class Clutch:
    """The clutch scene: its fingers close on a ball that is held until they have, and which is then pushed."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_path(str(CLUTCH))
        self.data = mujoco.MjData(self.model)
        self.ball = self.model.body("ball").id
        joint = self.model.body_jntadr[self.ball]
        self.q, self.v = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("grasp").id)
        self.start = self.data.qpos[self.q : self.q + 7].copy()
        self.grasps = mg.Grasps(self.model, self.data, target="ball", palm="palm")

    def inputs(self, steps, n):
        """Controls, a wrench on the ball, and whether it is held, for each call of `n` of all steps."""
        model = self.model
        bends = [
            model.actuator(i).name.startswith(tuple(f"{f}_" for f in FINGERS)) and not model.actuator(i).name.endswith("_abd")
            for i in range(model.nu)
        ]
        inputs = np.zeros((steps // n, model.nu + 7))
        for call, row in enumerate(inputs):
            time = call * n
            row[: model.nu] = self.data.ctrl + 0.25 * min(1.0, time / 500) * np.array(bends)
            row[: model.nu] += 0.003 * np.sin(time / 40 + np.arange(model.nu)) * np.array(bends)
            row[-1] = time < 700
            if 2000 <= time < 2500:
                row[model.nu : model.nu + 3] = [0.0, -2.0, 1.0]
        return inputs

    def apply(self, row):
        """Writes the inputs of one call."""
        if row[-1] == 1.0:
            self.data.qpos[self.q : self.q + 7] = self.start
            self.data.qvel[self.v : self.v + 6] = 0.0
        self.data.ctrl[:] = row[: self.model.nu]
        self.data.xfrc_applied[self.ball] = row[self.model.nu : -1]

    def outputs(self):
        """What the reference writes after a call."""
        grasp = self.grasps[0]
        return np.concatenate([self.data.qpos, self.data.qvel, [grasp.quality, grasp.is_grasped, self.data.time]])


def reference(inputs, n, folder):
    """The same by the Rust library, in a process of its own."""
    program = os.environ.get("MUJOCO_GRASP_REFERENCE")
    if not program:
        pytest.skip("MUJOCO_GRASP_REFERENCE names no program: scripts/python test builds it")
    (folder / "inputs").write_bytes(inputs.tobytes())
    library = pathlib.Path(mujoco.__file__).parent
    subprocess.run(
        [program, CLUTCH, "grasp", "ball", "palm", str(n), folder / "inputs", folder / "outputs"],
        env={**os.environ, "LD_LIBRARY_PATH": str(library)},
        check=True,
    )
    return np.fromfile(folder / "outputs").reshape(len(inputs), -1)


def in_another_process(code, **environment):
    """What Python code prints in a process of its own: whatever it does to it, this one lives."""
    environment = {**os.environ, **environment}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
    assert done.returncode == 0, f"status {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout.strip()
