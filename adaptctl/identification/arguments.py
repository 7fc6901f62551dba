"""Arguments of an identification: files, cut-off and weight."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from adaptctl.arrays import positive_number
from adaptctl.errors import InputError, shown


def file_paths(given: str | Path | Sequence[str | Path]) -> list[str | Path]:
    """Files given, one or several."""
    if isinstance(given, str | Path):
        return [given]
    if not isinstance(given, Iterable):
        raise InputError(f"logs: expected files, got {shown(given)}")
    each = list(given)
    if wrong := [one for one in each if not isinstance(one, str | Path)]:
        raise InputError(f"logs: expected files, got {shown(wrong[0])}")
    return each


def validate_different(logs: Sequence[str | Path], others: Sequence[str | Path]) -> None:
    """Raise `InputError` for a log that is given twice."""
    fitted = [Path(log).resolve() for log in logs]
    judged = [Path(log).resolve() for log in others]
    for what, given, places in (("logs", logs, fitted), ("validate", others, judged)):
        for i, place in enumerate(places):
            if place in places[:i]:
                raise InputError(f"{what}: {given[i]} is given twice")
    for other, place in zip(others, judged, strict=True):
        if place in fitted:
            raise InputError(f"validate: {other} is also used for the fit; give another log, or none")


def validate_settings(cutoff: float | None, weight: float | None) -> None:
    """Raise `InputError` for a cut-off or a weight that is not positive."""
    if cutoff is not None:
        positive_number(cutoff, "cutoff: expected a positive number of Hz")
    if weight is not None:
        positive_number(weight, "prior_weight: expected a positive number")
