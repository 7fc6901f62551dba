"""Experiments and how to find them."""

from __future__ import annotations

import inspect
import sys
from difflib import get_close_matches
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, NamedTuple, TypeGuard

from adaptctl.errors import FileError, InputError, NotFoundError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from adaptctl.experiments.experiment import Experiment

__all__ = ["EXPERIMENTS", "GROUP", "RENAMED", "Entry", "find", "from_entry_point", "from_file", "offered"]


class Entry(NamedTuple):
    """
    Built-in experiment, with all that is needed to choose it without importing it.

    Parameters
    ----------
    name : str
        Name on the command line, such as "two-arms"; its module has that name too.
    summary : str
        One line of words.

    Examples
    --------
    >>> from adaptctl.experiments import EXPERIMENTS
    >>> [entry.name for entry in EXPERIMENTS if "arms" in entry.name]
    ['two-arms']
    """

    name: str
    summary: str


EXPERIMENTS = (
    Entry("puma560-adaptive", "Adaptive tracking of the PUMA 560 from zero estimates of its 36 base parameters"),
    Entry(
        "semi-direct-drive-adaptive",
        "Adaptive tracking of the semi-direct-drive arm, a closed loop with 26 base parameters",
    ),
    Entry("adaptive", "Adaptive tracking for any robot file, on the built-in plant, on MuJoCo, or on both"),
    Entry("laws", "Comparison of all laws: payloads, noise, weak motors, friction, elastic joints, rest"),
    Entry("two-arms", "Adaptive tracking of two PUMAs that hold one rod: a loop of twelve links, 70 base parameters"),
    Entry("task-space", "Tool path in the world frame: control in task space compared with control in joint space"),
    Entry("contact", "An arm with an unknown load that presses on a table or a wall in MuJoCo, or is pushed"),
    Entry("identify-then-adapt", "Adaptation from parameters identified from a real log, from the URDF, and from zero"),
    Entry(
        "sheu-walker-1991",
        "Replication of every table and figure of Sheu and Walker (1991), with its two arms in closed loop",
    ),
)
RENAMED = {
    "serial-versus-graph": "experiment run sheu-walker-1991 --only serial-versus-graph",
    "adaptation-laws": "experiment run laws",
    "payload-drop": "experiment run laws --disturbance payload",
    "noise-and-delay": "experiment run laws --disturbance noise",
    "saturation": "experiment run laws --disturbance saturation",
    "friction": "experiment run laws --disturbance friction",
    "stable-bandwidth": "experiment run laws --disturbance springs",
    "reduced-model": "experiment run puma560-adaptive --components 36 34 30 25 10",
    "two-plants": "experiment run adaptive --plant both",
    "added-mass": "design puma560_measured",
    "counterweight": "design puma560_geared --drive",
    "energy-differences": "identify tx40 --energy-differences 0.1",
    "export-check": "export puma560_geared --check --out results/export",
}
"""Commands that replace experiments of these names."""
GROUP = "adaptctl.experiments"
"""Group of entry points."""


def offered() -> dict[str, EntryPoint]:
    """
    Return the entry points of installed packages that provide experiments.

    Returns
    -------
    dict
        Entry points of the group "adaptctl.experiments" by name; nothing is imported.

    Examples
    --------
    >>> from adaptctl.experiments import offered
    >>> isinstance(offered(), dict)
    True
    """
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group=GROUP)}


def find(name: str) -> type[Experiment]:
    """
    Import a built-in experiment.

    Parameters
    ----------
    name : str
        Name such as "two-arms".

    Returns
    -------
    type
        Subclass of `Experiment`.

    Raises
    ------
    NotFoundError
        If there is no such experiment.

    Examples
    --------
    >>> from adaptctl.experiments import find
    >>> find("two-arms").__name__
    'TwoArms'
    """
    names = [entry.name for entry in EXPERIMENTS]
    if name in RENAMED:
        raise NotFoundError(f"experiment {name} has been replaced by: adaptctl {RENAMED[name]}")
    if name not in names:
        close = get_close_matches(name, names, n=1, cutoff=0.4)
        guess = f" (did you mean {close[0]!r}?)" if close else ""
        raise NotFoundError(f"unknown experiment {name!r}{guess}; experiments: {', '.join(names)}")
    module = import_module(f"{__name__}.{name.replace('-', '_')}")
    return next(one for one in vars(module).values() if _is_own(one, module.__name__) and one.name == name)


def from_entry_point(point: EntryPoint) -> type[Experiment]:
    """
    Import the experiment of an installed package.

    Parameters
    ----------
    point : EntryPoint
        Entry point of the package.

    Returns
    -------
    type
        Subclass of `Experiment`.

    Raises
    ------
    InputError
        If the import fails or finds no experiment with a name and a title.

    Examples
    --------
    >>> from importlib.metadata import EntryPoint
    >>> from adaptctl.experiments import GROUP, from_entry_point
    >>> from_entry_point(EntryPoint("mine", "adaptctl.experiments.two_arms:TwoArms", GROUP)).__name__
    'TwoArms'
    """
    try:
        found = point.load()
    except Exception as error:  # whatever the other package raises when it is imported
        raise InputError(f"entry point {point.name!r} ({point.value}): {type(error).__name__}: {error}") from error
    return _experiment(found, f"entry point {point.name!r} ({point.value})")


def from_file(path: str | Path) -> type[Experiment]:
    """
    Import the experiment that a Python file defines; the file is run.

    Parameters
    ----------
    path : str or Path
        Python file.

    Returns
    -------
    type
        Subclass of `Experiment`.

    Raises
    ------
    FileError
        If the file cannot be imported or defines no experiment or several.
    InputError
        If the experiment has no name or title.

    Examples
    --------
    >>> import adaptctl.experiments.two_arms
    >>> adaptctl.experiments.from_file(adaptctl.experiments.two_arms.__file__).__name__
    'TwoArms'
    """
    file = Path(path)
    if not file.is_file():
        raise FileError(f"{path}: no such file")
    spec = spec_from_file_location(f"adaptctl_own_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise FileError(f"{path}: cannot be imported as Python")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look their annotations up
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the user's own code raises
        raise FileError(f"{path}: {type(error).__name__}: {error} (line {_line(error, file)})") from error
    own = [value for value in vars(module).values() if _is_own(value, spec.name)]
    if len(own) != 1:
        names = f": {', '.join(kind.__name__ for kind in own)}" if own else ""
        raise FileError(
            f"{path}: expected one class of an experiment, a subclass of Experiment, found {len(own)}{names}"
        )
    return _experiment(own[0], str(path))


def _is_own(value: object, module: str) -> TypeGuard[type[Experiment]]:
    from adaptctl.experiments.experiment import Experiment

    is_kind = isinstance(value, type) and issubclass(value, Experiment)
    return is_kind and value.__module__ == module and not inspect.isabstract(value)


def _experiment(found: object, where: str) -> type[Experiment]:
    from adaptctl.experiments.experiment import Experiment

    if not (isinstance(found, type) and issubclass(found, Experiment)):
        raise InputError(f"{where}: expected a subclass of adaptctl.experiments.experiment.Experiment, got {found!r}")
    for name in ("name", "title"):
        if not isinstance(getattr(found, name, None), str):
            raise InputError(f"{where}: class {found.__name__} has no {name}: add {name}: ClassVar[str] = ...")
    return found


def _line(error: BaseException, file: Path) -> int | str:
    passed = [frame.lineno for frame in extract_tb(error.__traceback__) if Path(frame.filename) == file]
    return passed[-1] if passed and passed[-1] else getattr(error, "lineno", None) or "unknown"
