"""Exact geometry of a mechanism, and its nearly special values."""

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
from adaptctl.description.right_angles import near_right_angles
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loops.constraint import ClosureSide, Follower, Loop
from adaptctl.dynamics.recursion.motion import AXES
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.errors import InputError
from adaptctl.identifiability.certificate import ROUND_OFF_RATIO
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

# Makes scalars of rational numbers: residues, or numbers of many digits.
Number = Callable[[Fraction], Any]
# Shares of the characteristic length, above and up to which an offset or a difference of lengths is nearly zero.
NEARLY = AS_GIVEN.length, AS_MEANT.length
# Cosines and sines of quarter turns.
QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


@dataclass(frozen=True)
class Reading:
    """Rule that makes floats exact."""

    number: Number
    size: float
    unit: Fraction = Fraction(1)
    precision: Precision = AS_GIVEN
    equal: tuple[float, ...] = ()

    def length(self, x: float) -> Any:
        """Exact scalar of a length in m."""
        place = bisect_right(self.equal, abs(x)) - 1
        if place >= 0 and abs(x) - self.equal[place] <= self.precision.length * self.size:
            x = math.copysign(self.equal[place], x)
        return self.number(simplest_rational(x, self.size, self.precision) / self.unit)

    def turned(self, angle: float) -> tuple[Any, Any]:
        """Exact cosine and sine of an angle, on the unit circle."""
        found = turn(angle, self.precision)
        if not found.half_tangent:
            return QUARTERS[found.quarters]
        c, s = found.cosine_and_sine
        return self.number(c), self.number(s)

    def rotation(self, turns: Turns) -> Mat:
        """Exact rotation matrix of successive turns about coordinate axes."""
        each = ((axis, self.turned(angle)) for axis, angle in turns)
        first, *rest = [turned(axis, *angle) for axis, angle in each if angle != QUARTERS[0]] or [AXES]
        return reduce(product, rest, first)


@dataclass(frozen=True)
class ExactFrame:
    """Pose of a frame in exact scalars."""

    rotation: Mat
    origin: Vec

    @classmethod
    def of(cls, placement: FramePlacement, reading: Reading) -> ExactFrame:
        """Exact pose of a placement in floats."""
        radius, height = reading.length(placement.radius), reading.length(placement.height)
        c, s = reading.turned(placement.bearing)
        return cls(reading.rotation(placement.turns), Vec(radius * c, radius * s, height))


@dataclass(frozen=True)
class ExactGeometry:
    """Exact geometry of a tree and its loops."""

    links: tuple[Segment, ...]
    shifts: tuple[float, ...]
    gravity: Vec
    reading: Reading
    fixed: Callable[[int, Pose], ExactFrame]

    @classmethod
    def by_axes(cls, description: Description, frames: CanonicalFrames, reading: Reading) -> ExactGeometry:
        """Exact geometry by joint axes, with their special relations."""
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
        """Exact geometry by frames, as in the file."""

        def fixed(_: int, pose: Pose) -> ExactFrame:
            return _as_written(pose, reading)

        links = tuple(_as_in_file(link, reading) for link in description.links)
        gravity = Vec(*(reading.number(simplest_rational(float(g), 10.0)) for g in description.gravity))
        return cls(links, (0.0,) * len(links), gravity, reading, fixed)


def _as_written(pose: Pose, reading: Reading) -> ExactFrame:
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
    """Near coincidences of a geometry, as texts."""
    angles = [str(angle) for angle in near_right_angles(description, AS_GIVEN.angle)]
    return (*angles, *_near_offsets(description, frames), *_near_equals(description, frames))


def taken_as_exact(description: Description, frames: CanonicalFrames) -> tuple[str, ...]:
    """Angles, offsets and equal lengths that are special up to round-off in a file, as texts."""
    right = near_right_angles(description, ROUND_OFF_RATIO)
    angles = [str(angle) for angle in right if abs(angle.deviation) <= AS_GIVEN.angle]
    within = (ROUND_OFF_RATIO, AS_GIVEN.length)
    return (*angles, *_near_offsets(description, frames, within), *_near_equals(description, frames, within))


def _near_offsets(
    description: Description, frames: CanonicalFrames, within: tuple[float, float] = NEARLY
) -> Iterator[str]:
    for link, joint in zip(description.links, frames.joints, strict=True):
        before = "the world" if link.parent == GROUND else description.links[link.parent].joint.name
        for what, offset in (("from", joint.joint.radius), ("along", joint.joint.height)):
            if link.parent != GROUND and _nearly(offset, frames.length, within):
                yield f"{link.joint.name} is only {abs(offset):.1e} m {what} the axis of {before}"


def _near_equals(
    description: Description, frames: CanonicalFrames, within: tuple[float, float] = NEARLY
) -> Iterator[str]:
    for (one, name), (other, another) in pairwise(loop_lengths(description, frames)):
        if one > AS_MEANT.length * frames.length and _nearly(other - one, frames.length, within):
            yield f"the lengths {one:.10g} m at {name} and {other:.10g} m at {another} are nearly equal"


def loop_lengths(description: Description, frames: CanonicalFrames) -> list[tuple[float, str]]:
    """Lengths of closed loops that may be equal, with joint names, ascending."""
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
    """First of each group of nearly equal lengths, ascending."""
    firsts: list[float] = []
    for length in lengths:
        if not firsts or length - firsts[-1] > least:
            firsts.append(length)
    return tuple(firsts)


def _nearly(x: float, length: float, within: tuple[float, float]) -> bool:
    least, most = within
    return least * length < abs(x) <= most * length


def exact_loops(mechanism: Mechanism, geometry: ExactGeometry) -> LoopEquations:
    """Equations of motion of closed loops on exact geometry."""
    description = mechanism.description
    if mechanism.continuation is None or description.loops is None:
        raise InputError(f"{mechanism.name}: the mechanism has no loops")
    equations = mechanism.continuation.equations
    tree = replace(equations.tree, segments=geometry.links, gravity=geometry.gravity)
    pairs = zip(equations.closing.loops, description.loops.closures, strict=True)
    closed = tuple(_exact_loop(loop, closure, description, geometry) for loop, closure in pairs)
    followers = tuple(_exact_follower(follower, geometry) for follower in equations.closing.followers)
    closing = replace(equations.closing, loops=closed, followers=followers)
    return replace(equations, tree=tree, closing=closing, rules=())


def loop_energies(equations: LoopEquations, geometry: ExactGeometry, q: Array, v: Array) -> Any:
    """Energy regressor (samples, P) of closed loops, to 60 digits."""
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
    shifts, links = geometry.shifts, geometry.links
    over = {False: float(1 / geometry.reading.unit), True: 1.0}
    own, other = over[links[follower.follower].turns], over[links[follower.leader].turns]
    shift = shifts[follower.follower] - follower.ratio * shifts[follower.leader]
    return replace(follower, ratio=follower.ratio * own / other, offset=follower.offset * own + shift)
