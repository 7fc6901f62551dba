"""Why a rank can be trusted: its gap, its samples, and the other ways of finding it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import RankError
from adaptctl.identifiability.right_angles import NearRightAngle

SMALLEST_GAP = 1e6
SMALLEST_SINGULAR_VALUE = 1e-9
"""sigma_k/sigma_1 of the scaled energy differences"""
ROUND_OFF = 1e-14
"""Values beyond the gap above this, relative to sigma_1, are named: they are more than round-off."""
LISTED = 80


@dataclass(frozen=True)
class Leftover:
    """A singular value beyond the gap that is more than round-off, and the parameters it is made of."""

    value: float
    """relative to sigma_1"""
    parameters: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.value:.1e} ({', '.join(self.parameters)})"


@dataclass(frozen=True)
class Certificate:
    """The ranks found in three ways, and how clear-cut they are. All of the scaled matrices.

    `gap` is sigma_k/sigma_k+1 of the energy differences, `relative_smallest` sigma_k/sigma_1, both floored at
    1e-15 of sigma_1. `null_residual` is the largest torque that any null vector makes on other samples,
    relative to the largest that a vector of its size can make.
    Of a tree whose null space comes from its geometry, joint by joint, there is that rank in place of torques', and
    the rest is of the joint where it is worst: how energies change as bodies are taken from its link and given to the
    one before, and in `null_residual` how much they do for bodies that the joint does not feel.
    """

    rank_energy: int
    rank_doubled: int
    gap: float
    relative_smallest: float
    samples: int
    seed: int
    null_residual: float
    leftovers: tuple[Leftover, ...] = ()
    near_right_angles: tuple[NearRightAngle, ...] = ()
    rank_torque: int | None = None
    rank_geometry: int | None = None

    @property
    def rank(self) -> int:
        """The rank k."""
        return self.rank_energy

    @property
    def faults(self) -> tuple[str, ...]:
        """Why the rank cannot be accepted; empty when it can."""
        other, what = self._other
        ranks = (self.rank_energy, other, self.rank_doubled)
        wrong = {
            f"the gap at {self.rank} is {self.gap:.1e}, at least {SMALLEST_GAP:.0e} is needed": (
                self.gap < SMALLEST_GAP
            ),
            f"sigma_k/sigma_1 is {self.relative_smallest:.1e}, at least {SMALLEST_SINGULAR_VALUE:.0e} is needed": (
                self.relative_smallest < SMALLEST_SINGULAR_VALUE
            ),
            f"energies say {ranks[0]}, {what} {ranks[1]}, energies of twice as many samples {ranks[2]}": (
                len(set(ranks)) > 1
            ),
        }
        return tuple(text for text, holds in wrong.items() if holds)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is no fault but worth a look."""
        leftovers = [f"beyond the gap, {leftover} is more than round-off" for leftover in self.leftovers]
        return (*leftovers, *map(str, self.near_right_angles))

    def __str__(self) -> str:
        return (
            f"rank {self.rank} by the energies of {self.samples} and of {2 * self.samples} states and by "
            f"{self._other[1]}; "
            f"gap {self.gap:.1e}, sigma_k/sigma_1 {self.relative_smallest:.1e}"
        )

    @property
    def _other(self) -> tuple[int | None, str]:
        """The rank that is not found from energies, and where from."""
        if self.rank_geometry is not None:
            return self.rank_geometry, "geometry"
        return self.rank_torque, "torques"

    def require_accepted(self, mechanism: str, spectrum: Array, suspects: Sequence[object] = ()) -> None:
        """Raise RankError, with the spectrum and the suspects, unless the rank can be accepted."""
        if not self.faults:
            return
        hints = "".join(f"; {suspect}" for suspect in suspects)
        raise RankError(
            f"{mechanism}: the rank cannot be certified: {'; '.join(self.faults)}{hints}. "
            f"Scaled singular values over the largest: {_listing(spectrum / spectrum[0], self.rank)}",
            tuple(spectrum.tolist()),
        )


def leftovers(spectrum: Array, vectors: Array, rank: int, names: Sequence[str]) -> tuple[Leftover, ...]:
    """Singular values beyond the gap that are more than round-off, with what their vectors (columns) hold."""
    relative = spectrum / spectrum[0]
    beyond = [i for i in range(rank, len(spectrum)) if relative[i] > ROUND_OFF]
    return tuple(Leftover(float(relative[i]), _dominant(vectors[:, i], names)) for i in beyond)


def _dominant(vector: Array, names: Sequence[str], most: int = 4) -> tuple[str, ...]:
    size = np.abs(vector)
    largest = [int(i) for i in np.argsort(-size, kind="stable")[:most]]
    return tuple(names[i] for i in largest if size[i] > 0.1 * size.max())


def _listing(relative: Array, rank: int) -> str:
    """All values, or those about the gap where there are very many."""
    if len(relative) <= LISTED:
        return " ".join(f"{x:.1e}" for x in relative)
    first = max(0, rank - LISTED // 2)
    shown = relative[first : first + LISTED]
    return f"(from the {first + 1}th) " + " ".join(f"{x:.1e}" for x in shown)
