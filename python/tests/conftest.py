"""What the tests share: scenes, and inputs that are the same in every language."""

import importlib.util
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


def two_targets():
    """The model of the gripper, with another ball that lies elsewhere."""
    other = '<body name="other" pos="1 0 1"><freejoint/><geom size=".02"/></body></worldbody>'
    return mujoco.MjModel.from_xml_string(GRIPPER.read_text().replace("</worldbody>", other))


def latched(**options):
    """As `gripper`, once it has latched."""
    model, data, grasps = gripper(**options)
    while data.time < 0.5:
        grasps.step()
    assert grasps[0].is_grasped
    return model, data, grasps


class Scene:
    """A scene with inputs that the Rust library can be given, too: see `python/examples/reference.rs`."""

    def __init__(self, path, target, palm, keyframe=""):
        self.path, self.target, self.palm, self.keyframe = path, target, palm, keyframe
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.body = self.model.body(target).id
        joint = self.model.body_jntadr[self.body]
        self.q, self.v = self.model.jnt_qposadr[joint], self.model.jnt_dofadr[joint]
        if keyframe:
            mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(keyframe).id)
        self.start = self.data.qpos[self.q : self.q + 7].copy()
        self.grasps = mg.Grasps(self.model, self.data, target=target, palm=palm)

    def apply(self, row):
        """Writes the inputs of one call: controls, a wrench on the target, and whether it is held where it was."""
        if row[-1] == 1.0:
            self.data.qpos[self.q : self.q + 7] = self.start
            self.data.qvel[self.v : self.v + 6] = 0.0
        self.data.ctrl[:] = row[: self.model.nu]
        self.data.xfrc_applied[self.body] = row[self.model.nu : -1]

    def outputs(self):
        """What the reference writes after a call."""
        grasp = self.grasps[0]
        return np.concatenate([self.data.qpos, self.data.qvel, [grasp.quality, grasp.is_grasped, self.data.time]])

    def reference(self, program, inputs, n, folder):
        """The same by the Rust library, in a process of its own; and the median time of a call, us."""
        (folder / "inputs").write_bytes(inputs.tobytes())
        library = pathlib.Path(mujoco.__file__).parent
        names = [self.keyframe, self.target, self.palm]
        out = subprocess.run(
            [program, self.path, *names, str(n), folder / "inputs", folder / "outputs"],
            env={**os.environ, "LD_LIBRARY_PATH": str(library)},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        return np.fromfile(folder / "outputs").reshape(len(inputs), -1), float(out)


class Clutch(Scene):
    """The clutch scene: its fingers close on a ball that is held until they have, and which is then pushed."""

    def __init__(self):
        super().__init__(CLUTCH, "ball", "palm", "grasp")

    def inputs(self, steps, n):
        """Those of each call of `n` of all steps."""
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


class ShadowBlock(Scene):
    """The Shadow Hand of gymnasium-robotics closes on a block that lies on its palm, and moves its wrist."""

    THUMB = {"THJ4": 0.25, "THJ3": 0.93}
    CLOSED = {
        **THUMB, "FFJ2": 1.03, "FFJ1": 1.24, "MFJ2": 1.46, "MFJ1": 0.95, "RFJ2": 1.03, "RFJ1": 1.06, "LFJ2": 1.09,
        "LFJ1": 1.51, "LFJ4": 0.43, "THJ2": 0.05, "THJ1": 0.34, "THJ0": -0.53,
    }  # fmt: skip

    def __init__(self):
        package = importlib.util.find_spec("gymnasium_robotics")
        if package is None:
            pytest.skip("gymnasium-robotics is not installed: scripts/python-extras does it")
        assets = pathlib.Path(package.origin).parent / "envs/assets"
        super().__init__(assets / "hand/manipulate_block.xml", "object", "robot0:palm")

    def inputs(self, steps, n):
        """Those of each call of `n` of all steps."""
        model = self.model
        index = {model.actuator(i).name.removeprefix("robot0:A_"): i for i in range(model.nu)}
        thumb, closed = np.zeros(model.nu), np.zeros(model.nu)
        for pose, angles in ((thumb, self.THUMB), (closed, self.CLOSED)):
            pose[[index[joint] for joint in angles]] = list(angles.values())
        inputs = np.zeros((steps // n, model.nu + 7))
        for call, row in enumerate(inputs):
            time = call * n * model.opt.timestep
            pose = row[: model.nu]
            pose[:] = thumb * min(1.0, time / 0.4) + (closed - thumb) * np.clip((time - 0.4) / 1.2, 0.0, 1.0)
            turn = 2.0 * max(0.0, time - 2.5)
            pose[[index["WRJ1"], index["WRJ0"]]] = [-0.2 * np.sin(turn), -0.3 * np.sin(0.7 * turn)]
        return inputs


def reference(scene, inputs, n, folder):
    """Outputs of the Rust library for the same inputs."""
    program = os.environ.get("MUJOCO_GRASP_REFERENCE")
    if not program:
        pytest.skip("MUJOCO_GRASP_REFERENCE names no program: scripts/python test builds it")
    return scene.reference(program, inputs, n, folder)[0]


def in_another_process(code, **environment):
    """What Python code prints in a process of its own: whatever it does to it, this one lives."""
    environment = {**os.environ, **environment}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
    assert done.returncode == 0, f"status {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout.strip()
