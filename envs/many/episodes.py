"""Options of a reset, for many arms: one value for all, or one each."""

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
    """Reader of the options of a reset for k arms chosen among N: it takes each option's values of the chosen arms from
    one value for all arms, or from N of them, an array with a leading axis of N, a list or a tuple. `total` is N,
    `arms` (k,) are the chosen arms' indices, zero-based. Nothing is checked at construction."""

    total: int
    arms: NDArray[np.int64]

    def numbers(self, values: ArrayLike, size: int, what: str) -> Array:
        """Values (k, `size`) of an option of a reset, such as initial errors of `size` joints, a row for each of the k
        chosen arms. They are taken from `values`: one number, `size` of them for all arms, or (N, `size`), a row for
        each of all N arms; the unit is the option's. `what` is the option's name in messages. Raises `InputError` for
        another shape and for entries that are no numbers, `NonFiniteError`, naming the arm, on NaN and infinity in the
        chosen rows."""
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
        """Values of an option, of any kind, one for each of the k chosen arms, from `values`: a list, a tuple or an
        array (N,), one for each of all N arms, or else one value for all. `what` is the option's name in messages.
        Raises `InputError` for a list, tuple or array whose length is not N."""
        if isinstance(values, np.ndarray) and values.ndim == 1:
            values = values.tolist()
        if not isinstance(values, list | tuple):
            return [values] * len(self.arms)
        if len(values) != self.total:
            raise InputError(f"{what}: expected one, or one for each of {self.total} arms, got {len(values)}")
        return [values[arm] for arm in self.arms.tolist()]

    def parameters(self, options: Mapping[str, Any], own: Array, link: int) -> Array:
        """True inertial and friction parameters (k, P), SI units, of the k chosen arms among N, in the order of
        `Mechanism.parameter_names`. They are the option `parameters`, P numbers for all arms or (N, P), or else the
        mechanism's `own` (P,), with the option `payload` added to the body of index `link`, from 0. A payload, one for
        all or a list, tuple or array of N, is a mass in kg at the origin of that body's frame, a `Payload`, or a
        mapping with `mass`, kg, `center` (3,), m, in that frame, and `inertia` (3, 3), kg m^2, about that centre along
        that frame's axes.

        `options` maps names to values; other entries are ignored. Raises `InputError` on a wrong shape, for another
        number of payloads than one or N, and, naming the arm, for what is no payload (its subclass `NotFoundError` for
        an unknown entry of a payload); `NonFiniteError`, naming the arm, for parameters that are not finite.
        """
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


DRAWS = 32
"""Draws made at once: a generator's call costs more than its numbers."""


class ArmStreams:
    """Streams of standard normal random numbers for many arms: each of `arms` arms has a NumPy generator of its own,
    from which rows of `width` numbers are drawn.

    Rows are drawn in blocks, which is faster; the numbers are those that single draws would give, the same for the same
    seed. An arm without a seed gets a random one. Nothing is checked at construction.
    """

    def __init__(self, arms: int, width: int) -> None:
        self._seeds: list[int | None] = [None] * arms
        self._generators: dict[int, np.random.Generator] = {}
        self._before: dict[int, Any] = {}
        """the generators' states before their blocks"""
        self._blocks = np.empty((arms, DRAWS, width))
        self._used = np.full(arms, DRAWS)

    def seed(self, arm: int, seed: int) -> None:
        """Restart the stream of the arm of index `arm`, zero-based, from `seed`, an int of at least 0; nothing is
        returned. The generator is made when it is first needed, which raises Gymnasium's `Error` for another seed."""
        self._generators.pop(arm, None)
        self._seeds[arm], self._used[arm] = seed, DRAWS

    def generator(self, arm: int) -> np.random.Generator:
        """NumPy generator of the arm of index `arm`, zero-based, in the state after the rows that `normal` has drawn so
        far, as if they had been drawn one by one. What is drawn from it advances the arm's stream too. Raises
        Gymnasium's `Error` for a seed that is no int of at least 0."""
        if arm not in self._generators:
            self._generators[arm], self._seeds[arm] = seeding.np_random(self._seeds[arm])
        generator = self._generators[arm]
        if self._used[arm] < DRAWS:
            generator.bit_generator.state = self._before[arm]
            generator.standard_normal((self._used[arm], self._blocks.shape[2]))
            self._used[arm] = DRAWS
        return generator

    def normal(self, arms: NDArray[np.int64]) -> Array:
        """Standard normal random numbers (k, w), unitless: the next row of w numbers from the stream of each of the k
        arms of indices `arms` (k,), zero-based and all different. w is the `width` given at construction, and this call
        advances these arms' streams. The numbers are the same for the same seed of an arm. Indices are not checked;
        raises Gymnasium's `Error` where an arm's seed is no int of at least 0."""
        if self._blocks.shape[2] == 0:
            return np.empty((len(arms), 0))
        for arm in arms[self._used[arms] == DRAWS].tolist():
            generator = self.generator(arm)
            self._before[arm] = generator.bit_generator.state
            self._blocks[arm] = generator.standard_normal(self._blocks.shape[1:])
            self._used[arm] = 0
        draws = self._blocks[arms, self._used[arms]]
        self._used[arms] += 1
        return draws
