"""What can go wrong. All texts say what, where, and what would be right."""

__all__ = [
    "BadControlError",
    "BufferFullError",
    "BusyError",
    "DivergedError",
    "EngineError",
    "EngineWarning",
    "Error",
    "ModelError",
    "ResetError",
    "ScenarioError",
    "SpecError",
    "StateError",
    "UnknownNameError",
    "VersionError",
]


class Error(Exception):
    """Any error of this package."""

    failed: tuple[int, ...] = ()
    """Of a `Batch`: the numbers of all simulations that have failed; the error is that of the first."""


class VersionError(Error, ImportError):
    """There is no core for the version of MuJoCo that is installed, or none is installed."""


class ModelError(Error):
    """A model or data that cannot be worked with, or not with these grasps."""


class SpecError(Error, ValueError):
    """An option of a grasp has a value that makes no sense, or not for this model."""


class UnknownNameError(SpecError, LookupError):
    """A name or number that the model does not have; the text lists close ones."""


class StateError(Error, ValueError):
    """A saved state of other grasps, or a damaged one. Nothing was changed."""


class BusyError(Error, RuntimeError):
    """Another thread is stepping the same data."""


class ResetError(Error, RuntimeError):
    """The data has gone back in time under a latched grasp. No step was made."""


class EngineError(Error, RuntimeError):
    """A fault inside MuJoCo. The step was not finished: reset the data or set a state before going on."""


class DivergedError(Error, ArithmeticError):
    """A bad number. Where MuJoCo met it, the data was reset to its initial configuration, as by `mj_step`; where a latched grasp
    met it first, the step was not made, and can be once the number is put right."""


class BufferFullError(Error, RuntimeError):
    """MuJoCo's memory for contacts or constraints is full: the step was made without what was dropped."""


class BadControlError(Error, ValueError):
    """A control is NaN or huge: the step was made with all controls at 0, as by `mj_step`."""


class ScenarioError(Error, ValueError):
    """A scenario or an option that makes no sense, or a run that could not be made."""


class EngineWarning(RuntimeWarning):
    """Something that MuJoCo has warned of in a step and that does not make it wrong."""
