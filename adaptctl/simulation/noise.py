"""Noise of the sensors of many arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, whole_count

Seeds: TypeAlias = int | Sequence[int] | NDArray[np.object_] | None
"""One seed for all arms, one for each, or None for another noise each time."""


def checked_seeds(given: object) -> Seeds:
    """The seeds `given` of many arms' noise: None, a whole number of at least 0, or, made of a list or array of such
    numbers, an array of them of the same shape. Raises `InputError` for all else, such as 2.0, texts and booleans."""
    if given is None:
        return None
    each = np.asarray(given, dtype=np.object_)
    for seed in each.flat:
        whole_count(seed, "seed")
    return each if each.ndim else int(each[()])


@dataclass(frozen=True, eq=False)
class Noise:
    """Source of sensor noise for M arms: independent standard normal numbers, without a unit, `size` of them for each
    arm in a control period. `generators` has one random generator for all arms, or one for each; `members` is M.
    Nothing is checked."""

    generators: Sequence[np.random.Generator]
    members: int
    size: int

    @classmethod
    def of(cls, seed: Seeds, members: int, herd: int, size: int) -> list[Noise]:
        """Sources of sensor noise for `members` arms, a list with one `Noise` for each group of at most `herd` arms, in
        the arms' order; an arm takes `size` numbers in a control period. `seed` is one whole number for all arms, None
        for another noise each time, or a sequence of one for each arm, whose noise then does not depend on the other
        arms; the same seeds give the same noise. Raises `ValueError` for a seed below 0 and, where `size` is not 0, for
        a sequence of another length, but for length 1, which gives every arm the same noise."""
        counts = [min(herd, members - first) for first in range(0, members, herd)]
        if seed is None or isinstance(seed, int | np.integer):
            root = np.random.SeedSequence(None if seed is None else int(seed))
            sources = [root, *root.spawn(len(counts) - 1)]
            return [cls([np.random.default_rng(x)], n, size) for x, n in zip(sources, counts, strict=True)]
        each = [np.random.default_rng(int(x)) for x in np.broadcast_to(np.asarray(seed), (members,))] if size else []
        return [cls(each[k * herd : k * herd + n], n, size) for k, n in enumerate(counts)]

    def drawn(self, steps: int) -> Array:
        """Standard normal numbers (steps, M, size), without a unit, of the next `steps` control periods of M arms,
        `size` for each arm in a period. Each call draws new ones, the same sequence for the same seeds. Raises
        `ValueError` for `steps` below 0."""
        if self.size == 0:
            return np.zeros((steps, self.members, 0))
        if len(self.generators) == 1:
            return self.generators[0].standard_normal((steps, self.members, self.size))
        return np.stack([rng.standard_normal((steps, self.size)) for rng in self.generators], axis=1)
