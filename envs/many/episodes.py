"""Options of a reset for many arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, numbers
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.simulation.effects import Payload


@dataclass(frozen=True)
class ArmOptions:
    """Options of k chosen arms."""

    total: int
    arms: NDArray[np.int64]

    def numbers(self, values: ArrayLike, size: int, what: str) -> Array:
        """Numbers (k, size) of an option."""
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
        """Values of an option by arm."""
        if isinstance(values, np.ndarray) and values.ndim == 1:
            values = values.tolist()
        if not isinstance(values, list | tuple):
            return [values] * len(self.arms)
        if len(values) != self.total:
            raise InputError(f"{what}: expected one, or one for each of {self.total} arms, got {len(values)}")
        return [values[arm] for arm in self.arms.tolist()]

    def parameters(self, options: Mapping[str, Any], own: Array, link: int) -> Array:
        """True parameters (k, P)."""
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


DRAWN_ROWS = 32
"""Rows drawn at once."""


class ArmStreams:
    """Random numbers, one stream per arm."""

    def __init__(self, arms: int, width: int) -> None:
        self._seeds: list[int | None] = [None] * arms
        self._generators: dict[int, np.random.Generator] = {}
        self._before: dict[int, Any] = {}
        """states before the current blocks"""
        self._blocks = np.empty((arms, DRAWN_ROWS, width))
        self._used = np.full(arms, DRAWN_ROWS)

    def seed(self, arm: int, seed: int) -> None:
        """Restart a stream."""
        self._generators.pop(arm, None)
        self._seeds[arm], self._used[arm] = seed, DRAWN_ROWS

    def generator(self, arm: int) -> np.random.Generator:
        """Generator of an arm after the rows drawn so far."""
        if arm not in self._generators:
            self._generators[arm], self._seeds[arm] = seeding.np_random(self._seeds[arm])
        generator = self._generators[arm]
        if self._used[arm] < DRAWN_ROWS:
            generator.bit_generator.state = self._before[arm]
            generator.standard_normal((self._used[arm], self._blocks.shape[2]))
            self._used[arm] = DRAWN_ROWS
        return generator

    def normal(self, arms: NDArray[np.int64]) -> Array:
        """Next row (k, w) of standard normal numbers."""
        if self._blocks.shape[2] == 0:
            return np.empty((len(arms), 0))
        for arm in arms[self._used[arms] == DRAWN_ROWS].tolist():
            generator = self.generator(arm)
            self._before[arm] = generator.bit_generator.state
            self._blocks[arm] = generator.standard_normal(self._blocks.shape[1:])
            self._used[arm] = 0
        draws = self._blocks[arms, self._used[arms]]
        self._used[arms] += 1
        return draws
