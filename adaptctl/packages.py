"""Packages that only some of the work asks for, named where they are missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from adaptctl.errors import MissingExtraError

DISTRIBUTIONS = {
    "clarabel": "'adaptctl[consistency]'",
    "cvxpy": "'adaptctl[consistency]'",
    "dask": "'adaptctl[sweep]'",
    "distributed": "'adaptctl[sweep]'",
    "jinja2": "'adaptctl[report]'",
    "matplotlib": "'adaptctl[report]'",
    "mujoco": "'adaptctl[mujoco]'",
    "optuna": "'adaptctl[search]'",
    "pinocchio": "pin",
    "pyarrow": "'adaptctl[report]'",
    "rerun": "rerun-sdk",
    "rosbags": "'adaptctl[logs]'",
    "stable_baselines3": "'adaptctl[rl]'",
}
"""Names for pip of the packages that are imported by another name, or come with an extra."""
OF_RESULTS = ("jinja2", "matplotlib", "pyarrow", "rerun")
"""What the folder of a run is written by: its report, figures, tables and recording."""


@contextmanager
def needed(what: str) -> Iterator[None]:
    """Context manager, or decorator, in which an import of a package that is not installed raises `MissingExtraError`,
    whose message has the command that installs it.

    `what` names the function or task that needs the package, and begins the message. Missing modules of `adaptctl`
    itself pass as `ModuleNotFoundError`.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        missing = str(error.name).partition(".")[0]
        if missing == "adaptctl":
            raise
        raise MissingExtraError(f"{what} needs {missing}: pip install {DISTRIBUTIONS.get(missing, missing)}") from error


def require_for_results() -> None:
    """Raise `ModuleNotFoundError` where a package that the folder of a run is written by is not installed: before
    hours of computing, not after them. Nothing is imported."""
    for name in OF_RESULTS:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def viewer_program() -> str | None:
    """The path, as text, of the viewer program of the package rerun-sdk, which shows recorded runs: `rerun` in the
    folder of this Python or else on the PATH; None where there is none. Nothing is raised."""
    import shutil

    return shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
