"""Differences between finished experiments, from their summaries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from adaptctl.errors import FileError, InputError
from adaptctl.recording.result import SUMMARY
from adaptctl.recording.run_table import Summary, read_summary


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


class ComparedFolders(NamedTuple):
    """
    Comparison of finished experiments.

    Parameters
    ----------
    differences : tuple of Difference
        What differs in robot, seed, version and settings.
    errors : tuple of ErrorRatios
        Errors of the controllers that all experiments have.
    """

    differences: tuple[Difference, ...]
    errors: tuple[ErrorRatios, ...]


def compare_folders(folders: Sequence[str | Path]) -> ComparedFolders:
    """
    Compare finished experiments of one kind.

    Parameters
    ----------
    folders : sequence of str or Path
        Two or more results folders of one experiment.

    Returns
    -------
    ComparedFolders
        What differs in the settings, and errors of the controllers that all have.

    Raises
    ------
    InputError
        If there are fewer than two folders, their experiments are not the same, or they have no controller in common.
    FileError
        If a summary is missing or cannot be read.
    """
    if len(folders) < 2:
        raise InputError(f"expected at least two results folders to compare, got {len(folders)}")
    summaries = [read_summary(_summary_of(Path(folder))) for folder in folders]
    kinds = dict.fromkeys(summary.experiment for summary in summaries)
    if len(kinds) > 1:
        raise InputError(f"only runs of one experiment can be compared, these are of {', '.join(kinds)}")
    names = [name for name in summaries[0].runs if all(name in summary.runs for summary in summaries)]
    if not names:
        raise InputError("the experiments have no controller in common")
    errors = (ErrorRatios(name, tuple(one.runs[name].final_rms_error for one in summaries)) for name in names)
    return ComparedFolders(tuple(_differences(summaries)), tuple(errors))


def _summary_of(folder: Path) -> Path:
    if not (path := folder / SUMMARY).is_file():
        raise FileError(f"{folder}: no {SUMMARY} in it; give a results folder of adaptctl experiment run")
    return path


def _differences(summaries: Sequence[Summary]) -> list[Difference]:
    facts = [
        {"robot": of.robot, "geometry and inertia": of.robot_sha256[:12], "version": of.version} | of.settings
        for of in summaries
    ]
    names = dict.fromkeys(name for fact in facts for name in fact)
    told = (Difference(name, tuple(fact.get(name, "–") for fact in facts)) for name in names)
    return [one for one in told if len(set(one.values)) > 1]
