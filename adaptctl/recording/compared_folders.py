"""Differences between finished experiments, from their summaries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from adaptctl.errors import FileError, InputError
from adaptctl.recording.finished_trace import error_unit
from adaptctl.recording.result import SUMMARY
from adaptctl.recording.run_table import Summary, read_summary

SCHEMA = "adaptctl/comparison/2"


class Difference(NamedTuple):
    """
    Setting or fact in which experiments differ.

    Parameters
    ----------
    name : str
        Name of the setting.
    values : tuple of str
        Its value in each experiment, "–" where it has none.
    """

    name: str
    values: tuple[str, ...]


class ErrorRatios(NamedTuple):
    """
    Errors of one controller in several experiments.

    Parameters
    ----------
    name : str
        Name of the controller's run.
    errors : tuple of float or None
        Root mean square tracking errors of the last 2 s in rad (m); None where an experiment has none.
    """

    name: str
    errors: tuple[float | None, ...]

    @property
    def ratios(self) -> tuple[float | None, ...]:
        """Errors divided by that of the first experiment."""
        first = self.errors[0]
        return tuple(None if error is None or not first else error / first for error in self.errors)

    @property
    def words(self) -> tuple[str, ...]:
        """Errors in mrad (mm), each with its ratio in brackets."""
        return tuple(_in_thousandths(error, ratio) for error, ratio in zip(self.errors, self.ratios, strict=True))


def _in_thousandths(error: float | None, ratio: float | None) -> str:
    return "–" if error is None else f"{1e3 * error:.3g}" + ("" if ratio is None else f" ({ratio:.3g})")


class ComparedFolders(NamedTuple):
    """
    Comparison of finished experiments.

    Parameters
    ----------
    folders : tuple of str
        Results folders.
    unit : str
        Unit of the errors, "rad" or "m", or both.
    differences : tuple of Difference
        What differs in experiment, robot, version and settings.
    errors : tuple of ErrorRatios
        Errors of the controllers that all experiments have.
    """

    folders: tuple[str, ...]
    unit: str
    differences: tuple[Difference, ...]
    errors: tuple[ErrorRatios, ...]

    def as_builtins(self) -> dict[str, Any]:
        """Comparison in JSON's types."""
        errors = {one.name: {"final_rms_error": list(one.errors), "ratio": list(one.ratios)} for one in self.errors}
        return {
            "schema": SCHEMA,
            "folders": list(self.folders),
            "differences": {one.name: list(one.values) for one in self.differences},
            "unit": self.unit,
            "errors": errors,
        }


def compare_folders(folders: Sequence[str | Path]) -> ComparedFolders:
    """
    Compare finished experiments that have controllers in common, of one robot or of several.

    Parameters
    ----------
    folders : sequence of str or Path
        Two or more results folders.

    Returns
    -------
    ComparedFolders
        What differs in the settings, and errors of the controllers that all have.

    Raises
    ------
    InputError
        If there are fewer than two folders, they have no controller in common, or errors have different units.
    FileError
        If a summary or trace is missing or cannot be read.
    """
    if len(folders) < 2:
        raise InputError(f"expected at least two results folders to compare, got {len(folders)}")
    summaries = [summary_of(Path(folder)) for folder in folders]
    unit = _common_unit(folders)
    names = [name for name in summaries[0].runs if all(name in summary.runs for summary in summaries)]
    if not names:
        each = (f"{folder} has {', '.join(one.runs)}" for folder, one in zip(folders, summaries, strict=True))
        raise InputError(f"the experiments have no controller in common: {'; '.join(each)}")
    errors = (ErrorRatios(name, tuple(one.runs[name].final_rms_error for one in summaries)) for name in names)
    return ComparedFolders(tuple(map(str, folders)), unit, tuple(_differences(summaries)), tuple(errors))


def summary_of(folder: Path) -> Summary:
    """Summary of a finished experiment, else `FileError`."""
    if not (path := folder / SUMMARY).is_file():
        raise FileError(f"{folder}: no {SUMMARY} in it; give a results folder of adaptctl experiment run")
    return read_summary(path)


def _common_unit(folders: Sequence[str | Path]) -> str:
    """Unit of the errors; `InputError` where they have no ratio."""
    units = [error_unit(folder) for folder in folders]
    if len(set(units)) > 1:
        each = (f"{folder}: {unit}" for folder, unit in zip(folders, units, strict=True))
        raise InputError(f"errors in different units cannot be compared ({'; '.join(each)})")
    return units[0]


def _differences(summaries: Sequence[Summary]) -> list[Difference]:
    facts = [_facts(summary) for summary in summaries]
    names = dict.fromkeys(name for fact in facts for name in fact)
    told = (Difference(name, tuple(fact.get(name, "–") for fact in facts)) for name in names)
    return [one for one in told if len(set(one.values)) > 1]


def _facts(of: Summary) -> dict[str, str]:
    robot = {"robot": of.robot, "geometry and inertia": of.robot_sha256[:12]}
    return {"experiment": of.experiment, **robot, "version": of.version} | of.settings
