"""Refusals of equations that cannot be traced: the reason, and the line."""

from __future__ import annotations

import linecache
import sys
from itertools import takewhile
from types import FrameType

from adaptctl.errors import TraceError

_TRACER = "adaptctl.compilation.routine"
_SCALARS = ("adaptctl.compilation.", "adaptctl.scalars.", "numpy.")


def untraceable(why: str) -> TraceError:
    """Error, a `TraceError` to be raised, for what a traced function cannot do: its message is the reason `why`,
    followed by file, number and text of the line to change. That is, of the calls under way, the nearest line that is
    not the library's own, or else the nearest of the library's equations. The message is the reason alone where there
    is neither. Nothing is raised here."""
    from traceback import walk_stack  # here, since only errors need it

    traced = takewhile(lambda at: _module(at) != _TRACER, walk_stack(sys._getframe(1)))
    lines = [at for at in traced if not _module(at).startswith(_SCALARS)]
    if not lines:
        return TraceError(why)
    frame, line = next((at for at in lines if not _module(at).startswith("adaptctl.")), lines[0])
    file = frame.f_code.co_filename
    return TraceError(f"{why} ({file}:{line}: {linecache.getline(file, line).strip()})")


def _module(at: tuple[FrameType, int]) -> str:
    return str(at[0].f_globals.get("__name__", ""))
