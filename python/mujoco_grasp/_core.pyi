"""The compiled core."""

import os
from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal, Self, TypedDict, Unpack, final

import mujoco
import numpy as np
import numpy.typing as npt

_Body = str | int
"""A body by its name, or by its number for one without a name."""
_Limits = Literal["cones", "box", "rigid"]
_Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
_Vector = npt.NDArray[np.float64]

class _GraspOptions(TypedDict, total=False):
    """Options of a grasp; one that is left out, or None, has its default."""

    effectors: Sequence[_Body] | None
    """Links that may hold the target; none, the default: every link below the palm."""
    latch_quality: float | None
    """Quality at which the grasp latches, N. The default: a tenth of the target's weight."""
    release_quality: float | None
    """What a latched grasp must keep not to be given up, N: with "cones" the sum of the normal forces, else the quality.
    The default: a quarter of `latch_quality`."""
    latch_time: float | None
    """Simulated time of good quality before it latches, s; 0.05."""
    release_time: float | None
    """Simulated time without hold before it is given up, s; 0.05."""
    limits: _Limits | None
    """What stands for the contacts: their friction cones ("cones", the default), or for comparison one bound for each axis of
    a weld ("box"), or a plain weld ("rigid"). The latter need a weld in the model, see `weld_xml`."""
    relaxed: Sequence[_Axis] | None
    """Axes that may slip, "box" only; all six."""
    axes: Sequence[float] | None
    """Orientation of those axes in the target's frame, a quaternion w, x, y, z, "box" only; that frame itself."""
    solref: Sequence[float] | None
    """Of the weld's axes that may not slip, "box" and "rigid": `[time constant (s), damping ratio]` or
    `[-stiffness, -damping]`. The default: from the contacts."""
    solimp: Sequence[float] | None
    """Likewise."""
    relaxed_solref: Sequence[float] | None
    """Of the axes that may slip, "box" only."""
    relaxed_solimp: Sequence[float] | None
    """Likewise."""

@final
class Grasps:
    """All grasps of one simulation, in place on its `MjModel` and `MjData`.

    Nothing is copied: after each call the data is as after `mj_step`, with sensors, `cfrc_ext` and the contact list
    seeing the contacts of a latched grasp with their forces, and the model's options are as you set them. What you change
    in either between two calls counts from the next step on. Both are kept alive; resetting the data keeps its memory, so
    grasps stay valid (see `reset`), while a copied, unpickled or recompiled model is another one.

    One thread at a time may step a data. The GIL is released meanwhile, as by `mj_step`.
    """

    def __new__(
        cls,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        target: _Body | None = None,
        palm: _Body | None = None,
        *,
        frozen_tolerance: float = 2e-3,
        **options: Unpack[_GraspOptions],
    ) -> Self:
        """Borrows model and data, with one grasp if a target is given.

        Args:
            model: As it was loaded.
            data: Made from it.
            target: Body that is grasped: one of its own, for example with a free joint.
            palm: Base of the fingers, every link below may hold. None: the lowest common ancestor of the effectors, and
                without any, the only hand that can touch the target.
            frozen_tolerance: See the property.
            options: Of the grasp.

        Raises:
            ModelError: Not a model and its data, or a model with what is not served (flexes, RK4, stateful plugins).
            UnknownNameError: A name that the model does not have.
            SpecError: Bodies that cannot hold or be held, values that make no sense.
            TypeError: An option that does not exist.
        """

    def add(
        self,
        target: _Body,
        palm: _Body | None = None,
        **options: Unpack[_GraspOptions],
    ) -> Grasp:
        """Adds a grasp; options and errors as of the class. Those that move each other are solved as one problem."""

    def step(self, n: int = 1) -> None:
        """Advances the data by `n` steps with the same controls, instead of `mj_step(model, data, n)`.

        While nothing is latched this is `mj_step` bit for bit. While a grasp is latched, all steps but the last may be made
        on frozen geometry, which is several times quicker; after the last all of the data is computed.

        Ctrl-C ends it after a whole step.

        Raises:
            DivergedError, BufferFullError, BadControlError: The step was made as `mj_step` makes it; those left of `n` were
                not. While a grasp is latched, a load or a model with a bad number is a DivergedError and the step is not
                made: put it right and go on.
            EngineError: A fault inside MuJoCo. The step was not finished.
            ResetError: The data has gone back in time under a latched grasp, and `reset` or `restore` was not called.
            BusyError: Another thread is stepping this data.
            ModelError: Memory has moved, or one of MuJoCo's callbacks is set (all but `mjcb_time`), which would be left out or
                called with a model that it does not know.
        """

    def substep(self) -> None:
        """As `step()`, for a step after which only `qpos`, `qvel`, `act`, time and the grasps' contacts are wanted.

        For loops in which controls or forces change in every step: call it for all but the last.
        """

    def monitor(self) -> None:
        """After an `mj_step` of your own: reads contacts, forces and quality, and counts good time without latching."""

    def reset(self) -> None:
        """Ungrasped again, with nothing counted: to be called when the data is reset."""

    def save(self) -> State:
        """What the grasps remember from step to step.

        With the data's own state, `mj_getState(..., mjtState.mjSTATE_INTEGRATION)`, a replay by single steps is the same bit
        for bit.
        """

    def restore(self, state: State) -> None:
        """Goes back to a state that these grasps, or others with the same options of the same model, have saved.

        Contacts are empty and qualities 0 until the next step.

        Raises:
            StateError: Another number of grasps, another model or other options; nothing is changed.
        """

    @property
    def frozen_tolerance(self) -> float:
        """Angle by which anything may turn between two whole steps, rad; with 0 every step is whole."""
    @frozen_tolerance.setter
    def frozen_tolerance(self, angle: float) -> None: ...
    @property
    def frozen_steps(self) -> int:
        """Steps so far that were made on frozen geometry."""
    @property
    def whole_steps(self) -> dict[str, int]:
        """Why others were not, and how many: "merged", "changed", "refresh", "contacts", "swings", "handover", "turned", "slid", "near"."""
    @property
    def model(self) -> mujoco.MjModel:
        """As it was given."""
    @property
    def data(self) -> mujoco.MjData:
        """As it was given."""
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Grasp: ...
    def __iter__(self) -> Iterator[Grasp]: ...

@final
class Batch:
    """Simulations of one model, stepped side by side on all cores, each with an `MjData` and `Grasps` of its own.

    `data` and `grasps` are at your disposal between two calls. What a simulation does depends on nothing but its own inputs:
    results are the same bit for bit with any number of threads, and those of its grasps stepped alone.
    """

    def __new__(
        cls,
        model: mujoco.MjModel,
        nsim: int,
        target: _Body | None = None,
        palm: _Body | None = None,
        *,
        threads: int | None = None,
        frozen_tolerance: float = 2e-3,
        **options: Unpack[_GraspOptions],
    ) -> Self:
        """`nsim` simulations at the model's initial configuration, on `threads` threads (None: as many as there are cores;
        more than `nsim` are not used).

        Options and errors as for `Grasps`. The model is shared and never written.
        """

    def step(self, n: int = 1, *, ctrl: npt.ArrayLike | None = None, xfrc_applied: npt.ArrayLike | None = None) -> None:
        """Advances each simulation by `n` steps, as `Grasps.step`, with the GIL released.

        Ctrl-C ends it, after as many steps of each simulation, of which the last is whole.

        Args:
            n: Steps.
            ctrl: Controls, shape (nsim, nu); None: as they are in each data.
            xfrc_applied: Wrenches on bodies, [force; torque] at their centres of mass, world axes, N and N m, shape
                (nsim, nbody, 6); None: as they are in each data.

        Raises:
            SpecError: Arrays of other shapes.
            Error: That of the first simulation that has failed. Its `failed` has the numbers of all that have, and its notes
                say what the others' errors were; those that have not failed have made all their steps.
        """

    def reset(self, keyframe: str | None = None) -> None:
        """Resets all data to the initial configuration or a keyframe, and all grasps.

        Raises:
            UnknownNameError: A keyframe that the model does not have; nothing is reset.
        """

    @property
    def qpos(self) -> _Vector:
        """Positions, shape (nsim, nq), a copy; may be set."""
    @qpos.setter
    def qpos(self, qpos: npt.ArrayLike) -> None: ...
    @property
    def qvel(self) -> _Vector:
        """Velocities, shape (nsim, nv), a copy; may be set."""
    @qvel.setter
    def qvel(self, qvel: npt.ArrayLike) -> None: ...
    @property
    def sensordata(self) -> _Vector:
        """Sensors' values, shape (nsim, nsensordata), a copy."""
    @property
    def time(self) -> _Vector:
        """Simulated time, s, shape (nsim,)."""
    @property
    def is_grasped(self) -> npt.NDArray[np.bool_]:
        """Whether each grasp is latched, shape (nsim, number of grasps)."""
    @property
    def quality(self) -> _Vector:
        """Quality of each grasp, N, shape (nsim, number of grasps)."""
    @property
    def data(self) -> tuple[mujoco.MjData, ...]:
        """Each simulation's `MjData`."""
    @property
    def grasps(self) -> tuple[Grasps, ...]:
        """Each simulation's grasps."""
    def __len__(self) -> int: ...

@final
class Grasp:
    """One of the `Grasps`; all numbers are those of the last step."""

    @property
    def grasps(self) -> Grasps:
        """What it is one of."""
    @property
    def index(self) -> int:
        """Its place in the order in which grasps were added, from 0."""
    @property
    def target(self) -> str:
        """Name of the body that is grasped."""
    @property
    def target_id(self) -> int:
        """The target's body number."""
    @property
    def palm(self) -> str:
        """Name of the body at the base of the fingers."""
    @property
    def effectors(self) -> list[str]:
        """Links that may hold the target."""
    @property
    def limits(self) -> _Limits:
        """What stands for its contacts: "cones", "box" or "rigid"."""
    @property
    def phase(self) -> Literal["ungrasped", "grasped"]:
        """ "ungrasped", or "grasped" while it is latched."""
    @property
    def is_grasped(self) -> bool:
        """Whether it is latched."""
    @property
    def would_latch(self) -> bool:
        """Grasped, or the quality has been good for long enough."""
    @property
    def quality(self) -> float:
        """Smallest singular value of the grasp matrix, scaled by the live normal forces, N."""
    @property
    def latch_quality(self) -> float:
        """Quality at which it latches, N."""
    @property
    def release_quality(self) -> float:
        """What it must keep, once latched, not to be given up, N."""
    @property
    def latched_at(self) -> float | None:
        """Data time at the end of the step in which it last latched, s; None if it never has."""
    @property
    def latched_time(self) -> float:
        """Simulated time of all steps so far that it began latched, s."""
    @property
    def merged_time(self) -> float:
        """Of these, with its contacts merged into a weld (limits "box" and "rigid"), s."""
    @property
    def bounds(self) -> tuple[float, float] | None:
        """Largest force (N) and torque (N m) in the next step for each axis, "box" while grasped."""
    @property
    def merged_wrench(self) -> _Vector | None:
        """Wrench of the weld on the target about its centre of mass, in the grasp's axes, [force; torque], N and N m."""
    def contacts(self) -> list[Contact]:
        """Contacts between hand and target, with their live forces, latched or not."""
    def measures(self) -> QualityReport:
        """The field's quality measures of the effectors' contacts; costs milliseconds.

        Raises:
            DivergedError: Contacts or forces that are not numbers.
        """
    def release(self) -> None:
        """Gives the contacts back to MuJoCo."""
    def allow_latch(self, allowed: bool) -> None:
        """Forbids or allows latching; a latched grasp stays so."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class Contact:
    """A contact of a link and the target. World frame; the normal points into the target, forces are those on it."""

    @property
    def link(self) -> str:
        """Body of the hand."""
    @property
    def link_id(self) -> int:
        """Its number."""
    @property
    def geoms(self) -> tuple[int, int]:
        """Both geoms, in MuJoCo's order."""
    @property
    def position(self) -> _Vector:
        """Midpoint between the two surfaces, m, shape (3,)."""
    @property
    def normal(self) -> _Vector:
        """Unit normal into the target, shape (3,)."""
    @property
    def axes(self) -> _Vector:
        """Normal and two tangents as rows, shape (3, 3)."""
    @property
    def force(self) -> _Vector:
        """On the target, N, shape (3,)."""
    @property
    def torque(self) -> _Vector:
        """On the target, besides that of `force` at `position`, N m, shape (3,)."""
    @property
    def force_rows(self) -> _Vector:
        """Along and about `axes`: normal, two tangents (N), spin, two rolling (N m), shape (6,)."""
    @property
    def normal_force(self) -> float:
        """N, never negative."""
    @property
    def slip_velocity(self) -> _Vector:
        """Tangential velocity of the target relative to the link, m/s, shape (3,)."""
    @property
    def is_sliding(self) -> bool:
        """While latched: whether friction is at its limit."""
    @property
    def dist(self) -> float:
        """Distance of the surfaces, negative when they overlap, m."""
    @property
    def condim(self) -> int:
        """Dimensions of its friction, as of a geom: 1, 3, 4 or 6."""
    @property
    def friction(self) -> _Vector:
        """Two tangential coefficients, spin (m), two rolling (m), shape (5,)."""

@final
class QualityReport:
    """Quality of a grasp in all measures."""

    @property
    def min_singular_value_n(self) -> float:
        """Smallest singular value of the grasp matrix, N."""
    @property
    def ferrari_canny_n(self) -> float:
        """Ferrari and Canny's epsilon, N."""
    @property
    def hull_volume(self) -> float:
        """Volume of the wrench hull, N^6."""
    @property
    def isotropy(self) -> float:
        """Smallest over largest singular value."""
    @property
    def force_closure(self) -> bool:
        """Whether any wrench can be resisted if pressed hard enough."""
    @property
    def holds_own_weight(self) -> bool:
        """Whether the target's weight is held with no contact pressed harder than now."""
    @property
    def contacts(self) -> int:
        """Contacts that carry force."""

@final
class State:
    """What grasps remember; it can be compared, copied, pickled, and written as JSON."""

    @staticmethod
    def from_json(text: str) -> State:
        """Raises `StateError` for a text that is no state."""
    def to_json(self) -> str:
        """The state as text, for `from_json`."""
    def __eq__(self, other: object, /) -> bool: ...
    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __copy__(self) -> State: ...
    def __deepcopy__(self, memo: object, /) -> State: ...
    def __len__(self) -> int: ...

def mujoco_version() -> str:
    """The version of MuJoCo that the core is for, e.g. "3.17.0"."""

def weld_xml(target: str, hand: str | None = None) -> str:
    """The elements that an MJCF needs, besides its own, for a grasp of the body `target` with "box" or "rigid".

    A weld, switched off, to be put at the end of the model's text, after all other equality constraints. `hand` is any body
    of the hand; None: the world.
    """

def scenarios_json() -> str: ...
def run_json(
    scenario: str,
    mode: str,
    push: str,
    limits: str | None,
    noslip: int | None,
    frozen_tolerance: float | None,
    duration: float | None,
    out: str | os.PathLike[str] | None,
) -> str: ...
def bench_json(scenario: str, steps: int, substeps: int, limits: str | None, frozen_tolerance: float | None) -> str: ...
def agree_json(
    scenario: str,
    trials: int,
    seed: int,
    limits: str | None,
    noslip: int | None,
    frozen_tolerance: float | None,
) -> str: ...
def sweep_json(spec: str, out: str, shard: str | None, mode: str) -> str: ...
