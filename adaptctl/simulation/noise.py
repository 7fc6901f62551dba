"""Noise of the sensors of many arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array


@dataclass(frozen=True, eq=False)
class Noise:
    """Source of sensor noise: standard normal numbers, `size` of them a control period for each of M arms, from one
    generator for all or one for each."""

    generators: Sequence[np.random.Generator]
    members: int
    size: int

    @classmethod
    def of(cls, seed: int | Sequence[int] | None, members: int, herd: int, size: int) -> list[Noise]:
        """Noise of arms in herds of at most `herd`, from one seed for all or one for each arm."""
        counts = [min(herd, members - first) for first in range(0, members, herd)]
        if seed is None or isinstance(seed, int | np.integer):
            root = np.random.SeedSequence(None if seed is None else int(seed))
            sources = [root, *root.spawn(len(counts) - 1)]
            return [cls([np.random.default_rng(x)], n, size) for x, n in zip(sources, counts, strict=True)]
        each = [np.random.default_rng(int(x)) for x in np.broadcast_to(np.asarray(seed), (members,))] if size else []
        return [cls(each[k * herd : k * herd + n], n, size) for k, n in enumerate(counts)]

    def drawn(self, steps: int) -> Array:
        """The numbers (steps, M, size) of the next control periods."""
        if self.size == 0:
            return np.zeros((steps, self.members, 0))
        if len(self.generators) == 1:
            return self.generators[0].standard_normal((steps, self.members, self.size))
        return np.stack([rng.standard_normal((steps, self.size)) for rng in self.generators], axis=1)
