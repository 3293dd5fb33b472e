"""`sweep` of the command line, as a function."""

import operator
import os
import typing
from dataclasses import dataclass

from ._core import sweep_json
from .errors import ScenarioError
from .scenario import Spread, _report


@dataclass(frozen=True)
class SweepReport:
    """What `sweep` gives: all grasps of the shard, whoever has tested them. The rows are in the files."""

    sweep: str
    engine: str
    mode: str
    out: str
    grasps: int
    tested: int
    """Those that this call has tested; the others' files were there already."""
    files: int
    verdicts: dict[str, int]
    """Grasps that are "held", "slid", "lost", "missed" or "failed"."""
    latched_share: Spread
    """Of the steps under loads in which a finger pressed, those that were latched, over the grasps."""
    steps: int
    seconds: float
    """Wall-clock time of this call's tests."""
    threads: int


def sweep(
    spec: str | os.PathLike[str],
    out: str | os.PathLike[str],
    shard: tuple[int, int] | str | None = None,
    *,
    mode: typing.Literal["grasp", "full"] = "grasp",
) -> SweepReport:
    """Closes, shakes and pushes many grasps, and writes which survive into Parquet files; see docs/sweep.md.

    Files that are there are not made again, so the same call goes on where a killed one was. Everything runs in Rust, on
    all cores or `RAYON_NUM_THREADS`, with the GIL released; Ctrl-C ends it.

    Args:
        spec: The path of a sweep's spec.
        out: The folder of results.
        shard: (I, N), or "I/N" as on the command line: only shard I of N, from 0 to N - 1.
        mode: The grasp controller, or MuJoCo's own contact solve.

    Raises:
        ScenarioError: Bad input, the text names file and field; or a file in `out` that is not of this sweep.
    """
    return _report(SweepReport, sweep_json(os.fspath(spec), os.fspath(out), _shard(shard), mode))


def _shard(shard: tuple[int, int] | str | None) -> str | None:
    """As on the command line."""
    if shard is None or isinstance(shard, str):
        return shard
    try:
        index, count = map(operator.index, shard)
    except (TypeError, ValueError):
        raise ScenarioError(f'shard is {shard!r}; it must be (I, N) or "I/N", shard I of N, with I from 0 to N - 1') from None
    return f"{index}/{count}"
