"""Exceptions and warnings, with messages that a person can act on."""

from __future__ import annotations

LONGEST_MESSAGE = 2_000
"""Characters of an error's message; what is cut is a name that somebody made long."""


class AdaptctlError(Exception):
    """Base class of every error that this package raises on purpose. Control characters in its message are written out,
    so that no terminal obeys them, and a message over LONGEST_MESSAGE (2000) characters is cut."""

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message), LONGEST_MESSAGE))


def printable(text: str, most: int = 80) -> str:
    """The `text` with control characters written out, such as \\x1b, and cut in its middle above `most` characters.

    Names come from files of strangers, and a terminal would obey what is in them. Spaces and line breaks stay.
    """
    if len(text) > most:
        text = f"{text[: most // 2]}...{text[-(most // 2) :]}"
    return "".join(c if c.isprintable() or c in " \n" else c.encode("unicode_escape").decode() for c in text)


class InputError(AdaptctlError, ValueError):
    """Error of a caller's input: the message names the element, what it was, and what would be right."""


class FileError(InputError):
    """Error of a file that cannot be used: the message names the file, the element in it, and what would be right."""


class NotFoundError(InputError, LookupError):
    """Error of an unknown name: the message lists the names that exist."""


class NonFiniteError(InputError):
    """Error of a number that is NaN or infinite where a finite one is needed."""


class RankError(AdaptctlError):
    """Error of an energy matrix whose rank cannot be certified; `singular_values` holds its spectrum, empty where that
    has no part in it."""

    def __init__(self, message: str, singular_values: tuple[float, ...] = ()) -> None:
        super().__init__(message)
        self.singular_values = singular_values


class GainError(InputError):
    """Error of feedback gains that are too large for the control period: the sampled loop could ring or be unstable."""


class PhysicalConsistencyWarning(UserWarning):
    """Warning of links with inertial parameters that no rigid body can have."""


class StabilityWarning(UserWarning):
    """Warning of a cause, such as estimates far off, that may make a control loop ring (oscillate) whose gains alone
    would not."""


class ReferenceWarning(UserWarning):
    """Warning of a reference whose velocities or accelerations are not derivatives of its positions."""


class TraceError(AdaptctlError, TypeError):
    """Error of an equation that cannot be traced into an expression graph: it asks for a number that is not known yet,
    or does what no symbolic scalar can."""


class NotCompiledWarning(UserWarning):
    """Warning that a run which could have been one call of native code goes step by step in Python, which is slower:
    the message says why."""


class SimplificationWarning(UserWarning):
    """Warning that a part of a file or a model is left out or simplified."""


class LoopError(InputError):
    """Error of kinematic loops that do not close, are redundant or lock the mechanism, or of primary joints that do not
    determine them."""


class SingularityError(AdaptctlError):
    """Error of a kinematic loop at or near a configuration where its primary joints no longer determine the others."""


class MissingExtraError(AdaptctlError, ImportError):
    """Error of a function that needs packages which are not installed: the message has the command that installs
    them."""


class LostSamplesWarning(UserWarning):
    """Warning that a log has not kept all samples it was given; the message has their number."""


class LiveViewWarning(UserWarning):
    """Warning that a live view cannot be shown, or no longer; the control loop that it shows goes on."""
