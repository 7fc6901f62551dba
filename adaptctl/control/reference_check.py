"""A check of references: a law's proof takes a_d for the derivative of v_d, and v_d for that of p_d."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.errors import InputError, ReferenceWarning

TIMES, STEP = 41, 1e-4
"""how many times are looked at, and the step of central differences, s"""
ALLOWED = 0.05
"""of the largest derivative, at the median: a corner of a path here and there is none"""


def require_point(point: object) -> None:
    """Raise `InputError` unless `point`, the value that a reference trajectory returned, has the attributes p, v and a
    of a `ReferencePoint`: positions, velocities and accelerations. Their shapes are not checked."""
    if not all(hasattr(point, name) for name in ReferencePoint._fields):
        raise InputError(
            f"reference: expected it to return ReferencePoint(p, v, a), each (n, r) at times (n,), got a "
            f"{type(point).__name__}"
        )


def warn_of_derivatives(reference: Reference, names: Sequence[str], duration: float, stacklevel: int = 2) -> None:
    """Warn (`ReferenceWarning`) where a `reference`'s velocities or accelerations are not the derivatives of its
    positions and velocities, naming the r joints by their `names`, r texts. Derivatives are central differences at 41
    times within `duration` (s). A joint is named where the median, over these times, of the absolute difference is
    above 5 % of its largest derivative, plus 1e-6. At most one warning is given, and nothing is checked where the
    duration is below some 0.2 ms. `stacklevel` says which line the warning points to, as in `warnings.warn`: at 1 the
    call of this function, at 2, the default, the call of its caller. Raises `InputError` where the reference returns no
    `ReferencePoint`."""
    time = STEP + (duration - 2.0 * STEP) * (np.arange(TIMES) + 0.382) / TIMES
    if not time[0] < time[-1]:
        return
    before, now, after = points = [reference(time + shift) for shift in (-STEP, 0.0, STEP)]
    for point in points:
        require_point(point)
    for what, of, stated, low, high in (
        ("velocity", "position", now.v, before.p, after.p),
        ("acceleration", "velocity", now.a, before.v, after.v),
    ):
        wrong = _wrong(np.asarray(stated), (np.asarray(high) - np.asarray(low)) / (2.0 * STEP))
        if wrong:
            joints = ", ".join(names[j] if j < len(names) else f"{j}" for j in wrong)
            warnings.warn(
                f"reference: the {what} of {joints} is not the derivative of its {of}: the controller will follow "
                f"neither; give {type(reference).__name__} exact derivatives, or use `Spline` through its positions",
                ReferenceWarning,
                stacklevel=stacklevel + 1,
            )
            return


def _wrong(stated: Array, slope: Array) -> list[int]:
    """Indices of the joints whose stated derivatives (T, r) differ from those by finite differences."""
    scale = np.maximum(np.abs(stated), np.abs(slope)).max(axis=0)
    return np.flatnonzero(np.median(np.abs(stated - slope), axis=0) > ALLOWED * scale + 1e-6).tolist()
