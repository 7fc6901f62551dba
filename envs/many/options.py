"""Options of a reset, for many arms: one value for all, or one each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, numbers
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.simulation.effects import Payload


@dataclass(frozen=True)
class ArmOptions:
    """The options of k arms chosen among N.

    A value is for all N, or there are N of them: arrays with a leading axis, and lists or tuples of what is no array.
    """

    total: int
    arms: NDArray[np.int64]

    def numbers(self, values: ArrayLike, size: int, what: str) -> Array:
        """Rows (k, size). Raises `InputError` on a wrong shape, and `NonFiniteError`, which names the arm."""
        array = numbers(values, what)
        if array.shape not in ((), (size,), (self.total, size)):
            raise InputError(
                f"{what}: expected a number or shape ({size},), or ({self.total}, {size}) for the arms, "
                f"got shape {array.shape}"
            )
        rows = array[self.arms] if array.ndim == 2 else np.broadcast_to(array, (len(self.arms), size))
        if not np.isfinite(rows).all():
            k, entry = np.argwhere(~np.isfinite(rows))[0]
            raise NonFiniteError(f"{what}: expected finite numbers, got {rows[k, entry]} for arm {self.arms[k]}")
        return rows

    def each(self, values: Any, what: str) -> Sequence[Any]:
        """Values (k), of any kind. Raises `InputError` where there are neither one nor N."""
        if isinstance(values, np.ndarray) and values.ndim == 1:
            values = values.tolist()
        if not isinstance(values, list | tuple):
            return [values] * len(self.arms)
        if len(values) != self.total:
            raise InputError(f"{what}: expected one, or one for each of {self.total} arms, got {len(values)}")
        return [values[arm] for arm in self.arms.tolist()]

    def parameters(self, options: Mapping[str, Any], own: Array, link: int) -> Array:
        """True inertial parameters (k, P): those given or the mechanism's own, with what the link holds. Raises as
        `numbers` and `each` do, and `InputError`, which names the arm, for a payload that no body is."""
        rows = self.numbers(options.get("parameters", own), own.size, "parameters")
        if "payload" not in options:
            return rows
        held = self.each(options["payload"], "payload")
        tens: dict[int, Array] = {}
        for arm, given in zip(self.arms.tolist(), held, strict=True):
            if id(given) not in tens:
                tens[id(given)] = _payload(given, arm).added_to(np.zeros(own.size), link)
        return rows + np.array([tens[id(given)] for given in held])


def _payload(given: Any, arm: int) -> Payload:
    try:
        return Payload.of(given)
    except InputError as error:
        raise type(error)(f"arm {arm}: {error}") from error
