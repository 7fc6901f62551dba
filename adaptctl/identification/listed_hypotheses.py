"""Hypotheses about what a log's columns mean: signs, order, zeros, gravity, scales, springs and payloads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import combinations
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identification.delay import Delay
from adaptctl.identification.hypothesis_rows import HypothesisRows, MotionProducts, relative_error
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.time_scale import ScaledTimes
from adaptctl.identification.turned_torques import turned_torques
from adaptctl.logs.units import POSITION

# Error as the log is over that of a hypothesis from which on this is named and, if it refuses, the log is refused; and
# from which on one is named that tells by itself that it is beyond doubt.
MARGIN, LEAST_MARGIN = 1.5, 1.1
# Errors are means of joints: where a fault of one joint is enough, more joints are asked for no more than three are.
JOINTS = 3
# Factor of one torque from which on it is no calibration; octaves that are tried, and steps of the search in one.
LEAST_SCALE, OCTAVES, SCALE_STEPS = 2.0, 10, 8
# m/s^2, for a file without gravity; rounds of the search for a tilt.
GRAVITY, TILT_ROUNDS = 9.81, 6
# Rounds and step (rad, m) of the search for a joint's zero, and angle (rad) of a zero or a tilt, and distance (m) of a
# zero, that are no refusal; quarter turns.
ZERO_ROUNDS, ZERO_STEP, SMALL_ANGLE, SMALL_SHIFT = 3, 1e-3, 0.2, 0.1
QUARTERS = (0.5 * np.pi, np.pi, -0.5 * np.pi)
# Numbers between which joints usually move in a unit.
USUAL_WAYS = {"rad": (0.2, 12.0), "deg": (12.0, 700.0), "rev": (0.03, 1.0)}
SPRING, COUNTERBALANCE, DELAY = "a spring", "a counterbalance", "delay of the torques"


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Hypothesis: kind, words, what to do if it is so, equations, and whether and from which margin on it refuses."""

    kind: str
    words: str
    remedy: str
    equations: Callable[[], NormalEquations]
    refuses: bool = True
    margin: float = MARGIN
    refusal: float = MARGIN
    holds: Callable[[Array], bool] = lambda x: True
    told: Callable[[Array], str] = lambda x: ""


def listed_hypotheses(rows: HypothesisRows, delay: Delay) -> Iterator[Hypothesis]:
    """Hypotheses that are compared, without that the log is right as it is."""
    yield Hypothesis(
        DELAY,
        delay.words,
        "check the filters and clocks of the log",
        partial(rows.later, delay.value),
        refuses=False,
        holds=lambda x: delay.counts,
    )
    yield from _units(rows)
    yield from _signs(rows)
    yield from _swaps(rows)
    yield from _zeros(rows)
    yield from _gravities(rows)
    yield from _scales(rows)
    yield from () if rows.springs else _springs(rows)
    yield from _payloads(rows)


def of_one(margin: float, joints: int) -> float:
    """Margin of the mean of joints for which a fault of one is enough."""
    return float(margin ** min(1.0, JOINTS / joints))


def _mixing(rows: HypothesisRows, change: Array) -> Array:
    """Matrix (r, r) of joint torques whose motors' torque columns are changed by a matrix."""
    drives = rows.evidence.drives
    T, k = drives.transmission, drives.constants
    return np.asarray(T.T @ (change * np.outer(k, 1.0 / k)) @ np.linalg.inv(T.T))


def _moved(rows: HypothesisRows, change: Array, shift: Array | float = 0.0) -> PackedRegressor:
    """Regressor of the motion whose motors' positions are changed by a matrix, and joints' by a shift (r,)."""
    drives = rows.evidence.drives
    D = np.linalg.inv(drives.transmission) @ change @ drives.transmission
    position = (rows.position - drives.offsets) @ D.T + drives.offsets + shift
    return rows.regressor(rows.evidence.mechanism, position, rows.velocity @ D.T, rows.acceleration @ D.T)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion whose motors' positions are changed by a matrix, and that of several hypotheses on torques."""

    rows: HypothesisRows
    change: Array

    @cached_property
    def products(self) -> MotionProducts:
        """Products of the motion's rows."""
        return self.rows.products(_moved(self.rows, self.change))

    def with_torques(self, change: Array) -> NormalEquations:
        """Normal equations of the motion and of torques whose motors' columns are changed by a matrix."""
        return self.rows.mixed(_mixing(self.rows, change), self.products)


def _units(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Angles in rad that were stated in deg, and in deg stated in rad; and those of one joint in a unit of its own."""
    turns = np.array([joint.kind.is_revolute for joint in rows.evidence.mechanism.primary_joints])
    others = {POSITION["deg"]: ("rad", "deg"), POSITION["rad"]: ("deg", "rad")}
    stated_units = set(rows.evidence.drives.position_factors[turns].tolist())
    own = stated_units.pop() if len(stated_units) == 1 else None
    if own in others:
        meant, stated = others[own]
        meant_motion = _Motion(rows, np.diag(np.where(turns, POSITION[meant] / own, 1.0))).with_torques
        words, remedy = f"positions are in {meant}, not {stated}", f"give position={meant} as their unit"
        yield Hypothesis("unit of positions", words, remedy, partial(meant_motion, np.eye(len(turns))))
    for j in np.flatnonzero(turns).tolist():
        yield from _own_unit(rows, j)


def _own_unit(rows: HypothesisRows, j: int) -> Iterator[Hypothesis]:
    """Units of a motor's positions in whose numbers joints move usual ways."""
    motor, one = rows.evidence.drives.motors[j], np.eye(rows.evidence.mechanism.dof)
    own = float(rows.evidence.drives.position_factors[j])
    way = float(np.ptp(rows.position[:, j])) / own
    stated = next((unit for unit, factor in POSITION.items() if factor == own), "as stated")
    for meant, (least, most) in USUAL_WAYS.items():
        if least < way < most and POSITION[meant] != own:
            scaled = _Motion(rows, np.diag(np.where(one[j] > 0.0, POSITION[meant] / own, 1.0))).with_torques
            words = f"column {motor.position!r} is in {meant}, not {stated}"
            remedy = "give each joint's unit: position=rad,deg,..."
            yield Hypothesis("unit of a joint's positions", words, remedy, partial(scaled, one))


def _signs(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Signs of one torque column, of one position column, of both, and of all torques."""
    motors, one = rows.evidence.drives.motors, np.eye(rows.evidence.mechanism.dof)
    for j, motor in enumerate(motors):
        other = one - 2.0 * np.diag(one[j])
        torque, position = f"column {motor.torque!r}", f"column {motor.position!r}"
        mixed = partial(rows.mixed, _mixing(rows, other))
        yield Hypothesis("sign of a torque", f"{torque} has the other sign", "negate it", mixed)
        turned = _Motion(rows, other).with_torques
        yield Hypothesis("sign of a position", f"{position} has the other sign", "negate it", partial(turned, one))
        words = f"columns {motor.position!r} and {motor.torque!r} both have the other sign: {motor.name} is mirrored"
        remedy = "negate both (and the velocity), or turn the axis of the joint in the robot file"
        yield Hypothesis("a mirrored joint", words, remedy, partial(turned, other))
    for turn in turned_torques(rows, [_mixing(rows, one - 2.0 * np.diag(own)) for own in one]):
        log = f" of {turn.source}" if len(rows.sources) > 1 else ""
        words = f"column {motors[turn.joint].torque!r}{log} has the other sign from {turn.time:.4g} s on"
        remedy = "negate it there, or cut the log there"
        turned = partial(replace, turn.equations)
        least = of_one(MARGIN, len(motors))  # as nothing else agrees before and after
        yield Hypothesis("a sign that turns", words, remedy, turned, margin=LEAST_MARGIN, refusal=least)
    if len(motors) > 1:
        yield Hypothesis(
            "sign of all torques", "all torques have the other sign", "negate them", partial(rows.mixed, -one)
        )


def _swaps(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Two torque columns, two position columns, or two joints, that stand for each other."""
    motors, one = rows.evidence.drives.motors, np.eye(rows.evidence.mechanism.dof)
    for i, j in combinations(range(len(motors)), 2):
        order = np.arange(len(motors))
        order[[i, j]] = j, i
        swap, first, second = one[order], motors[i], motors[j]
        swapped = _Motion(rows, swap).with_torques
        named = "exchange their names, in the log or by columns"
        words = f"columns {first.torque!r} and {second.torque!r} are exchanged"
        yield Hypothesis("two torques exchanged", words, named, partial(rows.mixed, _mixing(rows, swap)))
        words = f"columns {first.position!r} and {second.position!r} are exchanged"
        yield Hypothesis("two positions exchanged", words, named, partial(swapped, one))
        words = f"all columns of {first.name} and {second.name} are exchanged"
        yield Hypothesis("two joints exchanged", words, named, partial(swapped, swap))


def _zeros(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Positions of a joint that are off, by quarter turns or by the value at which least squares fits best."""
    joints = rows.evidence.mechanism.primary_joints
    for j, joint in enumerate(joints):
        one, turns = np.eye(len(joints))[j], joint.kind.is_revolute
        for shift in (*(QUARTERS if turns else ()), _zero(rows, one)):
            told = f"{np.degrees(shift):.3g} deg" if turns else f"{shift:.3g} m"
            added, offsets = (f"{shift:.4g} rad ({told})", "_deg") if turns else (f"{shift:.4g} m", "")
            yield Hypothesis(
                "zero of a joint",
                f"{joint.name} is at {told} where its column has 0",
                f"add {added} to its positions, or give joint_offsets{offsets} in a drives file",
                partial(_shifted, rows, shift * one),
                refuses=abs(shift) > (SMALL_ANGLE if turns else SMALL_SHIFT),
            )


def _zero(rows: HypothesisRows, joint: Array) -> float:
    """Angle (rad) or distance (m) that a joint is off by, near 0, by Gauss-Newton steps of least squares."""
    shift, torque = 0.0, rows.rows.torque
    for _ in range(ZERO_ROUNDS):
        Y, near = (_moved(rows, np.eye(len(joint)), a * joint) for a in (shift, shift + ZERO_STEP))
        x, _ = rows.least(rows.sums(Y, torque))
        column = (near.torques(x) - Y.torques(x))[..., None] / ZERO_STEP
        x, _ = rows.least(rows.sums(Y.beside(column), torque))
        shift += float(np.clip(x[-1], -0.5, 0.5))
        if abs(x[-1]) < ZERO_STEP:
            break
    return shift


def _shifted(rows: HypothesisRows, shift: Array) -> NormalEquations:
    return rows.sums(_moved(rows, np.eye(len(shift)), shift), rows.rows.torque)


def _under(mechanism: Mechanism, gravity: Array) -> Mechanism:
    return type(mechanism)(replace(mechanism.description, gravity=gravity))


def _gravities(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Gravity along the axes of the base, at a tilt, and none."""
    mechanism, still = rows.evidence.mechanism, np.zeros_like(rows.position)
    file = mechanism.description.gravity
    size = float(np.linalg.norm(file)) or GRAVITY
    pull = _Pull.of(
        rows.regressor(_under(mechanism, np.zeros(3)), rows.position, rows.velocity, rows.acceleration),
        [rows.regressor(_under(mechanism, e), rows.position, still, still) for e in np.eye(3)],
        mechanism.num_energy_parameters,
    )
    directions = [size * sign * e for e in np.eye(3) for sign in (1.0, -1.0)]
    turned = [g for g in directions if not np.allclose(g, file, atol=0.1 * size)]
    tilted = _tilted(rows, pull, [file if file.any() else directions[-1], *turned])
    for gravity in (*turned, tilted):
        yield Hypothesis(
            "gravity turned",
            f"gravity is along {_listed(gravity)} m/s^2 in the base frame, not {_listed(file)}",
            "turn the base in the robot file as the robot is mounted",
            partial(_pulled, rows, pull, gravity),
            refuses=not gravity @ file > np.cos(SMALL_ANGLE) * size**2,
        )
    if file.any():
        yield Hypothesis(
            "gravity absent",
            "the torques are without gravity's: the log is of a gravity-compensated torque, or of no gravity",
            "add the torque that compensates gravity, or give the robot file a gravity of 0",
            partial(rows.sums, pull.none, rows.rows.torque),
        )
        times = ScaledTimes.of(rows, lambda multiple: pull.by(multiple * file))
        scale = times.best()
        yield Hypothesis(
            "scale of the times",
            scale.words,
            f"check column {rows.evidence.drives.time!r} or the sample rate; if right, check the lengths in the robot "
            "file, and that the log is this robot's",
            partial(times.equations, scale.value),
            holds=lambda x: scale.counts,
            margin=LEAST_MARGIN,
        )


def _listed(vector: Array) -> str:
    return f"({', '.join(f'{x + 0.0:.3g}' for x in vector.round(3))})"


class _Pull(NamedTuple):
    """Regressor without gravity, and what each component (3, n, K) of gravity adds to its entries."""

    none: PackedRegressor
    along: Array

    @classmethod
    def of(cls, none: PackedRegressor, pulled: Sequence[PackedRegressor], parameters: int) -> _Pull:
        """Regressors at rest under unit gravity, of which those of parameters from some index on are no gravity."""
        entries = reduce(np.union1d, [one.entries for one in pulled], none.entries)
        along = np.stack([one.spread(entries).values for one in pulled])
        along[..., entries % none.shape[1] >= parameters] = 0.0  # friction at rest
        return cls(none.spread(entries), along)

    def by(self, gravity: Array) -> PackedRegressor:
        """Regressor under some gravity (3,)."""
        return self.none._replace(values=self.none.values + np.tensordot(gravity, self.along, axes=1))

    def across(self, directions: Array, x: Array) -> Array:
        """Torques (n, r, k) of parameters by a unit of gravity in each of some directions (k, 3)."""
        each = [self.none._replace(values=np.tensordot(e, self.along, axes=1)).torques(x) for e in directions]
        return np.stack(each, axis=-1)


def _pulled(rows: HypothesisRows, pull: _Pull, gravity: Array) -> NormalEquations:
    return rows.sums(pull.by(gravity), rows.rows.torque)


def _tilted(rows: HypothesisRows, pull: _Pull, starts: Sequence[Array]) -> Array:
    """Gravity (3,) at which least squares fits best, by Gauss-Newton steps from the best of some of the same size."""
    sums = partial(_pulled, rows, pull)
    gravity = min(starts, key=lambda g: relative_error(own := sums(g), rows.least(own)[0]))
    for _ in range(TILT_ROUNDS):
        x, _ = rows.least(sums(gravity))
        across = np.linalg.svd(gravity[None])[2][1:]
        equations = rows.sums(pull.by(gravity).beside(pull.across(across, x)), rows.rows.torque)
        moved = gravity + rows.least(equations)[0][-2:] @ across
        gravity = moved * np.linalg.norm(gravity) / np.linalg.norm(moved)
    return np.asarray(gravity)


def _scales(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Factors on one torque column that are no calibration: another unit, or the other side of a gear."""
    motors = rows.evidence.drives.motors
    for j, motor in enumerate(motors if len(motors) > 1 else ()):
        tried = 2.0 ** np.arange(1, OCTAVES + 1)
        best = _best_scale(rows, j, np.append(tried, 1.0 / tried))
        near = best * 2.0 ** np.linspace(-1.0, 1.0, SCALE_STEPS + 1)
        best = _best_scale(rows, j, near[np.maximum(near, 1.0 / near) >= LEAST_SCALE])
        yield Hypothesis(
            "scale of a torque",
            f"column {motor.torque!r} is about {1.0 / best:.2g} times the torque, beside the others",
            "check its unit, torque constant and gear ratio",
            partial(rows.mixed, _mixing(rows, _scale(rows, j, best))),
        )


def _scale(rows: HypothesisRows, j: int, factor: float) -> Array:
    return np.diag(np.where(np.arange(rows.evidence.mechanism.dof) == j, factor, 1.0))


def _best_scale(rows: HypothesisRows, j: int, factors: Array) -> float:
    errors = rows.least_errors(np.stack([_mixing(rows, _scale(rows, j, factor)) for factor in factors]))
    return float(factors[np.argmin(errors)])


def _beside(rows: HypothesisRows, columns: Array) -> NormalEquations:
    """Equations with further columns (n, r, k)."""
    return rows.sums(rows.packed.beside(columns), rows.rows.torque)


def _springs(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """Springs and counterbalances of single joints, which the model may not have."""
    joints, remedy = (
        rows.evidence.mechanism.primary_joints,
        "--friction viscous,coulomb,offset,stiffness (or sine,cosine) has such a term; without, it is taken for mass",
    )
    for j, joint in enumerate(joints):
        own = rows.position[:, j, None]
        one = np.eye(len(joints))[j]
        unit = "N m/rad" if joint.kind.is_revolute else "N/m"
        straight = rows.filtered(own)[:, None, :] * one[:, None]
        spring = partial(_stiffness, len(rows.evidence.mechanism.parameter_names), unit)
        yield Hypothesis(
            SPRING,
            f"a spring is at {joint.name}",
            remedy,
            partial(_beside, rows, straight),
            refuses=False,
            told=spring,
        )
        if joint.kind.is_revolute:
            waves = rows.filtered(np.concatenate([np.sin(own), np.cos(own)], axis=-1))[:, None, :] * one[:, None]
            words = f"a counterbalance is at {joint.name}"
            yield Hypothesis(COUNTERBALANCE, words, remedy, partial(_beside, rows, waves), refuses=False)


def _stiffness(place: int, unit: str, x: Array) -> str:
    return f", of {x[place]:.3g} {unit}"


def _payloads(rows: HypothesisRows) -> Iterator[Hypothesis]:
    """A body at a last link in one of several logs."""
    description = rows.evidence.mechanism.description
    size = len(rows.evidence.mechanism.parameter_names)
    inner = {description.links[i].parent for i in description.bodies}
    last = [(k, i) for k, i in enumerate(description.bodies) if i not in inner]
    for source in rows.sources if len(rows.sources) > 1 else ():
        here = rows.of_source(source)[:, None, None]
        for k, i in last:
            columns = rows.rows.regressor[..., 10 * k : 10 * k + 10] * here
            link = description.links[i].name
            yield Hypothesis(
                "a payload in one log",
                f"{link} carries a body in {source} that it has not in the other logs",
                "state it under payloads in a drives file, or leave this log out",
                partial(_beside, rows, columns),
                refuses=False,
                holds=partial(_weighs, size),
                told=partial(_mass, size),
            )


def _weighs(place: int, x: Array) -> bool:
    return bool(x[place] > 0.0)


def _mass(place: int, x: Array) -> str:
    return f", of {x[place]:.2g} kg"
