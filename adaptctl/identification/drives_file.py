"""A drives file: how an arm's motors turn its joints, and which columns of a log are theirs (TOML)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array
from adaptctl.caching import cached_property
from adaptctl.description.drive import Drive
from adaptctl.description.readers.entries import MAX_ENTRIES, Name, Tensor, Triple
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError
from adaptctl.files import read_toml

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "m": 1.0, "mm": 1e-3}
VELOCITY = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "N": 1.0}
TURNING = {"position": ("rad", "deg", "rev"), "velocity": ("rad/s", "deg/s", "rpm"), "torque": ("N m", "mN m")}
SLIDING = {"position": ("m", "mm"), "velocity": ("m/s", "mm/s"), "torque": ("N",)}
"""Units of revolute and of prismatic joints."""
OTHER_TORQUE = ("A", "mA", "%", "1")
"""Units of quantities that are only proportional to a torque."""


@dataclass(frozen=True)
class Units:
    """Units of a log's columns, as factors to SI units: of `time` to s, of `position` to rad (or m), and of `torque` to
    N m (or N), None where the column is only proportional to a torque. `velocity` is the factor to rad/s (or m/s),
    None, the default, where it is not logged. Nothing is checked at construction."""

    time: float
    position: float
    torque: float | None
    velocity: float | None = None

    @classmethod
    def checked(cls, time: str, position: str, torque: str, velocity: str | None = None) -> Units:
        """The units, a `Units`, of columns by symbols: `time` one of s, ms, us, ns; `position` one of rad, deg, rev, m,
        mm; `torque` one of N m (or Nm), mN m, N, or A, mA, %, 1 for a quantity that is only proportional to it;
        `velocity` one of rad/s, deg/s, rpm, m/s, mm/s, or None where it is not logged. Raises `InputError`, which lists
        those that are known, for another symbol."""
        return cls(
            _factor("time", time, TIME),
            _factor("position", position, POSITION),
            None if torque in OTHER_TORQUE else _factor("torque", spaced(torque), TORQUE, OTHER_TORQUE),
            None if velocity is None else _factor("velocity", velocity, VELOCITY),
        )


def validate_fitting(symbols: Mapping[str, str], turns: Mapping[str, bool]) -> None:
    """Raise `InputError`, naming the joint, where a unit cannot be that of a joint's column: one of angles for a joint
    that slides, or one of lengths for one that turns. `symbols` has the units' symbols by "position", "velocity" and
    "torque", other keys do not count, and `turns` by joint whether it turns. SI units are those of joints of both kinds
    where some slide: one column of a message has rad or m, whichever is its joint's."""
    for what, symbol in symbols.items():
        for joint, turning in turns.items():
            own, others = (TURNING, SLIDING) if turning else (SLIDING, TURNING)
            foreign = spaced(symbol) in others.get(what, ())
            if foreign and (spaced(symbol) != others[what][0] or all(turns.values())):
                *first, last = own[what]
                expected = f"{', '.join(first)} or {last}" if first else last
                kind = "turns" if turning else "slides"
                raise InputError(f"unit of {what}: joint {joint!r} {kind}: expected {expected}, got {symbol!r}")


def spaced(symbol: str) -> str:
    """A unit's `symbol`, a text, as tables of factors have it: "Nm" becomes "N m". Nothing is raised."""
    return symbol.replace("Nm", "N m")


def _factor(what: str, symbol: str, known: dict[str, float], others: tuple[str, ...] = ()) -> float:
    if symbol not in known:
        raise InputError(f"unit of {what}: expected one of {', '.join((*known, *others))}, got {symbol!r}")
    return known[symbol]


SCHEMA = "adaptctl/drives/1"


class MotorEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of a motor in a drives file (TOML): its `name`, and the names of the columns of a log with its `position`,
    its `torque` and, if it is logged, its `velocity`.

    `torque_constant` is the torque, N m (N for a linear motor), for one unit of the torque column, such as an ampere;
    "unknown" where it is to be identified, None where the column is a torque already. Entries are checked where
    `read_drives` reads a file (names of 1 to 128 characters, a positive constant); nothing is checked at construction.
    """

    name: Name
    position: Name
    torque: Name
    velocity: Name | None = None
    torque_constant: float | Literal["unknown"] | None = None


class UnitsEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of the units of a log's columns in a drives file (TOML), as symbols: `time` one of s, ms, us, ns;
    `position` one of rad, deg, rev, m, mm; `velocity` one of rad/s, deg/s, rpm, m/s, mm/s, or None where it is not
    logged; `torque` one of N m, mN m, N, or A, mA, %, 1 for a quantity that is only proportional to it. `read_drives`
    refuses other symbols; nothing is checked at construction."""

    time: str
    position: str
    torque: str
    velocity: str | None = None


class PayloadEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of a known payload in a drives file (TOML): a rigid body fixed to the link named `link` throughout one log,
    whose path or file name is `log`.

    `mass` is in kg, `center_of_mass` (3 numbers) in m in the link's frame, and `inertia_at_center` (xx, xy, yy, xz, yz,
    zz) in kg m^2 about that centre, along the frame's axes. Nothing is checked at construction; `identify` refuses
    unknown links and an inertia that no body has.
    """

    log: Name
    link: Name
    mass: float
    center_of_mass: Triple
    inertia_at_center: Tensor


class DrivesFile(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Contents of a drives file (TOML, `schema` "adaptctl/drives/1"): the transmission between an arm's motors and its
    joints, and the columns of a log that are the motors'.

    `joints` are the names of r joints; row i of `transmission` (r rows of r numbers) has the ratios of motor i's speed
    to each joint's speed; `motors` has a `MotorEntry` for each row. `time` is the name of the column of time, `units`
    are the columns' units. The joint positions where the motors are at zero are `joint_offsets` (r numbers, rad, or m
    for a prismatic joint) or `joint_offsets_deg` (degrees), zero without either. `payloads` are known bodies fixed to
    links, and `source` is where the numbers come from, as text. Only types are checked on reading; `read_drives` checks
    the entries against each other, and nothing is checked at construction.
    """

    schema: Literal["adaptctl/drives/1"]
    joints: Annotated[list[Name], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    transmission: Annotated[list[list[float]], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    motors: Annotated[list[MotorEntry], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    time: Name
    units: UnitsEntry
    joint_offsets: list[float] | None = None
    joint_offsets_deg: list[float] | None = None
    payloads: list[PayloadEntry] = []
    source: str = ""


@dataclass(frozen=True, eq=False)
class Drives:
    """Drives of a robot: the transmission between its motors and joints, and the columns of a log that are the motors'.
    Motor positions are transmission (joint positions - offsets), and joint torques are the transposed transmission
    times the motor torques.

    `joints` are the names of the r joints; `transmission` (r, r) has the ratios of each motor's speed (row) to each
    joint's speed (column); `offsets` (r,) are the joint positions, rad (m if prismatic), where the motors are at zero.
    `motors`, r of them, are the names of each motor's columns in a log (position, torque, velocity), and its torque
    constant in N m (N if linear) for a unit of its torque column; `time` is the name of the log's column of time,
    `units` are the factors from the columns' units to SI units. `payloads` are known bodies (mass, kg, centre of mass,
    m, inertia, kg m^2) that are fixed to a link throughout one log, none by default, and `source` is where the numbers
    come from, as text. Raises `InputError` for another number of motors, a transmission or offsets of another shape or
    not finite, a motor that does not turn its own joint, and a transmission from which the joints do not follow (its
    condition number is 1e6 or more); `read_drives` checks the rest.
    """

    joints: tuple[str, ...]
    transmission: Array
    offsets: Array
    motors: tuple[MotorEntry, ...]
    time: str
    units: Units
    payloads: tuple[PayloadEntry, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        r = len(self.joints)
        if len(self.motors) != r:
            raise InputError(f"drives: motors: expected one for each of {r} joints, got {len(self.motors)}")
        transmission = frozen_array(self.transmission, (r, r), "drives: transmission")
        _validate_turning(transmission, self.joints, self.motors, "drives: transmission")
        object.__setattr__(self, "transmission", transmission)
        object.__setattr__(self, "offsets", frozen_array(self.offsets, (r,), "drives: offsets"))

    def position(self, motor: ArrayLike) -> Array:
        """Joint positions (..., r), rad (m if prismatic), of the positions `motor` (..., r) of r motors, rad (m if
        linear): the inverse of the drives' `transmission` (r, r), the ratios of motor to joint speeds, times `motor`,
        plus their `offsets` (r,), the joint positions where the motors are at zero. Raises `InputError` on a wrong
        shape, `NonFiniteError` on NaN or infinity."""
        return checked(motor, len(self.joints), "drives: positions") @ self._inverse.T + self.offsets

    def velocity(self, motor: ArrayLike) -> Array:
        """Joint velocities (..., r), rad/s (m/s if prismatic), of the velocities `motor` (..., r) of r motors, rad/s
        (m/s if linear): the inverse of the drives' `transmission` (r, r), the ratios of motor to joint speeds, times
        `motor`. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
        return checked(motor, len(self.joints), "drives: velocities") @ self._inverse.T

    def torque(self, motor: ArrayLike) -> Array:
        """Joint torques (..., r), N m (N for a prismatic joint), of the torques `motor` (..., r) of r motors, N m (N if
        linear): the transpose of the drives' `transmission` (r, r), the ratios of motor to joint speeds, times `motor`.
        Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
        return checked(motor, len(self.joints), "drives: torques") @ self.transmission

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.transmission))

    @cached_property
    def constants(self) -> Array:
        """Torque constants (r,) of the r motors, in N m (N for a linear motor) for a unit of their torque columns (an
        ampere, say): 1 where these are torques already, NaN where unknown."""
        given = (motor.torque_constant for motor in self.motors)
        return np.array([math.nan if k == "unknown" else 1.0 if k is None else float(k) for k in given])

    def of(self, mechanism: Mechanism) -> Drives:
        """These drives, a `Drives`, with their joints and motors in the order of a mechanism's primary (independent)
        joints. Raises `InputError` unless the drives are of just these joints, by name."""
        names = [joint.name for joint in mechanism.primary_joints]
        if sorted(names) != sorted(self.joints):
            raise InputError(
                f"the drives are of joints {', '.join(self.joints)}; {mechanism.name} has {', '.join(names)}"
            )
        order = [self.joints.index(name) for name in names]
        return Drives(
            tuple(names),
            self.transmission[np.ix_(order, order)],
            self.offsets[order],
            tuple(self.motors[i] for i in order),
            self.time,
            self.units,
            self.payloads,
            self.source,
        )

    def on_joints(self) -> tuple[Drive, ...]:
        """Drives (`Drive`) for a mechanism's description, one for each of r joints in the order of this object's
        `joints`, with no rotor or friction modelled. Each has in `turns_with` the names of the other joints that turn
        its motor, with ratios (no unit): the motor's speed over that joint's speed, divided by the motor's speed over
        its own joint's speed. Raises `InputError` where one of these ratios is too large for a double-precision
        number."""
        ratios = self.transmission / np.diag(self.transmission)[:, None]
        coupled = [
            [(name, float(x)) for j, (name, x) in enumerate(zip(self.joints, row, strict=True)) if x and j != i]
            for i, row in enumerate(ratios)
        ]
        return tuple(Drive(turns_with=tuple(others)) for others in coupled)


def read_drives(path: str | Path) -> Drives:
    """The `Drives` that the TOML file `path` of the schema "adaptctl/drives/1" describes: joints, transmission, motors
    with their columns in a log, units, and, if any, joint offsets and payloads. Raises `FileError`, naming the element,
    for a file that cannot be read or is of another schema, and for entries that contradict each other."""
    content = read_toml(path, DrivesFile)
    try:
        return _checked(content)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _checked(content: DrivesFile) -> Drives:
    r = len(content.joints)
    if len(set(content.joints)) < r:
        raise InputError("$.joints: every joint once")
    if len(content.motors) != r or len(content.transmission) != r or any(len(row) != r for row in content.transmission):
        raise InputError(
            f"$.transmission: expected a row for each of {len(content.motors)} motors, each with a number for each "
            f"of {r} joints, as many motors as joints"
        )
    transmission = frozen_array(content.transmission, (r, r), "$.transmission")
    _validate_turning(transmission, content.joints, content.motors, "$.transmission")
    for i, motor in enumerate(content.motors):
        k = motor.torque_constant
        if isinstance(k, float) and not (math.isfinite(k) and k > 0.0):
            raise InputError(f"$.motors[{i}].torque_constant: expected a positive number or 'unknown', got {k}")
    units = Units.checked(**{name: getattr(content.units, name) for name in ("time", "position", "torque", "velocity")})
    _validate_constants(content, units)
    return Drives(
        tuple(content.joints),
        transmission,
        _offsets(content, r),
        tuple(content.motors),
        content.time,
        units,
        tuple(content.payloads),
        content.source.strip(),
    )


def _validate_turning(transmission: Array, joints: Sequence[str], motors: Sequence[MotorEntry], what: str) -> None:
    """Raise `InputError` unless each motor turns its own joint, and the joints follow from the motors."""
    for i, (motor, joint) in enumerate(zip(motors, joints, strict=True)):
        if not transmission[i, i]:
            raise InputError(f"{what}[{i}]: motor {motor.name!r} must turn its own joint {joint!r}")
    if not np.linalg.cond(transmission) < 1e6:
        raise InputError(f"{what}: the joints do not follow from the motors: two rows are alike")


def _validate_constants(content: DrivesFile, units: Units) -> None:
    for i, motor in enumerate(content.motors):
        if units.torque is None and motor.torque_constant is None:
            raise InputError(
                f"$.motors[{i}].torque_constant is missing: {content.units.torque!r} is no torque; give N m for a unit "
                "of it, or 'unknown'"
            )
        if units.torque is not None and motor.torque_constant not in (None, 1.0):
            raise InputError(f"$.motors[{i}].torque_constant: the log has torques in {content.units.torque}; remove it")


def _offsets(content: DrivesFile, r: int) -> Array:
    if content.joint_offsets is not None and content.joint_offsets_deg is not None:
        raise InputError("the joint offsets are given twice: keep joint_offsets (rad) or joint_offsets_deg")
    degrees = np.radians(content.joint_offsets_deg) if content.joint_offsets_deg is not None else np.zeros(r)
    return frozen_array(degrees if content.joint_offsets is None else content.joint_offsets, (r,), "$.joint_offsets")
