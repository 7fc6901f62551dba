"""Exceptions and warnings, with messages that a person can act on."""

from __future__ import annotations

LONGEST_MESSAGE = 2_000
"""Characters of an error's message; what is cut is a name that somebody made long."""


class AdaptctlError(Exception):
    """Base of every error this package raises on purpose. Its message shows control characters, and sends none."""

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message), LONGEST_MESSAGE))


def printable(text: str, most: int = 80) -> str:
    """The text with control characters written out, such as \\x1b, and cut in its middle above `most` characters.

    Names come from files of strangers, and a terminal would obey what is in them.
    """
    if len(text) > most:
        text = f"{text[: most // 2]}...{text[-(most // 2) :]}"
    return "".join(c if c.isprintable() or c in " \n" else c.encode("unicode_escape").decode() for c in text)


class InputError(AdaptctlError, ValueError):
    """The caller's input is wrong: the message names the element, what it was, and what would be right."""


class FileError(InputError):
    """A file cannot be used: the message names the file, the element in it, and what would be right."""


class NotFoundError(InputError, LookupError):
    """A name is unknown: the message lists the names that exist."""


class NonFiniteError(InputError):
    """A number is NaN or infinite where a finite one is needed."""


class RankError(AdaptctlError):
    """The rank of an energy matrix cannot be certified; `singular_values` holds the spectrum."""

    def __init__(self, message: str, singular_values: tuple[float, ...] = ()) -> None:
        super().__init__(message)
        self.singular_values = singular_values


class GainError(InputError):
    """The gains cannot be carried by the sampling period."""


class PhysicalConsistencyWarning(UserWarning):
    """Links have inertial parameters that no rigid body can have."""


class StabilityWarning(UserWarning):
    """Warning of a cause that may make a loop ring which its gains alone would not."""


class ReferenceWarning(UserWarning):
    """A reference's accelerations or velocities are not the derivatives that a controller takes them for."""


class TraceError(AdaptctlError, TypeError):
    """An equation cannot be traced: it asks for a number that is not known yet, or does what no node can."""


class NotCompiledWarning(UserWarning):
    """Warning that a run which could have been one call of native code goes step by step in Python: the message says
    why."""


class SimplificationWarning(UserWarning):
    """Warning that a part of a file or a model is left out or simplified."""


class LoopError(InputError):
    """Loops that cannot be: they do not close, they lock, or the primary joints do not fit them."""


class SingularityError(AdaptctlError):
    """A loop is at or near a configuration where its primary joints no longer determine the others."""


class MissingExtraError(AdaptctlError, ImportError):
    """Error of a function that needs packages which are not installed: the message has the command that installs
    them."""


class LostSamplesWarning(UserWarning):
    """A log has not kept all samples it was given."""


class LiveViewWarning(UserWarning):
    """A live view is not, or no longer, to be seen; what it shows goes on."""
