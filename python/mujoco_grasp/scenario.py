"""Scenario files: `run`, `bench` and `agree` of the command line, as functions.

The fields are those of the command line's `--json`; they end in their unit where they have one. A number that does not
exist in a run is None. Everything runs in Rust, on all cores, with the GIL released; Ctrl-C ends it.
"""

import dataclasses
import json
import operator
import os
import types
import typing
from dataclasses import dataclass

from ._core import agree_json, bench_json, run_json, scenarios_json
from .errors import ScenarioError

Limits = typing.Literal["cones", "box", "rigid"]
Report = typing.TypeVar("Report")

# the largest that the core takes
NOSLIP = 2**16 - 1
STEPS = 2**32 - 1


@dataclass(frozen=True)
class Listed:
    """A built-in scenario."""

    name: str
    about: str


@dataclass(frozen=True)
class Change:
    """A latch or a release."""

    time_s: float
    """The first step in the new phase."""
    phase: int
    """0 ungrasped, 1 grasped."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One grasp of a run in numbers. Motion is that of the target in the palm's frame since `measure_from`."""

    outcome: str | None
    """"held", "slid" or "lost"; None where the run ended before `measure_from`."""
    latched_at_s: float | None
    released_at_s: float | None
    latched_share: float | None
    """Of the steps from `measure_from` to the hand's last touch, those that were latched."""
    substructured_share: float | None
    """Of the latched ones among them, those on frozen geometry."""
    changes: list[Change]
    peak_motion_m: float | None
    peak_rotation_rad: float | None
    final_offset_m: float | None
    max_penetration_m: float | None
    creep_m_per_s: float | None
    quality_at_latch_n: float | None
    normal_force_total_n: float | None
    slip_onset_s: float | None
    step_us_median: float | None


@dataclass(frozen=True, kw_only=True)
class OtherGrasp(Summary):
    """A grasp besides the one that a run is about."""

    grasp: int
    """Its place in the scenario file, from 0."""
    target: str
    palm: str


@dataclass(frozen=True, kw_only=True)
class Run(Summary):
    """One run: the grasp whose target is pushed, or the first."""

    whole_steps: dict[str, int] = dataclasses.field(default_factory=dict)
    """Why latched steps were not made on frozen geometry, and how many."""
    others: list[OtherGrasp] = dataclasses.field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """How far the grasp mode is from the full contact solve; root mean squares from `measure_from` on."""

    same_outcome: bool
    vacuous: bool
    """Grasp mode was never latched in that time: the comparison says nothing."""
    position_rmse_m: float | None
    relative_error: float | None
    rotation_rmse_rad: float | None
    normal_force_relative_error: float | None
    others: list["Comparison"] = dataclasses.field(default_factory=list)


@dataclass(frozen=True)
class Pair:
    """Both modes under one push."""

    push: str
    full: Run | None
    """MuJoCo's own contact solve."""
    grasp: Run | None
    """The grasp controller."""
    compare: Comparison | None


@dataclass(frozen=True)
class RunReport:
    """What `run` gives."""

    scenario: str
    engine: str
    nv: int
    timestep_s: float
    runs: list[Pair]
    error: str | None
    """Why runs ended early, or could not be written; what they have until then is in `runs`."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Medians of one way of stepping, and a mean."""

    step_us: float | None
    step_mean_us: float | None
    """Over the calls of a turn, each the median of its times in all turns: what steps that are not alike cost together."""
    contact_us: float | None
    """All that is spent because of contacts or the grasp; None where it cannot be told apart."""
    added_us: float | None
    """What a step costs more than the floor's."""
    solver: str | None = None
    kept_outcome: bool | None = None
    unlatched_steps: int | None = None
    substructured_steps: int | None = None
    whole_steps: dict[str, int] = dataclasses.field(default_factory=dict)
    """Why steps were not made on frozen geometry, and how many."""


@dataclass(frozen=True)
class Ratio:
    """Ratios of medians, or of means where they say so; None where one does not exist."""

    contact: float | None
    contact_noslip: float | None
    step: float | None
    step_noslip: float | None
    step_default: float | None
    mean_noslip: float | None
    mean_default: float | None
    added: float | None
    added_noslip: float | None
    step_over_floor: float | None


@dataclass(frozen=True)
class Phases:
    """All ways of stepping under one load."""

    steps: int
    full: Timing
    """MuJoCo's own solve without noslip, with the cheapest solver that keeps the outcome."""
    full_noslip: Timing
    """The same with 10 noslip iterations."""
    full_default: Timing
    """The model's own solver and noslip, untouched."""
    grasp: Timing
    exact: Timing
    """The grasp controller with every step whole."""
    floor: Timing
    """No contacts at all."""
    ratio: Ratio


@dataclass(frozen=True)
class BenchReport:
    """What `bench` gives."""

    scenario: str
    engine: str
    nv: int
    still: Phases
    pushed: Phases | None
    ik_us: float | None
    onset_factor: float | None
    latched: bool


@dataclass(frozen=True)
class Spread:
    """Median and tenth percentile."""

    median: float | None
    p10: float | None


@dataclass(frozen=True)
class Held:
    """Trials that full mode holds."""

    count: int
    same_outcome: int
    median_relative_error: float | None
    p90_relative_error: float | None
    worst_relative_error: float | None
    rotation_relative_error: float | None
    normal_force_relative_error: float | None
    median_position_rmse_m: float | None
    p90_position_rmse_m: float | None


@dataclass(frozen=True)
class Slid:
    """Trials that slide in full mode."""

    count: int
    same_outcome: int
    median_final_offset_relative_error: float | None
    median_final_offset_difference_m: float | None


@dataclass(frozen=True)
class Lost:
    """Trials that full mode loses."""

    count: int
    same_outcome: int


@dataclass(frozen=True)
class Onset:
    """The smallest push in a direction that is not held, N or N m."""

    kind: str
    """"force" or "torque"."""
    direction: list[float]
    full: float | None
    grasp: float | None


@dataclass(frozen=True)
class Disagreement:
    """A trial with another outcome in each mode."""

    trial: int
    force_n: list[float]
    torque_nm: list[float]
    duration_s: float
    size_over_onset: float
    full: str | None
    grasp: str | None
    vacuous: bool
    chaotic: bool | None
    error: str | None
    full_final_offset_m: float | None
    grasp_final_offset_m: float | None


@dataclass(frozen=True)
class AgreeReport:
    """What `agree` gives."""

    scenario: str
    engine: str
    seed: int
    push_start_s: float
    end_s: float
    latched: bool
    noslip_iterations: int
    trials: int
    vacuous_trials: int
    same_outcome: int
    agreement: float | None
    chaotic_trials: int | None
    latched_share: Spread
    substructured_share: Spread
    held: Held
    slid: Slid
    lost: Lost
    failed: int
    slip_onset_relative_error_median: float | None
    onset_relative_error_median: float | None
    onsets_in_one_mode_only: int
    onsets: list[Onset]
    disagreements: list[Disagreement]


def scenarios() -> list[Listed]:
    """The built-in scenarios, by the names that `run`, `bench` and `agree` take."""
    return [Listed(**listed) for listed in json.loads(scenarios_json())]


def run(
    scenario: str | os.PathLike[str],
    mode: typing.Literal["full", "grasp", "both"] = "both",
    push: str = "all",
    *,
    limits: Limits | None = None,
    noslip: int | None = None,
    frozen_tolerance: float | None = None,
    duration: float | None = None,
    out: str | os.PathLike[str] | None = None,
) -> RunReport:
    """Simulates pushes and compares MuJoCo's own contact solve with the grasp controller.

    Args:
        scenario: A built-in scenario's name, or the path of a scenario file.
        mode: Which is simulated.
        push: A push by its name; "all", each by itself; or "none".
        limits: Bounds every grasp in this way, whatever the scenario says.
        noslip: Iterations of MuJoCo's noslip solver, all of them made, instead of the model's.
        frozen_tolerance: Instead of the scenario's, rad.
        duration: Instead of the scenario's, s.
        out: A folder for the trajectories, `MODE-PUSH.csv`; None writes none.

    Raises:
        ScenarioError: Bad input; the text names file and field.
    """
    noslip = noslip if noslip is None else whole("noslip", noslip, 0, NOSLIP)
    text = run_json(os.fspath(scenario), mode, push, limits, noslip, frozen_tolerance, duration, out)
    return _report(RunReport, text)


def bench(
    scenario: str | os.PathLike[str],
    *,
    steps: int = 10_000,
    substeps: int = 10,
    limits: Limits | None = None,
    frozen_tolerance: float | None = None,
) -> BenchReport:
    """Times the holding phase of a scenario: `steps` steps of each way of stepping, `substeps` in a call.

    Raises:
        ScenarioError: Bad input; the text names file and field.
    """
    steps, substeps = whole("steps", steps, 1, STEPS), whole("substeps", substeps, 1, STEPS)
    text = bench_json(os.fspath(scenario), steps, substeps, limits, frozen_tolerance)
    return _report(BenchReport, text)


def agree(
    scenario: str | os.PathLike[str],
    *,
    trials: int = 300,
    seed: int = 0,
    limits: Limits | None = None,
    noslip: int | None = None,
    frozen_tolerance: float | None = None,
) -> AgreeReport:
    """Random pushes in both modes: the same story? The same seed draws the same pushes.

    Raises:
        ScenarioError: Bad input; the text names file and field.
    """
    noslip = noslip if noslip is None else whole("noslip", noslip, 0, NOSLIP)
    trials, seed = whole("trials", trials, 1, 1_000_000), whole("seed", seed, 0, 2**64 - 1)
    text = agree_json(os.fspath(scenario), trials, seed, limits, noslip, frozen_tolerance)
    return _report(AgreeReport, text)


def whole(name: str, value: typing.Any, least: int, most: int) -> int:
    """A whole number in these bounds, or an error that names it."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if not least <= number <= most:
        raise ScenarioError(f"{name} is {value!r}; it must be a whole number from {least} to {most}")
    return number


def _report(kind: type[Report], text: str) -> Report:
    """A dataclass from the core's JSON."""
    report: Report = _read(kind, json.loads(text))
    return report


def _read(kind: typing.Any, value: typing.Any) -> typing.Any:
    """A value of the type `kind` from what JSON gives."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        return None if value is None else _read(next(a for a in arguments if a is not type(None)), value)
    if origin is list:
        return [_read(arguments[0], item) for item in value]
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return kind(**{name: _read(hints[name], item) for name, item in value.items()})
    return value
