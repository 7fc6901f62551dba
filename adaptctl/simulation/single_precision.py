"""Single precision: twice as many arms in a register, with 7 digits for 16; and the loops that cannot bear it."""

from __future__ import annotations

from collections.abc import Iterator

from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.dynamics.loops.single_precision import require_single_precision
from adaptctl.errors import InputError
from adaptctl.scalars import Tunable
from adaptctl.simulation.closed_loop import ClosedLoop

LONGEST = 2**24
"""Control periods that single precision can count."""


def require_single(loop: ClosedLoop, steps: int) -> None:
    """Raise `InputError` unless a closed loop can be simulated in single precision (float32) for so many `steps`,
    control periods. It cannot where that leaves the mechanism's kinematic loops open by more than 1e-5 m or rad; with
    an adaptation law whose internal state is a k x k matrix for k parameters, as its small eigenvalues would be lost;
    and for more than 2^24 periods, the most that it counts. Raises `LoopError`, a subclass of it, where loops cannot be
    closed."""
    require_single_precision(loop.plant.mechanism, "precision")
    for part in _parts(loop.controller):
        if isinstance(part, AdaptationLaw) and part.needs_double:
            kind = type(part).__name__
            raise InputError(f"precision: single precision loses the matrix in which {kind} forgets: use double")
    if steps > LONGEST:
        raise InputError(f"precision: single precision counts to {LONGEST} control periods, got {steps}: use double")


def _parts(law: Tunable) -> Iterator[Tunable]:
    """A law, and the laws that it is made of."""
    yield law
    for part in law.tunable_parts.values():
        yield from _parts(part)
