"""Rank and base parameters of a mechanism's energies on exact geometry."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description import Description
from adaptctl.description.loops import Coupling
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.energy import placed_energy_regressor
from adaptctl.dynamics.recursion.segment import Placement, Segment
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import RankError
from adaptctl.identifiability.proof import arithmetic
from adaptctl.identifiability.proof.arithmetic import (
    BITS,
    PRIME,
    Residues,
    digits,
    modular,
    random_residues,
    random_turns,
    residue,
    scaled,
    stacked_residues,
)
from adaptctl.identifiability.proof.exact_geometry import (
    ExactFrame,
    ExactGeometry,
    Reading,
    as_equal,
    loop_lengths,
    near_coincidences,
)
from adaptctl.identifiability.proof.exact_transfers import energy_changes
from adaptctl.identifiability.proof.joint_frames import (
    AS_GIVEN,
    AS_MEANT,
    CanonicalFrames,
    Precision,
    canonical_frames,
    simplest_rational,
    turn,
)
from adaptctl.identifiability.sampling import characteristic_length, random_states
from adaptctl.scalars import Column

FIELD, DIGITS = "a prime field", "60 digits"
# Rows more than a rank can be: all of them would have to be unlucky at once, one time in 2^31 each.
SPARE_ROWS = 5
# Most near coincidences in a message.
MAX_LISTED_COINCIDENCES = 3


@dataclass(frozen=True)
class Coordinate:
    """Joint position in exact scalars."""

    cosine: Any
    sine: Any
    length: Any

    def placed(self, link: Segment) -> Placement:
        """Pose of a link in its parent."""
        return link.placed((self.cosine, self.sine) if link.turns else (self.length,))

    def followed(self, coupling: Coupling, parts: int, angle: float) -> Coordinate:
        """Position of a coupled joint."""
        ratio = simplest_rational(coupling.ratio)
        c, s = _power((self.cosine, self.sine), int(ratio * parts))
        ahead = _numbers(angle)
        offset = modular(simplest_rational(coupling.offset))
        cosine, sine = _product((c, s), ahead)
        return Coordinate(cosine, sine, self.length * ratio + offset)

    def whole(self, parts: int) -> Coordinate:
        """Position whose angle is `parts` times this one's."""
        return Coordinate(*_power((self.cosine, self.sine), parts), self.length)


def random_places(
    description: Description, geometry: ExactGeometry, samples: int, rng: np.random.Generator
) -> list[Placement]:
    """Poses of a tree's links at random states."""
    couplings = () if description.loops is None else description.loops.couplings
    index = {name: i for i, name in enumerate(description.joint_names)}
    links, shifts = geometry.links, geometry.shifts
    followers = {index[c.follower]: c for c in couplings}
    parts = [1] * len(links)
    for c in couplings:
        parts[index[c.leader]] = math.lcm(parts[index[c.leader]], simplest_rational(c.ratio).denominator)
    free = [_random(samples, rng) for _ in links]
    out = []
    for i, link in enumerate(links):
        if i in followers:
            c = followers[i]
            leader = index[c.leader]
            angle = c.offset + shifts[i] - c.ratio * shifts[leader]
            place = free[leader].followed(c, parts[leader], angle)
        else:
            place = free[i].whole(parts[i])
        out.append(place.placed(link))
    return out


def random_rates(description: Description, samples: int, rng: np.random.Generator) -> Column:
    """Nonzero random velocities of a tree's joints, as residues."""
    rates = [random_residues(samples, rng) for _ in description.links]
    index = {name: i for i, name in enumerate(description.joint_names)}
    for c in () if description.loops is None else description.loops.couplings:
        rates[index[c.follower]] = rates[index[c.leader]] * simplest_rational(c.ratio)
    return Column(rates)


def _random(samples: int, rng: np.random.Generator) -> Coordinate:
    return Coordinate(*random_turns(samples, rng), random_residues(samples, rng))


def _product(one: tuple[Any, Any], other: tuple[Any, Any]) -> tuple[Any, Any]:
    (a, b), (c, d) = one, other
    return a * c - b * d, a * d + b * c


def _power(turn: tuple[Any, Any], times: int) -> tuple[Any, Any]:
    if times < 0:
        c, s = _power(turn, -times)
        return c, -s
    out: tuple[Any, Any] = (1.0, 0.0)
    while times:
        if times & 1:
            out = _product(out, turn)
        turn, times = _product(turn, turn), times >> 1
    return out


def _numbers(angle: float) -> tuple[Any, Any]:
    c, s = turn(angle).cosine_and_sine
    return modular(c), modular(s)


def energy_differences(description: Description, geometry: ExactGeometry, samples: int, seed: int) -> Residues:
    """Energy differences (samples, P) at random states, as residues."""
    rng = np.random.default_rng(seed)
    places = random_places(description, geometry, samples + 1, rng)
    rates = random_rates(description, samples + 1, rng)
    links = placed_energy_regressor(places, rates, geometry.gravity)
    row = TreeEquations.of(description).energies(links, rates)
    E = stacked_residues([*row][: description.num_energy_parameters], samples + 1)
    return (E[1:] - E[:1]) % PRIME


@dataclass(frozen=True, eq=False)
class ExactEnergies:
    """Energies of a mechanism on exact geometry, at a precision."""

    mechanism: Mechanism
    precision: Precision = AS_GIVEN
    seed: int = 0
    strict: bool = False
    by_frames: bool = False

    @property
    def method(self) -> str:
        """Arithmetic: "60 digits" for closed loops, "a prime field" otherwise."""
        return DIGITS if self.closed else FIELD

    @cached_property
    def rank(self) -> int:
        """Number of identifiable directions."""
        description = self.mechanism.description
        plain = description.loops is None and len(description.bodies) == len(description.links) and not self.by_frames
        # A drive that turns with several joints has its energy in products of their rates too.
        if plain and not description.drive_couplings and self.mechanism.unconstrained is self.mechanism:
            # Of a tree, it is the sum of what its joints feel (Wensing, Niemeyer and Slotine 2017).
            joints = [ExactFrame.of(joint.joint, self.reading) for joint in self.frames.joints]
            return sum(arithmetic.ranks(energy_changes(description, joints, 11 + SPARE_ROWS, self.seed)))
        return arithmetic.rank(self._differences, self._nothing)

    def kept(self, order: Sequence[int]) -> tuple[int, ...]:
        """Indices (k,) of the parameters kept by an order of removal."""
        key = tuple(order)
        if key not in self._kept:
            found = arithmetic.independent_columns(self._differences, order[::-1], self._nothing)
            self._kept[key] = tuple(sorted(found))
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[tuple[int, ...], tuple[int, ...]]:
        """Parameters kept by each order of removal that was asked for."""
        return {}

    def keeps(self, kept: tuple[int, ...], order: Sequence[int]) -> bool:
        """True if an order of removal keeps exactly these."""
        return kept in self.kept_in_any_way(order)

    @property
    def _nothing(self) -> float:
        return arithmetic.EXACT_ZERO_TOLERANCE if self.strict else arithmetic.ZERO_TOLERANCE

    @property
    def closed(self) -> bool:
        """True if the mechanism has loop closures."""
        return self.mechanism.description.closed

    @cached_property
    def reading(self) -> Reading:
        """Rule by which the geometry's floats are exact."""
        length = characteristic_length(self.mechanism)
        unit = Fraction(10) ** math.floor(math.log10(length)) if self.closed else Fraction(1)
        reading = Reading(digits if self.closed else modular, length, unit, self.precision)
        description = self.mechanism.description
        if self.precision is AS_MEANT:
            lengths = (x for x, _ in loop_lengths(description, self.frames))
            reading = replace(reading, equal=as_equal(lengths, self.precision.length * length))
        return reading

    @cached_property
    def geometry(self) -> ExactGeometry:
        """Geometry in exact scalars."""
        if self.by_frames:
            return ExactGeometry.by_frames(self.mechanism.description, self.reading)
        return ExactGeometry.by_axes(self.mechanism.description, self.frames, self.reading)

    @cached_property
    def frames(self) -> CanonicalFrames:
        """Joints' poses from axis to axis, in floats."""
        return canonical_frames(self.mechanism.description, characteristic_length(self.mechanism), self.precision)

    def kept_in_any_way(self, order: Sequence[int]) -> Iterator[tuple[int, ...]]:
        """Indices (k,) of the parameters kept by an order of removal, as the geometry is read by axes and by frames."""
        for way in (self._read_by_frames, self):
            yield way.kept(order)

    @cached_property
    def _read_by_frames(self) -> ExactEnergies:
        return replace(self, by_frames=True)

    @cached_property
    def _differences(self) -> Any:
        whole = self.mechanism.unconstrained
        rows = whole.num_energy_parameters + SPARE_ROWS
        if self.closed:
            H = _differences_in_digits(whole, self.geometry, rows, self.seed)
        else:
            H = energy_differences(whole.description, self.geometry, rows, self.seed)
        if whole is self.mechanism:
            return H
        left = self.mechanism.free_directions[: whole.num_energy_parameters, : self.mechanism.num_energy_parameters]
        out = np.empty((len(H), left.shape[1]), dtype=H.dtype)
        for j, column in enumerate(left.T):
            out[:, j] = self._combined(H, column)
        return out

    def _combined(self, H: Any, weights: Array) -> Any:
        total = np.zeros_like(H[:, 0])
        for i in np.flatnonzero(np.abs(weights) > AS_GIVEN.number):
            weight = simplest_rational(float(weights[i]), abs(float(weights[i])))
            total = total + ((H[:, i] * scaled(weight) >> BITS) if self.closed else H[:, i] * residue(weight) % PRIME)
        return total if self.closed else total % PRIME


def _differences_in_digits(mechanism: Mechanism, geometry: ExactGeometry, rows: int, seed: int) -> Any:
    from adaptctl.identifiability.proof.exact_geometry import exact_loops, loop_energies

    states = random_states(mechanism, rows + 1, np.random.default_rng(seed))
    exact = exact_loops(mechanism, geometry)
    E = loop_energies(exact, geometry, mechanism.configuration(states.p), states.v)
    return (E[1:] - E[:1])[:, : mechanism.num_energy_parameters]


def proved(mechanism: Mechanism, as_written: bool, prove: bool | None, seed: int) -> ExactEnergies | None:
    """Energies on exact geometry that prove the rank."""
    if prove is False:
        return None
    exact = ExactEnergies(mechanism, seed=seed)
    coincidences = near_coincidences(mechanism.description, exact.frames)
    if coincidences:
        exact = replace(exact, strict=True)
    if coincidences and not as_written:
        _validate_one_rank(mechanism, exact, coincidences)
    return exact if prove or not exact.closed or coincidences else None


def _validate_one_rank(mechanism: Mechanism, exact: ExactEnergies, coincidences: tuple[str, ...]) -> None:
    meant = _rank(ExactEnergies(mechanism, AS_MEANT, exact.seed))
    if meant == exact.rank:
        return
    more = (
        f"; and {len(coincidences) - MAX_LISTED_COINCIDENCES} more"
        if len(coincidences) > MAX_LISTED_COINCIDENCES
        else ""
    )
    if_meant = f"{meant}" if meant is not None else "undetermined"
    raise RankError(
        f"{mechanism.name}: the rank is {exact.rank} for the geometry as given, but {if_meant} if nearly special "
        f"values are made exact: {'; '.join(coincidences[:MAX_LISTED_COINCIDENCES])}{more}. Write the values exactly, "
        "or use them as they stand with as_written=True (--as-written)"
    )


def _rank(energies: ExactEnergies) -> int | None:
    try:
        return energies.rank
    except ArithmeticError:
        return None
