"""The rank of a mechanism's energies on exact geometry, and the parameters that an order of removal leaves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, get_args

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description import GROUND, Description
from adaptctl.description.loops import Coupling
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.energy import Weight, carried_weight, link_energy, placed_energy_regressor, weights
from adaptctl.dynamics.recursion.motion import Twist, carried, twists
from adaptctl.dynamics.recursion.segment import Placement, Segment
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.certificate import Near
from adaptctl.identifiability.proof import arithmetic
from adaptctl.identifiability.proof.arithmetic import (
    BITS,
    PRIME,
    Residues,
    digits,
    modular,
    random_residues,
    residue,
    scaled,
    stacked_residues,
)
from adaptctl.identifiability.proof.exact_geometry import (
    ExactGeometry,
    Reading,
    as_equal,
    loop_lengths,
    near_coincidences,
)
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
from adaptctl.scalars import ZERO, Column

FIELD, DIGITS = "a prime field", "60 digits"
SPARE = 5
"""Rows more than a rank can be: all of them would have to be unlucky at once, one time in 2^31 each."""
LISTED = 3
"""Most near coincidences in a message."""


@dataclass(frozen=True)
class Coordinate:
    """A joint's position at `samples` random states over the prime field (integers modulo 2^31 - 1): the `cosine` and
    the `sine` of its angle, for revolute joints, and its `length`, for prismatic ones, each a `Modular` scalar. Angle
    and length are drawn independently of each other, though a joint uses only one. Nothing is checked."""

    cosine: Any
    sine: Any
    length: Any

    def placed(self, link: Segment) -> Placement:
        """The pose in its parent link, as a `Placement`, of a link of geometry `link` whose joint is at this position:
        by its cosine and sine where the joint turns, else by its length. Nothing is checked."""
        return link.placed((self.cosine, self.sine) if link.turns else (self.length,))

    def followed(self, coupling: Coupling, parts: int, angle: float) -> Coordinate:
        """The position of a joint that follows this one, the leader, by a `coupling`: follower = ratio * leader +
        offset.

        This one's `cosine` and `sine` must be those of the leader's angle divided by `parts`, a whole number that makes
        ratio times `parts` whole too; its `length`, for prismatic joints, is the leader's. `angle`, in rad, is the
        follower's where the leader's is zero. Nothing is checked.
        """
        ratio = simplest_rational(coupling.ratio)
        c, s = _power((self.cosine, self.sine), int(ratio * parts))
        ahead = _numbers(angle)
        offset = modular(simplest_rational(coupling.offset))
        cosine, sine = _product((c, s), ahead)
        return Coordinate(cosine, sine, self.length * ratio + offset)

    def whole(self, parts: int) -> Coordinate:
        """The joint position whose angle is `parts` times this one's, `parts` a whole number, by its cosine and sine:
        the whole angle where this one has a `parts`-th of it. The length stays. Nothing is checked."""
        return Coordinate(*_power((self.cosine, self.sine), parts), self.length)


def random_places(
    description: Description, geometry: ExactGeometry, samples: int, rng: np.random.Generator
) -> list[Placement]:
    """The poses of a tree's links in their parents at `samples` random states, one `Placement` for each link, in the
    links' order, whose scalars have all samples.

    Joint coordinates are drawn with NumPy's `rng`, uniform among the nonzero residues modulo the prime 2^31 - 1 (half
    tangents for angles). `description` is the tree's, `geometry` its geometry, exact and in residues. Joints that
    follow others by couplings are where their leaders put them. Nothing is checked.
    """
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
    """The velocities of a tree's N joints, in the links' order, at `samples` random states: a `Column` (N,), a vector
    of scalars, each a `Modular` of all samples. They are drawn with NumPy's `rng`, uniform among the nonzero residues
    modulo the prime 2^31 - 1. Joints that follow others by couplings of the `description` have their ratio times the
    leader's. Nothing is checked."""
    rates = [random_residues(samples, rng) for _ in description.links]
    index = {name: i for i, name in enumerate(description.joint_names)}
    for c in () if description.loops is None else description.loops.couplings:
        rates[index[c.follower]] = rates[index[c.leader]] * simplest_rational(c.ratio)
    return Column(rates)


def _random(samples: int, rng: np.random.Generator) -> Coordinate:
    t, length = random_residues(samples, rng), random_residues(samples, rng)
    square = t * t
    over = 1.0 / (1.0 + square)
    return Coordinate((1.0 - square) * over, 2.0 * t * over, length)


def _product(one: tuple[Any, Any], other: tuple[Any, Any]) -> tuple[Any, Any]:
    """Cosine and sine of the sum of two angles."""
    (a, b), (c, d) = one, other
    return a * c - b * d, a * d + b * c


def _power(turn: tuple[Any, Any], times: int) -> tuple[Any, Any]:
    """Cosine and sine of so many times an angle."""
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
    """The matrix H (`samples`, P) of energy differences per unit of each of a mechanism's P inertial parameters (all
    but friction), as residues modulo the prime 2^31 - 1: kinetic plus potential energies at `samples` random states,
    less those at one more state, the same for all rows.

    `description` is the mechanism's, `geometry` its geometry, exact and in residues; energies are with that gravity,
    which is a unit vector where the geometry was made by axes, and that unit of length. `seed` draws the states, joint
    coordinates and rates uniform among the nonzero residues (half tangents for angles), the same for the same seed. It
    is for trees, also with joints that follow others; closed loops are not looked at. Nothing is checked.
    """
    rng = np.random.default_rng(seed)
    places = random_places(description, geometry, samples + 1, rng)
    rates = random_rates(description, samples + 1, rng)
    links = placed_energy_regressor(places, rates, geometry.gravity)
    row = TreeEquations.of(description).energies(links, rates)
    E = stacked_residues([*row][: description.num_energy_parameters], samples + 1)
    return (E[1:] - E[:1]) % PRIME


def energy_changes(description: Description, geometry: ExactGeometry, samples: int, seed: int) -> Residues:
    """Energy changes (N, `samples`, 11) as a body is moved from the link of a joint to the parent link (or the ground),
    at random states of a tree of N links, as residues modulo the prime 2^31 - 1. They are the kinetic plus potential
    energy of the body on the joint's link less that of the same body fixed to the parent link, in the pose that it has
    there at joint position zero.

    The first ten are per unit of the body's inertial parameters (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz,
    I_zz) in the link's frame; the eleventh is the square of the joint's rate, for a rotor's inertia, and 0 where there
    is no rotor. A combination of the eleven is unobservable at a joint (the torques do not show it) exactly when the
    energy changes in no state. `description` is the tree's, `geometry` its geometry, exact and in residues; joint
    position zero is that of its joint coordinates, which may be shifted from the file's, and energies are with its
    gravity and its unit of length. `seed` draws the states, joint coordinates and rates uniform among the nonzero
    residues (half tangents for angles), the same for the same seed. Nothing is checked.
    """
    rng = np.random.default_rng(seed)
    places = random_places(description, geometry, samples, rng)
    rates = random_rates(description, samples, rng)
    moving, heavy = twists(places, rates), weights(places, geometry.gravity)
    out = np.zeros((len(places), samples, 11), dtype=np.int64)
    for i, link in enumerate(geometry.links):
        before, base = Twist(ZERO, ZERO), Weight(geometry.gravity, 0.0)
        if link.parent != GROUND:
            before, base = moving[link.parent], heavy[link.parent]
        still = link.placed((1.0, 0.0) if link.turns else (0.0,))
        free = link_energy(moving[i], heavy[i])
        held = link_energy(carried(still, before), carried_weight(still, base))
        out[i, :, :10] = stacked_residues([*(free - held)], samples)
        if description.links[i].joint.drive.rotor_inertia is not None:
            out[i, :, 10] = rates[i].residues * rates[i].residues % PRIME
    return out


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
    by_frames: bool = False

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
            return sum(arithmetic.ranks(energy_changes(description, self.geometry, 11 + SPARE, self.seed)))
        return arithmetic.rank(self._differences, self._nothing)

    def kept(self, order: Sequence[int]) -> tuple[int, ...]:
        """Zero-based indices (k,), in ascending order, of the k of P inertial parameters that stay when the others are
        removed in an `order` (P,) of indices, the first removed first, by energies on exact geometry, without
        round-off.

        A parameter stays where its column of energies is independent of the columns after it in the order. Raises
        `IndexError` for an index of P or more; may raise `ArithmeticError` where loops cannot be closed on the exact
        geometry.
        """
        return tuple(sorted(arithmetic.independent_columns(self._differences, order[::-1], self._nothing)))

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
        return arithmetic.EXACTLY_NOTHING if self.strict else arithmetic.NOTHING

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
        rows = whole.num_energy_parameters + SPARE
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
        """One column of H N from a column (P,) of N."""
        total = np.zeros_like(H[:, 0])
        for i in np.flatnonzero(np.abs(weights) > AS_GIVEN.number):
            weight = simplest_rational(float(weights[i]), abs(float(weights[i])))
            total = total + ((H[:, i] * scaled(weight) >> BITS) if self.closed else H[:, i] * residue(weight) % PRIME)
        return total if self.closed else total % PRIME


def _differences_in_digits(mechanism: Mechanism, geometry: ExactGeometry, rows: int, seed: int) -> Any:
    """Energy differences (rows, P) of closed loops, whose equations are imported here since a tree has none."""
    from adaptctl.identifiability.proof.exact_geometry import exact_loops, loop_energies

    states = random_states(mechanism, rows + 1, np.random.default_rng(seed))
    exact = exact_loops(mechanism, geometry)
    E = loop_energies(exact, geometry, mechanism.configuration(states.p), states.v)
    return (E[1:] - E[:1])[:, : mechanism.num_energy_parameters]


def proved(mechanism: Mechanism, near: Near, prove: bool | None, seed: int) -> ExactEnergies | None:
    """The energies of a mechanism on exact geometry, an `ExactEnergies`, whose rank proves the mechanism's, or None
    where they are left out.

    They are left out if `prove` is False and, if it is None, for closed loops, which take long, unless some angles or
    lengths are nearly special: angles within 1e-3 rad of a multiple of 90 degrees, or offsets within 1e-4 of the
    characteristic length of zero (in loops also of one another), that are not exact to 1e-11. `seed` draws the states.
    Raises `RankError` where some are nearly special and the rank would be another if they were exactly so, unless
    `near` is "as_is" ("refuse" is the other choice) or `prove` False; `InputError` for another `near`.
    """
    if near not in get_args(Near):
        raise InputError(f"near_singular: expected one of {', '.join(get_args(Near))}, got {near!r}")
    if prove is False:
        return None
    exact = ExactEnergies(mechanism, seed=seed)
    coincidences = near_coincidences(mechanism.description, exact.frames)
    if coincidences:
        exact = replace(exact, strict=True)
    if coincidences and near == "refuse":
        _validate_one_rank(mechanism, exact, coincidences)
    return exact if prove or not exact.closed or coincidences else None


def _validate_one_rank(mechanism: Mechanism, exact: ExactEnergies, coincidences: tuple[str, ...]) -> None:
    meant = _rank(ExactEnergies(mechanism, AS_MEANT, exact.seed))
    if meant == exact.rank:
        return
    more = f"; and {len(coincidences) - LISTED} more" if len(coincidences) > LISTED else ""
    if_meant = f"{meant} if" if meant is not None else "not to be told where"
    raise RankError(
        f"{mechanism.name}: the rank is {exact.rank} as the geometry stands, and {if_meant} what is nearly special is "
        f"meant to be so: {'; '.join(coincidences[:LISTED])}{more}. Write what is meant exactly, or load with "
        'snap=True, which makes angles right; if it is meant as it stands, say near_singular="as_is"'
    )


def _rank(energies: ExactEnergies) -> int | None:
    """The rank; None where the geometry that may be meant does not close its loops."""
    try:
        return energies.rank
    except ArithmeticError:
        return None
