"""Energy differences of any number of states, kept as the triangle of their QR factors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability.numerical_rank import triangle


@dataclass(frozen=True, eq=False)
class EnergyFactor:
    """R of the energy differences H = Q R, which has H's singular values and right vectors.

    Blocks of rows are put under R and factored again (TSQR: Demmel, Grigori, Hoemmen and Langou 2012), so memory does
    not grow with the samples. Householder's R is right column by column: columns may as well be scaled afterwards.
    """

    triangle: Array
    """R (at most P, P)"""
    square_sums: Array
    """(P,): of the energies themselves, before differencing"""
    last: Array
    """(1, P): energies of the last state, from which the next one's are subtracted"""

    @classmethod
    def of(cls, blocks: Iterable[Array], before: EnergyFactor | None = None) -> EnergyFactor:
        """Of energies (samples, P) of successive states in blocks, after those that `before` holds."""
        factor = before
        for block in blocks:
            factor = cls._begun(block) if factor is None else factor.followed_by(block)
        if factor is None:
            raise ValueError("no states")
        return factor

    @classmethod
    def _begun(cls, energies: Array) -> EnergyFactor:
        return cls(triangle(np.diff(energies, axis=0)), np.square(energies).sum(axis=0), energies[-1:])

    def followed_by(self, energies: Array) -> EnergyFactor:
        """With the energies (samples, P) of states that follow."""
        rows = np.diff(energies, axis=0, prepend=self.last)
        squares = self.square_sums + np.square(energies).sum(axis=0)
        return EnergyFactor(triangle(np.vstack([self.triangle, rows])), squares, energies[-1:])
