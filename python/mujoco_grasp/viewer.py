"""Grasps drawn into a scene: for the passive viewer's `user_scn`, a `mujoco.Renderer`'s `scene`, or any `MjvScene`."""

import mujoco
import numpy as np
import numpy.typing as npt

from . import Grasps

Colour = npt.NDArray[np.float32]

STICKS = np.array([0.2, 0.8, 0.3, 1.0], np.float32)
SLIDES = np.array([0.95, 0.45, 0.1, 1.0], np.float32)
UNGRASPED = np.array([0.6, 0.6, 0.65, 1.0], np.float32)
_ARROW = int(mujoco.mjtGeom.mjGEOM_ARROW)
_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_LABEL = int(mujoco.mjtGeom.mjGEOM_LABEL)


def draw(
    grasps: Grasps,
    scene: mujoco.MjvScene,
    *,
    metres_per_newton: float | None = None,
    size: float = 0.004,
    labels: bool = True,
    clear: bool = False,
) -> int:
    """Adds contacts, their forces and the grasps' phases to a scene.

    Each contact is a sphere with an arrow along the force on the target: green while friction sticks, orange at its
    limit, grey while the grasp is not latched. A label at the target says the phase and the quality.

    Args:
        grasps: What is drawn, as of the last step.
        scene: Where to; what does not fit in `maxgeom` is left out.
        metres_per_newton: Length of the arrows, m/N; None: 5 cm for the target's weight on earth, or for 1 N
            if it has none.
        size: Radius of the spheres, m; arrows are half as thick.
        labels: Whether phases are written.
        clear: Whether what is in the scene goes first: wanted for a viewer's `user_scn`, which keeps it.

    Returns:
        The number of shapes added.
    """
    if clear:
        scene.ngeom = 0
    before = int(scene.ngeom)
    for grasp in grasps:
        latched = grasp.is_grasped
        weight = 9.81 * float(grasps.model.body_subtreemass[grasp.target_id])
        # one without mass has no weight to compare with: 5 cm/N
        scale = 0.05 / (weight or 1.0) if metres_per_newton is None else metres_per_newton
        for contact in grasp.contacts():
            colour = (SLIDES if contact.is_sliding else STICKS) if latched else UNGRASPED
            position = contact.position
            _add(scene, _SPHERE, np.full(3, size), position, colour)
            if contact.normal_force > 0:
                # MuJoCo's renderer draws an arrow half as long as it is.
                tip = position + 2 * scale * contact.force
                arrow = _add(scene, _ARROW, np.zeros(3), position, colour)
                if arrow is not None:
                    mujoco.mjv_connector(arrow, _ARROW, size / 2, position, tip)
        if labels:
            place = grasps.data.xipos[grasp.target_id]
            label = _add(scene, _LABEL, np.full(3, size), place, np.ones(4, np.float32))
            if label is not None:
                label.label = f"{grasp.target}: {grasp.phase}, Q = {grasp.quality:.2f} N"
    return int(scene.ngeom) - before


def _add(
    scene: mujoco.MjvScene, kind: int, size: npt.NDArray[np.float64], position: npt.NDArray[np.float64], colour: Colour
) -> mujoco.MjvGeom | None:
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, position, np.eye(3).ravel(), colour)
    scene.ngeom += 1
    return geom
