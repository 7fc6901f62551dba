"""The rank of a mechanism's energies on exact geometry, and the parameters that an order of removal leaves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.proof import elimination, pivots
from adaptctl.identifiability.proof.digits import BITS, digits, scaled
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry, Reading
from adaptctl.identifiability.proof.field_energies import energy_changes, energy_differences
from adaptctl.identifiability.proof.joint_frames import CanonicalFrames, canonical_frames
from adaptctl.identifiability.proof.near_geometry import as_equal, loop_lengths
from adaptctl.identifiability.proof.prime_field import PRIME, modular, residue
from adaptctl.identifiability.proof.simplest import AS_GIVEN, AS_MEANT, Precision, simplest_rational
from adaptctl.identifiability.sampling import characteristic_length, random_states

FIELD, DIGITS = "a prime field", "60 digits"
SPARE = 5
"""Rows more than a rank can be: all of them would have to be unlucky at once, one time in 2^31 each."""


@dataclass(frozen=True, eq=False)
class ExactEnergies:
    """The energies of a mechanism at random states, computed without round-off on its geometry as exact numbers, so
    that ranks are proved by them.

    `precision` has the differences of angles, lengths and numbers that count as zero, round-off by default; `seed`, 0
    by default, draws the states, the same for the same seed. For closed loops, `strict` is True where relations that
    hold only to a file's round-off do not count as holding, False by default. `by_frames` is True for a geometry
    described from frame to frame, as in the file, and False, the default, for one from joint axis to joint axis.
    Nothing is checked at construction.

    Without closed loops, energies are residues modulo the prime 2^31 - 1. A rank modulo a prime is never above that
    over the rational numbers, and at random states below it only by a chance of about one in 2^31 for each factor of a
    minor (Schwartz 1980, Zippel 1979). With closed loops they are numbers of 60 decimal digits.
    """

    mechanism: Mechanism
    precision: Precision = AS_GIVEN
    seed: int = 0
    strict: bool = False
    """True where relations that hold to a file's round-off alone, in closed loops, do not count."""
    by_frames: bool = False
    """True for geometry from frame to frame, as in the file; else from axis to axis."""

    @property
    def method(self) -> str:
        """The name of the arithmetic in which the energies are computed: "60 digits" for closed loops, "a prime field"
        for other mechanisms."""
        return DIGITS if self.closed else FIELD

    @cached_property
    def rank(self) -> int:
        """The rank on exact geometry: the number of independent directions of the mechanism's inertial parameters (all
        but friction) that change energies. May raise `ArithmeticError` where loops cannot be closed on the exact
        geometry, as with a coarse `precision`."""
        description = self.mechanism.description
        plain = description.loops is None and len(description.bodies) == len(description.links)
        if plain and self.mechanism.unconstrained is self.mechanism:
            # Of a tree, it is the sum of what its joints feel (Wensing, Niemeyer and Slotine 2017).
            return sum(elimination.ranks(energy_changes(description, self.geometry, 11 + SPARE, self.seed)))
        return pivots.rank(self._differences, self._nothing) if self.closed else elimination.rank(self._differences)

    def kept(self, order: Sequence[int]) -> tuple[int, ...]:
        """Zero-based indices (k,), in ascending order, of the k of P inertial parameters that stay when the others are
        removed in an `order` (P,) of indices, the first removed first, by energies on exact geometry, without
        round-off.

        A parameter stays where its column of energies is independent of the columns after it in the order. Raises
        `IndexError` for an index of P or more; may raise `ArithmeticError` where loops cannot be closed on the exact
        geometry.
        """
        backward = list(order)[::-1]
        if self.closed:
            return tuple(sorted(pivots.independent_columns(self._differences, backward, self._nothing)))
        return tuple(sorted(elimination.independent_columns(self._differences, backward)))

    def keeps(self, kept: tuple[int, ...], order: Sequence[int]) -> bool:
        """True if removing parameters in an `order` (P,), indices of P inertial parameters, the first removed first,
        leaves just the parameters `kept` (k,), indices in ascending order, by energies on exact geometry.

        That may hold for the geometry described from joint axis to joint axis, or from frame to frame as in the file;
        either will do. The one from axis to axis has all that the rank depends on, but where axes are skew it may lose
        zeros among the file's offsets, which decide what is kept; the one from frame to frame has these zeros, but may
        lose what the rank depends on. May raise `ArithmeticError` where loops cannot be closed on the exact geometry.
        """
        return any(kept == way.kept(order) for way in (replace(self, by_frames=True), self))

    @property
    def _nothing(self) -> float:
        return pivots.EXACTLY_NOTHING if self.strict else pivots.NOTHING

    @property
    def closed(self) -> bool:
        """True if the mechanism has loop closures; couplings, by which joints follow others, do not count."""
        return self.mechanism.description.closed

    @cached_property
    def geometry(self) -> ExactGeometry:
        """The geometry of the mechanism's tree in exact scalars, as an `ExactGeometry`: joint axes, frames and gravity
        as residues modulo a prime, or numbers of 60 digits for closed loops. Lengths are in m, or for closed loops in
        the power of ten of a metre at or below the mechanism's characteristic length."""
        length = characteristic_length(self.mechanism)
        unit = Fraction(10) ** math.floor(math.log10(length)) if self.closed else Fraction(1)
        reading = Reading(digits if self.closed else modular, length, unit, self.precision)
        description = self.mechanism.description
        if self.precision is AS_MEANT:
            lengths = (x for x, _ in loop_lengths(description, self.frames))
            reading = replace(reading, equal=as_equal(lengths, self.precision.length * length))
        if self.by_frames:
            return ExactGeometry.by_frames(description, reading)
        return ExactGeometry.by_axes(description, self.frames, reading)

    @cached_property
    def frames(self) -> CanonicalFrames:
        """The joints' poses from axis to axis, as `CanonicalFrames`, in floats: angles in rad and lengths in m that do
        not depend on where the file puts its frames."""
        return canonical_frames(self.mechanism.description, characteristic_length(self.mechanism), self.precision)

    @cached_property
    def _differences(self) -> Any:
        """H (samples, P)."""
        whole = self.mechanism.unconstrained
        rows = whole.energetic + SPARE
        if self.closed:
            H = _differences_in_digits(whole, self.geometry, rows, self.seed)
        else:
            H = energy_differences(whole.description, self.geometry, rows, self.seed)
        if whole is self.mechanism:
            return H
        left = self.mechanism.free_directions[: whole.energetic, : self.mechanism.energetic]
        out = np.empty((len(H), left.shape[1]), dtype=H.dtype)
        for j, weights in enumerate(left.T):
            out[:, j] = self._combined(H, weights)
        return out

    def _combined(self, H: Any, weights: Array) -> Any:
        """One column of H N from a column (P,) of N."""
        total = np.zeros_like(H[:, 0])
        for i in np.flatnonzero(np.abs(weights) > AS_GIVEN.number):
            weight = simplest_rational(float(weights[i]), abs(float(weights[i])))
            total = total + ((H[:, i] * scaled(weight) >> BITS) if self.closed else H[:, i] * residue(weight) % PRIME)
        return total if self.closed else total % PRIME


def _differences_in_digits(mechanism: Mechanism, geometry: ExactGeometry, rows: int, seed: int) -> Any:
    """Energy differences (rows, P) of closed loops, whose equations are imported here since a tree has none."""
    from adaptctl.identifiability.proof.loop_energies import exact_loops, loop_energies

    states = random_states(mechanism, rows + 1, np.random.default_rng(seed))
    exact = exact_loops(mechanism, geometry)
    E = loop_energies(exact, geometry, mechanism.configuration(states.p), states.v)
    return (E[1:] - E[:1])[:, : mechanism.energetic]
