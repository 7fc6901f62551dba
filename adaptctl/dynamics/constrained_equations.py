"""Equations on fewer parameters, where relations among them are known: D = D0 + N z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.dynamics.tree_motion import TreeMotion
from adaptctl.scalars import Column, Scalar

if TYPE_CHECKING:
    from adaptctl.dynamics.loop_equations import LoopEquations
    from adaptctl.dynamics.loop_motion import LoopMotion


class RelatedMotion:
    """A motion, and what it means for the parameters that are left."""

    __slots__ = ("equations", "whole")

    def __init__(self, equations: RelatedEquations, whole: TreeMotion | LoopMotion) -> None:
        self.equations, self.whole = equations, whole

    def torque(self, parameters: Column) -> Column:
        """M a_r + C(p, v) v_r + g + friction, the known share with it."""
        return self.whole.torque(self.equations.expanded(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows of Y N, the asked columns only."""
        needed = self.equations.needed(columns)
        rows = self.whole.regressor(needed)
        return [self.equations.combined(dict(zip(needed, row, strict=True)), columns) for row in rows]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """(Y N)' s on the asked columns, without forming Y."""
        needed = self.equations.needed(columns)
        return self.equations.combined(dict(zip(needed, self.whole.powers(s, needed), strict=True)), columns)

    @property
    def numbers(self) -> Column:
        """All that the motion is, to remember it by."""
        return self.whole.numbers


@dataclass(frozen=True)
class RelatedEquations:
    """The equations of a mechanism in the parameters z that are left; parameter columns have their length.

    Regressors are those of z alone, N' times the whole ones; torques and accelerations include what is known,
    D0. Columns of N that are all zero but for a one cost nothing: the same parameter is then simply kept.
    """

    whole: TreeEquations | LoopEquations
    spread: tuple[tuple[tuple[int, float], ...], ...]
    """for every z, the parameters it enters and its weight there: N by columns"""
    known: tuple[float, ...]
    """D0"""

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return self.whole.dof

    @property
    def joints(self) -> int:
        """Number of tree joints n."""
        return self.whole.joints

    @property
    def links(self) -> tuple[Segment, ...]:
        """The tree's links."""
        return self.whole.links

    @property
    def parameters(self) -> int:
        """Number of parameters that are left."""
        return len(self.spread)

    def closed(self, p: Column, guess: Column) -> Column:
        """q = U(p), from a nearby configuration."""
        return self.whole.closed(p, guess)

    def projected(self, q: Column) -> Column:
        """One Newton step of the dependent joints."""
        return self.whole.projected(q)

    def rates(self, q: Column, v: Column) -> Column:
        """How the configuration moves."""
        return self.whole.rates(q, v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """E N: the energy of what is left, per unit of each."""
        return self._gathered(self.whole.energy_regressor(q, v).of)

    def potential_regressor(self, q: Column) -> Column:
        """The potential part of it."""
        return self._gathered(self.whole.potential_regressor(q).of)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> RelatedMotion:
        """How the links move, from which the torques M a_r + C(p, v) v_r + g + friction follow."""
        return RelatedMotion(self, self.whole.motion(q, v, v_r, a_r))

    def remembered(self, numbers: Column) -> RelatedMotion:
        """The motion that has these numbers."""
        return RelatedMotion(self, self.whole.remembered(numbers))

    @property
    def motion_size(self) -> int:
        """How many numbers a motion has."""
        return self.whole.motion_size

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Rows of Y N, the asked columns only."""
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g + friction, the known share with it."""
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Primary accelerations (r,) under primary torques."""
        return self.whole.forward_dynamics(q, v, torque, self.expanded(parameters))

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows of M(p)."""
        return self.whole.mass_matrix(q, self.expanded(parameters))

    def expanded(self, parameters: Column) -> Column:
        """D = D0 + N z (P,)."""
        terms: list[list[tuple[float, Any]]] = [[(1.0, x)] if x else [] for x in self.known]
        for z, enters in zip(parameters, self.spread, strict=True):
            for place, weight in enters:
                terms[place].append((weight, z))
        return Column(map(_sum, terms))

    @cached_property
    def _everything(self) -> range:
        return range(self.parameters)

    def needed(self, columns: Sequence[int]) -> list[int]:
        """The parameters that the asked ones enter, rising."""
        return sorted({place for column in columns for place, _ in self.spread[column]})

    def _gathered(self, entries: Sequence[Scalar]) -> Column:
        return self.combined(dict(enumerate(entries)), self._everything)

    def combined(self, entries: dict[int, Scalar], columns: Sequence[int]) -> Column:
        """The entries of the asked parameters, from those of the parameters they enter."""
        return Column(_sum([(weight, entries[place]) for place, weight in self.spread[c]]) for c in columns)


def _sum(terms: Sequence[tuple[float, Scalar]]) -> Scalar:
    shares = [entry if weight == 1.0 else weight * entry for weight, entry in terms]
    total: Any = shares[0] if shares else 0.0
    for share in shares[1:]:
        total = total + share
    return total
