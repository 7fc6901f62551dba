"""Exceptions and warnings, with messages that a person can act on."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST_MESSAGE = 2_000
"""Characters of an error's message; what is cut is a name that somebody made long."""


class AdaptctlError(Exception):
    """Base class of every error that this package raises on purpose, made of its `message`, empty by default: the
    control characters in it are written out, so that no terminal obeys them, and a message that then has more than
    LONGEST_MESSAGE (2000) characters is cut in its middle to that many."""

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message), LONGEST_MESSAGE))


def printable(text: str, most: int = 80) -> str:
    """The `text` with each character that does not print, such as a control character, replaced by its escape sequence,
    such as \\x1b; spaces and line breaks stay. What is then longer than `most` characters (a whole number of at least
    0, 80 by default) is cut in its middle to `most`, with "..." in place of what is left out.

    Names come from files of strangers, and a terminal would obey what is in them. Nothing is checked.
    """
    if len(text) > 2 * most:
        text = text[:most] + text[len(text) - most :]  # what lies between is cut below, and need not be written out
    text = "".join(c if c.isprintable() or c in " \n" else c.encode("unicode_escape").decode() for c in text)
    if len(text) > most:
        kept = max(most - 3, 0)
        text = f"{text[: kept - kept // 2]}...{text[len(text) - kept // 2 :]}"[:most]
    return text


def validate_kind(given: object, kind: type, what: str, made: str) -> None:
    """Raise `InputError` unless `given` is an object of the class `kind`."""
    if not isinstance(given, kind):
        raise InputError(f"{what}: expected a {kind.__name__}, {made}, got {printable(repr(given))}")


class InputError(AdaptctlError, ValueError):
    """Error of a caller's input, such as one of a wrong shape, kind or range: the message names the element, what it
    was, and what would be right. It is a `ValueError` too."""


class FileError(InputError):
    """Error of a file or folder that cannot be read, written or used: the message names the file, the element in it
    that is wrong, if one is, and what would be right."""


class NotFoundError(InputError, LookupError):
    """Error of an unknown name, such as of a robot, link, parameter or run: the message lists the names that exist, or
    the nearest of them. It is a `LookupError` too."""


class NonFiniteError(InputError):
    """Error of a number that is NaN or infinite where a finite one is needed."""


class VerdictError(InputError):
    """Error of gains or of a controller that fail in simulation."""


class RankError(AdaptctlError):
    """Error raised where the rank k of a mechanism's energy regressor, the number of its independent (identifiable)
    inertial parameters, cannot be certified; `message` says why.

    `singular_values`, a tuple of floats in descending order, no unit, are those of the matrix of energy differences
    whose rows are for pairs of successive random states and whose columns, scaled, are for the P inertial parameters.
    It has P values, or where a tree's rank was found joint by joint the 11 of the joint with the smallest gap between
    them, for its link's ten parameters and its rotor inertia. It is empty, the default, where the cause is another,
    such as a fundamental (base parameter) basis of another rank, or angles between joint axes that are nearly, but not
    exactly, right angles.
    """

    def __init__(self, message: str, singular_values: tuple[float, ...] = ()) -> None:
        super().__init__(message)
        self.singular_values = singular_values


class GainError(InputError):
    """Error of feedback gains that are too large for the control period."""


class PhysicalConsistencyWarning(UserWarning):
    """Warning, on loading a robot, of links whose ten inertial parameters (mass, first moments, inertia) no rigid body
    can have: their pseudo-inertia matrix (4, 4) has a negative eigenvalue, beyond 1e-12 of the largest. The message
    names the links."""


class StabilityWarning(UserWarning):
    """Warning that parameter estimates, while they adapt, may make an adaptive control loop ring (oscillate) whose
    gains alone would not. Laws such as `SlotineLi` give it at construction where estimates within the law's `prior`
    (their greatest distances from the initial estimate) could bring the sampling ratio to 2 or more: the control period
    times the largest eigenvalue of M^-1 K, no unit, with the mass matrix M and the velocity feedback K."""


class ReferenceWarning(UserWarning):
    """Warning of a reference motion that an arm cannot follow as stated."""


class TraceError(AdaptctlError, TypeError):
    """Error of an equation, such as a control law, that cannot be traced into an expression graph for compilation."""


class NotCompiledWarning(UserWarning):
    """Warning of `simulate` that a run which could have been one call of native code goes step by step in Python, which
    is slower: the message says why."""


class SimplificationWarning(UserWarning):
    """Warning that a part of a robot's file or model is left out or simplified on reading it, such as springs of
    joints, or that self-collision is not checked; the message says what and of which elements."""


class LoopError(InputError):
    """Error of a mechanism's closed kinematic loops that do not close at the reference configuration, are redundant,
    are singular there or leave the mechanism no motion, or of primary (independent) joints that do not determine the
    others. It is raised on loading, or when the mechanism first computes; the message names the closure or the
    joints."""


class SingularityError(AdaptctlError):
    """Error of a kinematic loop at or near a configuration where its primary joints no longer determine the others."""


class MissingExtraError(AdaptctlError, ImportError):
    """Error of a function that needs packages which are not installed."""


class LostSamplesWarning(UserWarning):
    """Warning of a `RunLogger`, when its `with` block ends, that its log has not kept all samples it was given."""


class LiveViewWarning(UserWarning):
    """Warning that a live view (`Live`) cannot be shown, its viewer being out of reach, or that it has ended."""


def suggested_name(name: str, known: Iterable[str], least: float = 0.6) -> str:
    """Hint for an error message, such as " (did you mean 'puma560'?)", with the one of the `known` names that is
    nearest to the unknown `name`; the empty text where none is near. A name is near from a similarity of `least` on,
    0.6 by default, as `difflib` measures it, from 0 to 1. Nothing is checked."""
    from difflib import get_close_matches  # here, since only errors need it

    from adaptctl.renamed import new_name

    names = list(known)
    renamed = new_name(name, frozenset(names))
    close = [renamed] if renamed else get_close_matches(name, names, n=1, cutoff=least)
    return f" (did you mean {close[0]!r}?)" if close else ""
