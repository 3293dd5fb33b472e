"""Loads the compiled core for the MuJoCo that is installed."""

import importlib.machinery
import importlib.util
import pathlib
import sys

from .errors import VersionError

CORES = pathlib.Path(__file__).parent / "cores"


def readable(version: int) -> str:
    """3017000 is 3.17.0; before 3.5 a digit each, 337 is 3.3.7."""
    if version < 1000:
        return ".".join(str(version))
    return f"{version // 1_000_000}.{version // 1000 % 1000}.{version % 1000}"


def served() -> list[str]:
    """The versions of MuJoCo that there are cores for."""
    folders = (folder for folder in CORES.iterdir() if (folder / "_core.abi3.so").is_file()) if CORES.is_dir() else ()
    return sorted((folder.name for folder in folders), key=lambda name: [int(part) for part in name.split(".")])


def package(version: str) -> str:
    """What is to be installed for a version."""
    return f"{'mujoco' if int(version.split('.')[0]) < 4 else 'mujoco-core'}=={version}"


def load() -> None:
    """Makes the core for `mujoco.mj_version()` the module `mujoco_grasp._core`.

    Raises:
        VersionError: MuJoCo is not installed, or its version is not served.
    """
    versions = served()
    advice = " or ".join(f"pip install {package(version)}" for version in versions)
    try:
        import mujoco
    except ImportError as error:
        raise VersionError(f"MuJoCo is not installed: {advice}") from error
    version = readable(mujoco.mj_version())
    if version not in versions:
        raise VersionError(
            f"MuJoCo {version} is installed, and this mujoco-grasp serves {', '.join(versions)}, as the engine's structures "
            f"differ between versions: {advice}"
        )
    name = f"{__package__}._core"
    # The core needs the library by its soname alone: `import mujoco` has put it into the process.
    loader = importlib.machinery.ExtensionFileLoader(name, str(CORES / version / "_core.abi3.so"))
    core = importlib.util.module_from_spec(importlib.machinery.ModuleSpec(name, loader, origin=loader.path))
    loader.exec_module(core)
    sys.modules[name] = core
