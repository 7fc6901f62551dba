"""A mechanism's geometry in exact numbers, as the equations see it, and what of it is nearly special."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description, Link, Pose
from adaptctl.description.loops import Closure
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loops.constraint import ClosureSide, Follower, Loop
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.errors import InputError
from adaptctl.identifiability.certificate import near_right_angles
from adaptctl.identifiability.proof.arithmetic import digits, samples_of, stacked_digits
from adaptctl.identifiability.proof.joint_frames import (
    AS_GIVEN,
    AS_MEANT,
    CanonicalFrames,
    FloatFrame,
    FramePlacement,
    Precision,
    Turns,
    simplest_rational,
    turn,
    turned,
    turns_of,
)
from adaptctl.scalars import Column, Mat, Vec, product

if TYPE_CHECKING:
    from adaptctl.dynamics.loop_equations import LoopEquations

Number = Callable[[Fraction], Any]
"""Makes scalars of rational numbers: residues, or numbers of many digits."""
QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Cosines and sines of quarter turns."""


@dataclass(frozen=True)
class Reading:
    """A rule by which angles and lengths in floats become exact scalars, those of the simplest rational numbers near
    them.

    `number` makes an exact scalar of a `Fraction`: a residue modulo a prime, or a number of 60 digits. `size` is the
    mechanism's characteristic length in m, `unit` the exact scalars' unit of lengths in m (1 by default), `precision`
    the differences that are taken as zero (round-off by default). `equal` has lengths in m, in ascending order, none by
    default, each of which replaces all that exceed it by at most the precision. Nothing is checked at construction.
    """

    number: Number
    size: float
    unit: Fraction = Fraction(1)
    precision: Precision = AS_GIVEN
    equal: tuple[float, ...] = ()

    def length(self, x: float) -> Any:
        """The exact scalar (a residue modulo a prime, or a number of 60 digits, as this object's `number` makes it) of
        a length `x` in m, which may be negative, counted in this object's `unit` of length (1 m by default).

        It is 0 where |x| is at most `precision.length` (1e-11 by default) times this object's `size`, the mechanism's
        characteristic length in m. Else it is the simplest rational number near x, the one of least denominator that
        differs from x by at most `precision.number` (1e-12) times the power of ten at or below `size`. An x that
        exceeds an entry of this object's `equal`, lengths in ascending order, by no more than the former bound first
        becomes that entry. Raises `ValueError` for NaN, `OverflowError` for infinity.
        """
        place = bisect_right(self.equal, abs(x)) - 1
        if place >= 0 and abs(x) - self.equal[place] <= self.precision.length * self.size:
            x = math.copysign(self.equal[place], x)
        return self.number(simplest_rational(x, self.size, self.precision) / self.unit)

    def turned(self, angle: float) -> tuple[Any, Any]:
        """The pair of the cosine and the sine of an `angle` in rad as exact scalars (residues modulo a prime, or
        numbers of 60 digits, as `number` makes them) whose squares sum to exactly 1.

        They are those of the angle whose half tangent, beyond a multiple of a right angle, is the simplest rational
        number near the true one; floats 0 and +-1 within `precision.angle` (1e-11 rad by default) of a multiple of a
        right angle. Raises `ValueError` for NaN, `OverflowError` for infinity.
        """
        found = turn(angle, self.precision)
        if not found.half_tangent:
            return QUARTERS[found.quarters]
        c, s = found.cosine_and_sine
        return self.number(c), self.number(s)

    def rotation(self, turns: Turns) -> Mat:
        """The rotation matrix (3, 3), in exact scalars (residues modulo a prime, or numbers of 60 digits, and floats 0
        and +-1), that is the product of turns about coordinate axes, in their order. Each of `turns` is an axis (0, 1,
        2 for x, y, z) and an angle in rad. Raises `ValueError` for no turns and for NaN, `OverflowError` for
        infinity."""
        first, *rest = (turned(axis, *self.turned(angle)) for axis, angle in turns)
        return reduce(product, rest, first)


@dataclass(frozen=True)
class ExactFrame:
    """The pose of a frame in another one, in exact scalars (residues modulo a prime, or numbers of 60 digits):
    `rotation` (3, 3) turns its coordinates into the other's, `origin` (3,) is its origin there, in the unit of length
    of the `Reading` that made it. Nothing is checked."""

    rotation: Mat
    origin: Vec

    @classmethod
    def of(cls, placement: FramePlacement, reading: Reading) -> ExactFrame:
        """The pose of a frame in exact scalars (residues modulo a prime, or numbers of 60 digits), an `ExactFrame`, for
        a `placement` in floats (angles in rad, lengths in m), by a `reading`, the rule that makes floats exact. Raises
        `ValueError` for NaN, `OverflowError` for infinity."""
        radius, height = reading.length(placement.radius), reading.length(placement.height)
        c, s = reading.turned(placement.bearing)
        return cls(reading.rotation(placement.turns), Vec(radius * c, radius * s, height))


@dataclass(frozen=True)
class ExactGeometry:
    """The geometry of a mechanism's tree in exact scalars (residues modulo a prime, or numbers of 60 digits).

    `links` are the N links' geometry as the equations of motion take it, lengths in the unit of `reading`, the rule
    that made floats exact; `shifts` (N,), rad for revolute joints and 0 for others, are added to the file's joint
    coordinates to give those used here. `gravity` (3,) is in m/s^2 and the world's axes where made by `by_frames`, and
    (0, 0, -1), z being up, where made by `by_axes`; zero where there is none. `fixed`, a function of a link's index (-1
    for the ground) and a pose in that link's frame, gives the exact pose of the frame that is fixed there. Made by
    `by_axes` or `by_frames`; nothing is checked at construction.
    """

    links: tuple[Segment, ...]
    shifts: tuple[float, ...]
    gravity: Vec
    reading: Reading
    fixed: Callable[[int, Pose], ExactFrame]

    @classmethod
    def by_axes(cls, description: Description, frames: CanonicalFrames, reading: Reading) -> ExactGeometry:
        """The exact geometry of the mechanism of a `description` by its joint axes: axes that are parallel, meet or are
        at right angles, up to the precision of the `reading`, are so exactly, wherever the file puts its frames.
        `frames` are the joints' poses from axis to axis, `reading` the rule that makes floats exact. Raises
        `ValueError` for frames of another number of joints."""
        on_joints = tuple(ExactFrame.of(joint.link, reading) for joint in frames.joints)
        links = tuple(
            _segment(
                link.parent,
                link.joint.kind.is_revolute,
                ExactFrame.of(joint.joint, reading),
                None if link.parent == GROUND else on_joints[link.parent],
                own,
            )
            for link, joint, own in zip(description.links, frames.joints, on_joints, strict=True)
        )

        def fixed(link: int, pose: Pose) -> ExactFrame:
            frame = ExactFrame.of(frames.placement(link, pose), reading)
            if link == GROUND:
                return frame
            back = on_joints[link].rotation.T
            return ExactFrame(product(back, frame.rotation), back @ (frame.origin - on_joints[link].origin))

        gravity = Vec(0.0, 0.0, -1.0 if description.gravity.any() else 0.0)
        return cls(links, tuple(joint.shift for joint in frames.joints), gravity, reading, fixed)

    @classmethod
    def by_frames(cls, description: Description, reading: Reading) -> ExactGeometry:
        """The exact geometry of the mechanism of a `description` frame by frame, as its file describes it: lengths, and
        entries of rotations, that are zero up to the precision of the `reading`, the rule that makes floats exact,
        become exact zeros. Joints' coordinates are the file's (`shifts` are 0). Nothing is checked."""

        def fixed(_: int, pose: Pose) -> ExactFrame:
            return _as_written(pose, reading)

        links = tuple(_as_in_file(link, reading) for link in description.links)
        gravity = Vec(*(reading.number(simplest_rational(float(g), 10.0)) for g in description.gravity))
        return cls(links, (0.0,) * len(links), gravity, reading, fixed)


def _as_written(pose: Pose, reading: Reading) -> ExactFrame:
    """A pose with the file's own lengths; its rotation by turns."""
    rotation = reading.rotation(turns_of(FloatFrame.of(pose).rotation, reading.precision))
    return ExactFrame(rotation, Vec(*(reading.length(x) for x in pose.translation.tolist())))


def _as_in_file(link: Link, reading: Reading) -> Segment:
    near, far = _as_written(link.parent_to_joint, reading), _as_written(link.joint_to_link, reading)
    x, y, z = link.joint.axis.tolist()
    tilt, yaw = reading.turned(math.atan2(math.hypot(x, y), z)), reading.turned(math.atan2(x, -y) if x or y else 0.0)
    axis = Vec(yaw[1] * tilt[1], -(yaw[0] * tilt[1]), tilt[0])
    outward = far.rotation.T
    return Segment(
        parent=link.parent,
        turns=link.joint.kind.is_revolute,
        joint_axis=axis,
        axis=outward @ axis,
        inward=_unless_identity(near.rotation.T),
        outward=_unless_identity(outward),
        parent_to_joint=near.origin,
        joint_to_link=outward @ far.origin,
    )


def _segment(parent: int, turns: bool, joint: ExactFrame, before: ExactFrame | None, own: ExactFrame) -> Segment:
    """A segment whose joint's frame is given in that of the joint before, on a link whose frame stands at `before`
    there."""
    turned, near = joint.rotation, joint.origin
    if before is not None:
        turned = product(before.rotation.T, joint.rotation)
        near = before.rotation.T @ (joint.origin - before.origin)
    outward = own.rotation.T
    z = Vec(0.0, 0.0, 1.0)
    return Segment(
        parent=parent,
        turns=turns,
        joint_axis=z,
        axis=outward @ z,
        inward=_unless_identity(turned.T),
        outward=_unless_identity(outward),
        parent_to_joint=near,
        joint_to_link=outward @ own.origin,
    )


def _unless_identity(rotation: Mat) -> Mat | None:
    entries = [entry for row in (rotation.x, rotation.y, rotation.z) for entry in row]
    identity = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    return None if all(isinstance(x, float) and x == y for x, y in zip(entries, identity, strict=True)) else rotation


def near_coincidences(description: Description, frames: CanonicalFrames) -> tuple[str, ...]:
    """Near coincidences of a mechanism's geometry, a text for each; if they are meant to be exact, the rank may be
    another. Empty where there are none.

    They are angles between successive joint axes within 1e-3 rad of a multiple of 90 degrees, offsets between these
    axes below 1e-4 of the characteristic length, and, with closed loops, lengths that differ by less than that; those
    within 1e-11 (rad, or of that length) count as exact and are none. `description` is the mechanism's, `frames` the
    joints' poses from axis to axis. Nothing is checked.
    """
    angles = [str(angle) for angle in near_right_angles(description, AS_GIVEN.angle)]
    return (*angles, *_near_offsets(description, frames), *_near_equals(description, frames))


def _near_offsets(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    for link, joint in zip(description.links, frames.joints, strict=True):
        before = "the world" if link.parent == GROUND else description.links[link.parent].joint.name
        for what, offset in (("from", joint.joint.radius), ("along", joint.joint.height)):
            if link.parent != GROUND and _nearly(offset, frames.length):
                yield f"{link.joint.name} stands {abs(offset):.1e} m {what} the axis of {before}, nearly nothing"


def _near_equals(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    for (one, name), (other, another) in pairwise(loop_lengths(description, frames)):
        if one > AS_MEANT.length * frames.length and _nearly(other - one, frames.length):
            yield f"the lengths {one:.10g} m at {name} and {other:.10g} m at {another} are nearly equal"


def loop_lengths(description: Description, frames: CanonicalFrames) -> list[tuple[float, str]]:
    """Lengths that may have to equal one another in closed loops, as pairs (length in m, name of the joint or loop
    closure that it belongs to), in ascending order of length.

    They are the distances from the z axis (radius) and along it (height), in size, of each joint's frame in that of the
    joint before, as `frames` have them, and of each closure's two frames in those of their links' joints. Empty for a
    `description` without loop closures. Nothing is checked.
    """
    loops = description.loops
    if loops is None or not loops.closures:
        return []
    placed = [(link.joint.name, joint.joint) for link, joint in zip(description.links, frames.joints, strict=True)]
    index: dict[str | None, int] = {None: GROUND} | {link.name: i for i, link in enumerate(description.links)}
    for closure in loops.closures:
        placed.append((closure.name, frames.placement(index[closure.first], closure.first_frame)))
        placed.append((closure.name, frames.placement(index[closure.second], closure.second_frame)))
    return sorted((abs(x), name) for name, placement in placed for x in (placement.radius, placement.height))


def as_equal(lengths: Iterable[float], least: float) -> tuple[float, ...]:
    """The lengths (m), in ascending order, that represent groups of nearly equal ones among `lengths` (m), which must
    rise: the first of each group, which the others exceed by at most `least` (m). Nothing is checked."""
    firsts: list[float] = []
    for length in lengths:
        if not firsts or length - firsts[-1] > least:
            firsts.append(length)
    return tuple(firsts)


def _nearly(x: float, length: float) -> bool:
    return AS_GIVEN.length * length < abs(x) <= AS_MEANT.length * length


def exact_loops(mechanism: Mechanism, geometry: ExactGeometry) -> LoopEquations:
    """The equations of motion of a mechanism with closed loops on its exact `geometry`, as `LoopEquations`, whose joint
    coordinates are the file's plus the geometry's `shifts` (rad). Raises `InputError` for a tree, `LoopError` where
    loops cannot be closed."""
    description = mechanism.description
    if mechanism.continuation is None or description.loops is None:
        raise InputError(f"{mechanism.name}: there are no loops to close")
    equations = mechanism.continuation.equations
    tree = replace(equations.tree, segments=geometry.links, gravity=geometry.gravity)
    pairs = zip(equations.closing.loops, description.loops.closures, strict=True)
    closed = tuple(_exact_loop(loop, closure, description, geometry) for loop, closure in pairs)
    followers = tuple(_exact_follower(follower, geometry) for follower in equations.closing.followers)
    closing = replace(equations.closing, loops=closed, followers=followers)
    return replace(equations, tree=tree, closing=closing, rules=())


def loop_energies(equations: LoopEquations, geometry: ExactGeometry, q: Array, v: Array) -> Any:
    """The energy regressor (samples, P) of a mechanism with closed loops at `samples` states, to 60 decimal digits:
    kinetic plus potential energies per unit of each of P inertial and friction parameters (0 for friction). Entries are
    Python ints (dtype object), the energies times 2^200. They are with the gravity of the exact `geometry`, a unit
    vector where the geometry was made from joint axes alone, and in its unit of length.

    `equations` are the equations of motion on that geometry, which `exact_loops` returns; `q` (samples, n) are
    configurations of the spanning tree's n joints, rad (m for a prismatic joint), in the file's coordinates, that close
    the loops up to round-off, and are closed to 60 digits here; `v` (samples, r) are the velocities of the r primary
    (independent) joints, rad/s (the geometry's unit per s for a prismatic joint). Raises `ArithmeticError` where
    Newton's steps on that geometry meet a singular matrix, as at a singularity of the loops.
    """
    joints = zip(q.T, geometry.shifts, geometry.links, strict=True)
    guess = Column(_coordinate(x, shift, link.turns, geometry.reading.unit) for x, shift, link in joints)
    closed = equations.closed(Column(guess[i] for i in equations.closing.primary), guess)
    row = equations.energy_regressor(closed, Column(samples_of(x) for x in v.T))
    return stacked_digits([*row], len(q))


def _coordinate(q: Array, shift: float, turns: bool, unit: Fraction) -> Any:
    return samples_of(q) + shift if turns else samples_of(q) * digits(1 / unit)


def _exact_loop(loop: Loop, closure: Closure, description: Description, geometry: ExactGeometry) -> Loop:
    names = {link.name: i for i, link in enumerate(description.links)}
    first = geometry.fixed(GROUND if closure.first is None else names[closure.first], closure.first_frame)
    second = geometry.fixed(GROUND if closure.second is None else names[closure.second], closure.second_frame)
    return Loop(
        ClosureSide(loop.first.links, first.rotation, first.origin),
        ClosureSide(loop.second.links, second.rotation, second.origin),
        loop.kind,
    )


def _exact_follower(follower: Follower, geometry: ExactGeometry) -> Follower:
    """The follower with its offset among shifted joints, and lengths in the geometry's unit."""
    shifts, links = geometry.shifts, geometry.links
    over = {False: float(1 / geometry.reading.unit), True: 1.0}
    own, other = over[links[follower.follower].turns], over[links[follower.leader].turns]
    shift = shifts[follower.follower] - follower.ratio * shifts[follower.leader]
    return replace(follower, ratio=follower.ratio * own / other, offset=follower.offset * own + shift)
