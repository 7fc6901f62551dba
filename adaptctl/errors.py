"""Exceptions and warnings."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

MAX_MESSAGE_CHARACTERS = 2_000
"""characters of a message"""
OURS = (f"{Path(__file__).parent}{os.sep}", str(contextlib.__file__))
"""beginnings of the files that a warning does not name: the library's, and of decorators"""


class AdaptctlError(Exception):
    """
    Base class of this package's errors.

    Parameters
    ----------
    message : object, optional
        Text of the error. Control characters are written out, and its middle is cut above 2000 characters.

    Examples
    --------
    >>> try:
    ...     adaptctl.load("puma56")
    ... except adaptctl.AdaptctlError as error:
    ...     print(type(error).__name__)
    NotFoundError
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message), MAX_MESSAGE_CHARACTERS))


def printable(text: str, most: int = 80) -> str:
    """
    Return a text without control characters, shortened to `most` characters.

    Examples
    --------
    >>> from adaptctl.errors import printable
    >>> printable("a" * 100, 10)
    'aaaa...aaa'
    """
    if len(text) > 2 * most:
        text = text[:most] + text[len(text) - most :]  # what lies between is cut below, and need not be written out
    text = "".join(c if c.isprintable() or c in " \n" else c.encode("unicode_escape").decode() for c in text)
    if len(text) > most:
        kept = max(most - 3, 0)
        text = f"{text[: kept - kept // 2]}...{text[len(text) - kept // 2 :]}"[:most]
    return text


def warn(message: str | Warning, category: type[Warning] | None = None) -> None:
    """Give a warning that names the line by which the library was called."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OURS):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def shown(value: object) -> str:
    """Return the representation of a value in a line of at most 80 characters."""
    return printable(" ".join(repr(value).split()))


def validate_kind(given: object, kind: type, what: str, made: str) -> None:
    """Raise `InputError` unless `given` is of class `kind`."""
    if not isinstance(given, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise InputError(f"{what}: expected {article} {kind.__name__}, {made}, got {shown(given)}")


class InputError(AdaptctlError, ValueError):
    """
    Error of a wrong argument of a function.

    Parameters
    ----------
    message : object, optional
        Name of the argument, its value, and what is right. Empty by default, as in any exception.

    Examples
    --------
    >>> arm.mass_matrix([0.0, 0.0, 0.0])
    Traceback (most recent call last):
    adaptctl.errors.InputError: two_link: p: expected shape (..., 2), got (3,)
    """


class FileError(InputError):
    """
    Error of an unusable file or folder.

    Parameters
    ----------
    message : object, optional
        Path of the file, wrong element, and what is right. Empty by default, as in any exception.

    Examples
    --------
    >>> adaptctl.load("missing.urdf")
    Traceback (most recent call last):
    adaptctl.errors.FileError: missing.urdf: cannot be read (no such file or directory)
    """


class NotFoundError(InputError, LookupError):
    """
    Error of an unknown name.

    Parameters
    ----------
    message : object, optional
        Unknown name, and the names that exist. Empty by default, as in any exception.

    Examples
    --------
    >>> try:
    ...     adaptctl.load("puma56")
    ... except adaptctl.NotFoundError as error:
    ...     print(str(error)[:49])
    unknown robot 'puma56' (did you mean 'puma560'?);
    """


class NonFiniteError(InputError):
    """
    Error of a number that is NaN or infinite.

    Examples
    --------
    >>> arm.energy([0.0, np.nan], [0.0, 0.0])
    Traceback (most recent call last):
    adaptctl.errors.NonFiniteError: two_link: p: expected finite numbers, got nan at index (1,)
    """


class VerdictError(InputError):
    """Error of gains or a controller that fail a check in simulation."""


class RankError(AdaptctlError):
    """
    Error of a rank that cannot be certified.

    Parameters
    ----------
    message : str
        Cause of the error in a sentence.
    singular_values : tuple of float, optional
        Scaled singular values without a unit, in descending order, of the matrix that decides the rank: P for the whole
        mechanism, or 11 for one joint. Empty by default, where the cause is another.

    Examples
    --------
    >>> adaptctl.RankError("no gap").singular_values
    ()
    """

    def __init__(self, message: str, singular_values: tuple[float, ...] = ()) -> None:
        super().__init__(message)
        self.singular_values = singular_values


class GainError(InputError):
    """
    Error of gains too large for the control period.

    Examples
    --------
    >>> try:
    ...     adaptctl.control.SlotineLi(model, 5.0, [9000.0, 9000.0])
    ... except adaptctl.errors.GainError as error:
    ...     print(str(error)[:62])
    two_link: damping is too stiff for a control period of 0.001 s
    """


class PhysicalConsistencyWarning(UserWarning):
    """Warning of inertial parameters that no rigid body can have."""


class StabilityWarning(UserWarning):
    """Warning of estimates that may destabilise an adaptive loop."""


class ReferenceWarning(UserWarning):
    """Warning of a reference that an arm cannot follow."""


class TuningWarning(UserWarning):
    """Warning of what limits gains that were chosen by rule, or what they assume."""


class TraceError(AdaptctlError, TypeError):
    """
    Error of an equation, such as a control law, that cannot be compiled.

    Examples
    --------
    >>> from adaptctl.compilation import trace
    >>> try:
    ...     trace(lambda x: x[0] if x[0] > 0.0 else -x[0], {"x": 1}, name="size")
    ... except adaptctl.errors.TraceError as error:
    ...     print(str(error)[:36])
    a traced value cannot be branched on
    """


class DivergedRunWarning(UserWarning):
    """Warning of a simulated run that its environment ended early, as where an error exceeds its limit."""


class NotCompiledWarning(UserWarning):
    """Warning that a simulation runs in Python, as its code cannot be compiled, and is slower."""


class SimplificationWarning(UserWarning):
    """Warning of an omitted, simplified or doubtful part of a robot file."""


class PlausibilityWarning(SimplificationWarning):
    """Warning of masses, inertias or torque limits of a file that no robot has, such as grams read as kg."""


class RoundedAnglesWarning(SimplificationWarning):
    """Warning that rounded angles of a robot are taken as right angles."""

    def __init__(self, finding: str, before: Any = None, after: Any = None) -> None:
        super().__init__(finding, before, after)
        self.finding, self.before, self.after = finding, before, after
        """What is rounded, and the robot's descriptions as the file writes it and as it is meant."""

    def __str__(self) -> str:
        return f"{self.finding}; as_written=True keeps them"


class LoopError(InputError):
    """Error of kinematic loops that cannot be closed or followed."""


class SingularityError(AdaptctlError):
    """Error of a kinematic loop at or near a singular configuration."""


class MissingExtraError(AdaptctlError, ImportError):
    """Error of missing optional packages."""


class LostSamplesWarning(UserWarning):
    """Warning that a `RunLogger` missed samples of a run."""


class LiveViewWarning(UserWarning):
    """Warning that a live view has ended or could not start, while the run goes on."""


def suggested_name(name: str, known: Iterable[str], least: float = 0.6) -> str:
    """Return a hint such as " (did you mean 'puma560'?)", or an empty text where no known name is similar."""
    from difflib import get_close_matches  # here, since only errors need it

    from adaptctl.renamed import new_name

    names = list(known)
    renamed = new_name(name, frozenset(names))
    close = [renamed] if renamed else get_close_matches(name, names, n=1, cutoff=least)
    return f" (did you mean {close[0]!r}?)" if close else ""
