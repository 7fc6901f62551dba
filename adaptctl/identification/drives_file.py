"""Drives files (TOML)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array
from adaptctl.caching import cached_property
from adaptctl.content_words import told_all
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError
from adaptctl.files import read_text, read_toml, with_line
from adaptctl.identification.column_units import Units, factor
from adaptctl.identification.drives_content import (
    DrivesFile,
    MotorEntry,
    PayloadEntry,
    UnitsEntry,
    joint_offsets,
    wrong_drives,
    wrong_turning,
)


def locking(missing: Sequence[str], known: Sequence[str], names: Sequence[str]) -> str:
    """Words that offer to lock the joints that a log has not; none where it has other joints."""
    fitting = missing and len(missing) < len(names) and set(known) <= set(names)
    return f"; if the others did not move: --lock {' '.join(missing)}" if fitting else ""


@dataclass(frozen=True, eq=False)
class Drives:
    """
    Transmission between a robot's motors and joints, and the columns of a log that hold the motors' values.

    Parameters
    ----------
    joints : tuple of str
        Names of the r joints.
    transmission : numpy.ndarray
        Ratios (r, r) of each motor's speed (row) to each joint's speed (column).
    offsets : numpy.ndarray
        Joint positions (r,) in rad (m) where the motors are at zero.
    motors : tuple of MotorEntry
        Names of each motor's columns, and its torque constant in N m (N) per unit of its torque column.
    time : str
        Name of the column of time.
    units : Units
        Factors that convert the columns to SI units.
    payloads : tuple of PayloadEntry, optional
        Bodies that are fixed to a link in one log. None by default.
    source : str, default ""
        Source of the numbers in words, such as a data sheet. Default: unknown.

    Raises
    ------
    InputError
        If shapes or numbers of motors differ, a number is not finite, a motor does not turn its own joint, or the
        transmission's condition number is 1e6 or more.

    Notes
    -----
    Motor positions are :math:`T (p - p_0)` with the transmission :math:`T` and offsets :math:`p_0`; joint torques are
    :math:`T^T` times motor torques.

    Examples
    --------
    >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
    >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
    >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
    >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
    >>> drives.torque([0.1, 0.2]).tolist()
    [7.0, 10.0]
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
            raise InputError(f"drives: motors: expected one per joint ({r}), got {len(self.motors)}")
        transmission = frozen_array(self.transmission, (r, r), "drives: transmission")
        if wrong := list(
            wrong_turning(transmission, self.joints, [m.name for m in self.motors], "drives: transmission")
        ):
            raise InputError("; ".join(wrong))
        object.__setattr__(self, "transmission", transmission)
        object.__setattr__(self, "offsets", frozen_array(self.offsets, (r,), "drives: offsets"))

    def __repr__(self) -> str:
        return f"<Drives of {len(self.joints)} joints>"

    def position(self, motor: ArrayLike) -> Array:
        """
        Compute joint positions from motor positions.

        Parameters
        ----------
        motor : array_like
            Motor positions (..., r) in rad, or m for a linear motor.

        Returns
        -------
        numpy.ndarray
            Joint positions (..., r) in rad, or m for a prismatic joint.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
        >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
        >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
        >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
        >>> drives.position([5.0, 6.0]).round(3).tolist()
        [0.1, 0.1]
        """
        return checked(motor, len(self.joints), "drives: positions") @ self._inverse.T + self.offsets

    def velocity(self, motor: ArrayLike) -> Array:
        """
        Compute joint velocities from motor velocities.

        Parameters
        ----------
        motor : array_like
            Motor velocities (..., r) in rad/s, or m/s for a linear motor.

        Returns
        -------
        numpy.ndarray
            Joint velocities (..., r) in rad/s, or m/s for a prismatic joint.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
        >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
        >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
        >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
        >>> drives.velocity([5.0, 6.0]).round(3).tolist()
        [0.1, 0.1]
        """
        return checked(motor, len(self.joints), "drives: velocities") @ self._inverse.T

    def torque(self, motor: ArrayLike) -> Array:
        """
        Compute joint torques from motor torques.

        Parameters
        ----------
        motor : array_like
            Motor torques (..., r) in N m, or N for a linear motor.

        Returns
        -------
        numpy.ndarray
            Joint torques (..., r) in N m, or forces in N for a prismatic joint.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
        >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
        >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
        >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
        >>> drives.torque([0.1, 0.2]).round(3).tolist()
        [7.0, 10.0]
        """
        return checked(motor, len(self.joints), "drives: torques") @ self.transmission

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.transmission))

    @cached_property
    def constants(self) -> Array:
        """Torque constants (r,) in N m (N) per unit of the torque columns: 1 for torques, NaN where unknown."""
        given = (motor.torque_constant for motor in self.motors)
        return np.array([math.nan if k == "unknown" else 1.0 if k is None else float(k) for k in given])

    @cached_property
    def position_factors(self) -> Array:
        """Factors (r,) that convert each motor's positions to rad (m)."""
        own = [motor.position_unit for motor in self.motors]
        return np.array([self.units.position if unit is None else factor("position", unit) for unit in own])

    @cached_property
    def velocity_factors(self) -> Array:
        """Factors (r,) that convert each motor's velocities to rad/s (m/s); NaN where the unit is unknown."""
        general = math.nan if self.units.velocity is None else self.units.velocity
        own = [motor.velocity_unit for motor in self.motors]
        return np.array([general if unit is None else factor("velocity", unit) for unit in own])

    def ordered_like(self, mechanism: Mechanism) -> Drives:
        """
        Return the drives in the order of a mechanism's joints.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with the same primary (independent) joints.

        Returns
        -------
        Drives
            Drives in the mechanism's order of joints.

        Raises
        ------
        InputError
            If the mechanism has joints of other names.

        Examples
        --------
        >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
        >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
        >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
        >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
        >>> drives.ordered_like(arm).joints
        ('shoulder', 'elbow')
        """
        names = [joint.name for joint in mechanism.primary_joints]
        locked = {name: x for name, x in mechanism.description.locked.items() if name in self.joints}
        if locked and sorted([*names, *locked]) == sorted(self.joints):
            return self._without(locked).ordered_like(mechanism)
        if sorted(names) != sorted(self.joints):
            raise InputError(
                f"the drives are for the joints {', '.join(self.joints)}, but {mechanism.name} has {', '.join(names)}"
                f"{locking([name for name in names if name not in self.joints], self.joints, names)}"
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

    def _without(self, locked: Mapping[str, float]) -> Drives:
        """Drives of the joints that are not locked at some positions."""
        kept = [i for i, name in enumerate(self.joints) if name not in locked]
        held = [i for i, name in enumerate(self.joints) if name in locked]
        own, others = self.transmission[np.ix_(kept, kept)], self.transmission[np.ix_(kept, held)]
        if self.transmission[np.ix_(held, kept)].any():
            raise InputError(
                f"lock: the motors of {', '.join(locked)} turn with other joints too, which are not locked"
            )
        still = np.array([locked[self.joints[i]] for i in held]) - self.offsets[held]
        return Drives(
            tuple(self.joints[i] for i in kept),
            own,
            self.offsets[kept] - np.linalg.solve(own, others @ still),
            tuple(self.motors[i] for i in kept),
            self.time,
            self.units,
            self.payloads,
            self.source,
        )

    def joint_drives(self) -> tuple[Drive, ...]:
        """
        Return the drive of each joint for a mechanism's description, without rotor inertia and friction.

        Returns
        -------
        tuple of Drive
            Drive of each of the r joints, coupled with the other joints that turn its motor.

        Raises
        ------
        InputError
            If a ratio overflows.

        Examples
        --------
        >>> from adaptctl.identification.drives_file import Drives, MotorEntry, Units
        >>> motors = tuple(MotorEntry(name=name, position=name, torque=f"{name}.i") for name in ("m1", "m2"))
        >>> ratios = np.array([[50.0, 0.0], [10.0, 50.0]])
        >>> drives = Drives(("shoulder", "elbow"), ratios, np.zeros(2), motors, "t", Units(1.0, 1.0, 1.0))
        >>> drives.joint_drives()[1].turns_with
        (('shoulder', 0.2),)
        """
        ratios = self.transmission / np.diag(self.transmission)[:, None]
        coupled = [
            [(name, float(x)) for j, (name, x) in enumerate(zip(self.joints, row, strict=True)) if x and j != i]
            for i, row in enumerate(ratios)
        ]
        return tuple(Drive(turns_with=tuple(others)) for others in coupled)


def read_drives(path: str | Path) -> Drives:
    r"""
    Read drives from a TOML file.

    Parameters
    ----------
    path : str or pathlib.Path
        File of the schema "adaptctl/drives/1".

    Returns
    -------
    Drives
        Transmission, names and units of columns, and payloads.

    Raises
    ------
    FileError
        If the file cannot be read, or an element is wrong or contradicts another, which the message names.

    Examples
    --------
    >>> from adaptctl.identification import read_drives
    >>> lines = ['schema = "adaptctl/drives/1"', 'joints = ["elbow"]', "transmission = [[100.0]]", 'time = "t"',
    ...          "[units]", 'time = "s"', 'position = "rad"', 'torque = "N m"',
    ...          "[[motors]]", 'name = "m1"', 'position = "m1.q"', 'torque = "m1.tau"']
    >>> _ = (tmp / "drives.toml").write_text("\n".join(lines))
    >>> read_drives(tmp / "drives.toml").joints
    ('elbow',)
    """
    content = read_toml(path, DrivesFile)
    if wrong := list(wrong_drives(content)):
        text = read_text(path)
        raise FileError(f"{path}: {told_all([with_line(one, text) for one in wrong])}")
    units, r = content.units, len(content.joints)
    pairs = zip(content.motors, content.joints, strict=True)
    return Drives(
        tuple(content.joints),
        np.array(content.transmission),
        np.zeros(r) if (offsets := joint_offsets(content)) is None else np.array(offsets),
        tuple(_completed(motor, joint, units) for motor, joint in pairs),
        content.time,
        Units.checked(units.time, units.position, units.torque, units.velocity),
        tuple(content.payloads),
        content.source.strip(),
    )


def _completed(motor: MotorEntry, joint: str, units: UnitsEntry) -> MotorEntry:
    """Motor with a name and units."""
    position, velocity = motor.position_unit or units.position, motor.velocity_unit or units.velocity
    return replace(motor, name=motor.name or joint, position_unit=position, velocity_unit=velocity)
