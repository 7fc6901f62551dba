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
    """Streams of random numbers: a generator for each arm, and rows of `width` standard normal numbers from it, one a
    draw.

    The numbers are those that each generator gives one draw after the other, and `generator` is where that would be.
    """

    def __init__(self, arms: int, width: int) -> None:
        self._seeds: list[int | None] = [None] * arms
        self._generators: dict[int, np.random.Generator] = {}
        self._before: dict[int, Any] = {}
        """the generators' states before their blocks"""
        self._blocks = np.empty((arms, BLOCK, width))
        self._used = np.full(arms, BLOCK)

    def seed(self, arm: int, seed: int) -> None:
        """Restart an arm's generator from a seed. It is made when it is first needed."""
        self._generators.pop(arm, None)
        self._seeds[arm], self._used[arm] = seed, BLOCK

    def generator(self, arm: int) -> np.random.Generator:
        """The arm's generator, as it is after the draws made so far."""
        if arm not in self._generators:
            self._generators[arm], self._seeds[arm] = seeding.np_random(self._seeds[arm])
        generator = self._generators[arm]
        if self._used[arm] < BLOCK:
            generator.bit_generator.state = self._before[arm]
            generator.standard_normal((self._used[arm], self._blocks.shape[2]))
            self._used[arm] = BLOCK
        return generator

    def normal(self, arms: NDArray[np.int64]) -> Array:
        """Standard normal numbers (k, width), one draw of each of some arms."""
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
