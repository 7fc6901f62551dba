"""Random numbers of many arms: each from a generator of its own, drawn in blocks."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from adaptctl.arrays import Array

BLOCK = 32
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
        self._blocks = np.empty((arms, BLOCK, width))
        self._used = np.full(arms, BLOCK)

    def seed(self, arm: int, seed: int) -> None:
        """Restart the stream of the arm of index `arm`, zero-based, from `seed`, an int of at least 0; nothing is
        returned. The generator is made when it is first needed, which raises Gymnasium's `Error` for another seed."""
        self._generators.pop(arm, None)
        self._seeds[arm], self._used[arm] = seed, BLOCK

    def generator(self, arm: int) -> np.random.Generator:
        """NumPy generator of the arm of index `arm`, zero-based, in the state after the rows that `normal` has drawn so
        far, as if they had been drawn one by one. What is drawn from it advances the arm's stream too. Raises
        Gymnasium's `Error` for a seed that is no int of at least 0."""
        if arm not in self._generators:
            self._generators[arm], self._seeds[arm] = seeding.np_random(self._seeds[arm])
        generator = self._generators[arm]
        if self._used[arm] < BLOCK:
            generator.bit_generator.state = self._before[arm]
            generator.standard_normal((self._used[arm], self._blocks.shape[2]))
            self._used[arm] = BLOCK
        return generator

    def normal(self, arms: NDArray[np.int64]) -> Array:
        """Standard normal random numbers (k, w), unitless: the next row of w numbers from the stream of each of the k
        arms of indices `arms` (k,), zero-based and all different. w is the `width` given at construction, and this call
        advances these arms' streams. The numbers are the same for the same seed of an arm. Indices are not checked;
        raises Gymnasium's `Error` where an arm's seed is no int of at least 0."""
        if self._blocks.shape[2] == 0:
            return np.empty((len(arms), 0))
        for arm in arms[self._used[arms] == BLOCK].tolist():
            generator = self.generator(arm)
            self._before[arm] = generator.bit_generator.state
            self._blocks[arm] = generator.standard_normal(self._blocks.shape[1:])
            self._used[arm] = 0
        draws = self._blocks[arms, self._used[arms]]
        self._used[arms] += 1
        return draws
