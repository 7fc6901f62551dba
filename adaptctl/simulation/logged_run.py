"""Runs made of arrays that were logged elsewhere: checked, and completed with what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen, numbers, positive_number
from adaptctl.errors import InputError


def logged_run(
    p: ArrayLike,
    torque: ArrayLike,
    reference_p: ArrayLike,
    control_period: float,
    given: Mapping[str, ArrayLike | None],
    estimate: ArrayLike | None,
    time: ArrayLike | None,
    complete: bool,
) -> dict[str, Any]:
    """The fields, by name, of the `Rollout` of a run of r joints that was logged elsewhere: T samples, at least 2, one
    a `control_period` (s), as read-only copies, with what follows from them.

    (T, r): positions `p` and `reference_p`, rad (m if prismatic), and `torque`, the one commanded, N m (N). `given`
    maps "v", "reference_v", "reference_a" (SI units) and "applied" (N m, N), the torques at the joints, to arrays (T,
    r) or None: a derivative that is None is computed by differences of the positions or velocities, central but at both
    ends, and an `applied` that is None is `torque`. `estimate` (T, k), SI units, has k parameter estimates, None for k
    = 0; `time` (T,), s, counts periods from zero where None; `complete` is False for a run that was cut off. Energies
    are NaN, rewards and wall time 0, and "clipped" is 1 where a sample's `applied` is not `torque`.

    Raises `InputError` for shapes that do not fit, arrays of no numbers, a period that is not positive and finite, and
    times that do not increase, `NonFiniteError` for NaN and infinity.
    """
    period = positive_number(control_period, "control_period: expected a positive time in s")
    p = numbers(p, "p")
    shape = p.shape
    if len(shape) != 2 or shape[0] < 2 or shape[1] < 1:
        raise InputError(f"p: expected shape (T, r) with T of at least 2, got {shape}")
    arrays = {"p": p, "torque": torque, "reference_p": reference_p}
    arrays |= {name: values for name, values in given.items() if values is not None}
    known = {name: _table(values, name, shape) for name, values in arrays.items()}
    known.setdefault("v", _rates(known["p"], period))
    known.setdefault("reference_v", _rates(known["reference_p"], period))
    known.setdefault("reference_a", _rates(known["reference_v"], period))
    known.setdefault("applied", known["torque"])
    count = shape[0]
    estimates = np.empty((count, 0)) if estimate is None else numbers(estimate, "estimate")
    if estimates.ndim != 2:
        raise InputError(f"estimate: expected shape ({count}, k), got {estimates.shape}")
    estimates = _table(estimates, "estimate", (count, estimates.shape[1]))
    kept = {name: frozen(values.copy()) for name, values in known.items()}
    return kept | {
        "time": frozen(_times(time, count, period)),
        "clipped": frozen((known["applied"] != known["torque"]).any(axis=1).astype(np.float64)),
        "energy": frozen(np.full(count, np.nan)),
        "reward": frozen(np.zeros(count)),
        "estimate": frozen(estimates.copy()),
        "control_period": period,
        "wall_time": 0.0,
        "complete": complete,
    }


def _table(values: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    array = checked(np.atleast_2d(numbers(values, name)), shape[-1], name)
    if array.shape != shape:
        raise InputError(f"{name}: expected shape {shape}, got {array.shape}")
    return np.asarray(array, dtype=np.float64)


def _rates(values: Array, period: float) -> Array:
    """Central differences, one-sided at the ends."""
    return np.asarray(np.gradient(values, period, axis=0), dtype=np.float64)


def _times(time: ArrayLike | None, count: int, period: float) -> Array:
    if time is None:
        return np.asarray(period * np.arange(count), dtype=np.float64)
    times = np.asarray(checked(time, count, "time"), dtype=np.float64)
    if times.shape != (count,) or np.any(np.diff(times) <= 0.0):
        raise InputError(f"time: expected {count} increasing numbers, s")
    return times
