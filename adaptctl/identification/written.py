"""Files of an identified robot, and what they predict when loaded again."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import STANDARD_GRAVITY
from adaptctl.description.drive import DISSIPATIVE, MAY_BE_NEGATIVE, Drive, DriveParameter
from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.description.writers.robot_file import with_comment, write_urdf
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.drive import friction
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.files import read_bytes, write_bytes, write_text
from adaptctl.identification.identification import Identification
from adaptctl.identification.validation import Validation

TOML, URDF, MJCF = "robot.toml", "robot.urdf", "robot.xml"
# Terms of drives that a format has no place for; neither has coupled drives.
NOT_IN = {URDF: {DriveParameter.ROTOR_INERTIA, *MAY_BE_NEGATIVE}, MJCF: set(MAY_BE_NEGATIVE)}
FORMATS = {URDF: "URDF", MJCF: "MJCF"}


@dataclass(frozen=True, eq=False)
class WrittenRobot:
    """File of an identified robot: its name, the robot that it gives, its validation, and what it cannot hold."""

    name: str
    robot: Mechanism
    validation: Validation
    missing: tuple[str, ...]

    def note(self, found: Identification) -> str | None:
        """Sentence on what the file cannot hold, and what its predictions are without; None if it holds all."""
        if not self.missing:
            return None
        words = f"{self.name}: {FORMATS[self.name]} has no place for {'; '.join(self.missing)}"
        whole, own = ([f"{x:.1%}" for x in v.relative_errors.values()] for v in (found.validation, self.validation))
        if whole == own:
            return words
        units = self.validation.relative_errors
        errors = ", ".join(f"{x} of the measured {_effort(unit)}" for unit, x in zip(units, own, strict=True))
        before = ", ".join(whole)
        return f"{words}; with the nearest viscous and Coulomb friction its error is {errors} instead of {before}"


def _effort(unit: str) -> str:
    return "torque" if unit == "N m" else "force"


def write_robots(
    folder: Path, found: Identification, robot: str | Path | None = None, before: Mechanism | None = None
) -> Iterator[WrittenRobot]:
    """Write the robot in every format that can say it, load each file again, and judge it on the rows held out."""
    description, simple = found.mechanism.description, simplified(found)
    write_mechanism(folder / TOML, description)
    yield _judged(folder / TOML, found)
    if robot is not None and before is not None and Path(robot).suffix.lower() == ".urdf":
        write_urdf(folder / URDF, robot, before.description, simple.description)
        if missing := (*missing_terms(found.mechanism, URDF), *_reading(before)):
            comment = f"adaptctl identify: URDF has no place for {'; '.join(missing)}; robot.toml has all"
            write_bytes(folder / URDF, with_comment(read_bytes(folder / URDF), comment))
        yield _judged(folder / URDF, found, before)
    with suppress(InputError, ImportError):  # MuJoCo is not installed, or its models have no place for the robot
        from adaptctl.description.writers.mujoco_model import mjcf_text

        write_text(folder / MJCF, mjcf_text(simple.description))
        yield _judged(folder / MJCF, found)


def _judged(path: Path, found: Identification, before: Mechanism | None = None) -> WrittenRobot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # said when the robot was first read
        robot = load(path) if before is None else _as_read(path, before)
    if robot.dof != found.mechanism.dof and before is not None:
        raise AdaptctlError(f"{path.name}: has {robot.dof} joints instead of {found.mechanism.dof} when loaded again")
    validation, _ = found.held_out.judged(robot)
    return WrittenRobot(path.name, robot, validation, missing_terms(found.mechanism, path.name))


def _as_read(path: Path, before: Mechanism) -> Mechanism:
    """Robot of a URDF file with the gravity and the locked joints that the first one was read with."""
    description = before.description
    return load(path, gravity=description.gravity, lock=description.locked)


def _reading(before: Mechanism) -> Iterator[str]:
    """Gravity other than the usual and locked joints, of which URDF says nothing."""
    description = before.description
    if not np.array_equal(description.gravity, STANDARD_GRAVITY):
        yield f"gravity {description.gravity.tolist()} m/s^2"
    if description.locked:
        yield f"the locked joints {', '.join(f'{name}={x:.6g}' for name, x in description.locked.items())}"


def missing_terms(mechanism: Mechanism, name: str) -> tuple[str, ...]:
    """Terms of the drives, with their values, that a file of some format cannot hold."""
    unknown = NOT_IN.get(name, set())
    found = []
    for joint in mechanism.primary_joints:
        terms = [(k, joint.drive.value(k)) for k in DriveParameter if k in unknown and joint.drive.value(k)]
        said = [f"{k.value.replace('_', ' ')} {x:.4g}" for k, x in terms]
        if name in FORMATS and joint.drive.turns_with:
            said += [f"turns with {other} ({ratio:g})" for other, ratio in joint.drive.turns_with]
        found += [f"{joint.name} {', '.join(said)}"] if said else []
    return tuple(found)


def simplified(found: Identification) -> Mechanism:
    """Mechanism whose drives have the terms that URDF and MJCF know, nearest to their friction at the logs' speeds."""
    speeds = np.concatenate([motion.velocity for motion in found.motions])
    joints = [joint.name for joint in found.mechanism.primary_joints]
    terms = dict(zip(joints, _two_terms(found.mechanism, speeds), strict=True))
    each = [_simplified(link.joint.drive, terms.get(link.joint.name)) for link in found.mechanism.links]
    return found.mechanism.with_drives(each)


def _simplified(drive: Drive, terms: tuple[float | None, float | None] | None) -> Drive:
    viscous, coulomb = (drive.viscous, drive.coulomb) if terms is None else terms
    plain = drive.with_terms(dict.fromkeys(MAY_BE_NEGATIVE))
    return replace(plain, viscous=viscous, coulomb=coulomb, turns_with=())


def _two_terms(mechanism: Mechanism, speeds: Array) -> list[tuple[float | None, float | None]]:
    """Viscous and Coulomb friction of each joint by nonnegative least squares on its friction at given speeds."""
    joints = mechanism.primary_joints
    index = {joint.name: j for j, joint in enumerate(joints)}
    torque = np.zeros_like(speeds)
    for j, joint in enumerate(joints):
        arms = [(j, 1.0), *((index[name], ratio) for name, ratio in joint.drive.turns_with)]
        shaft = sum(ratio * speeds[:, i] for i, ratio in arms)
        for kind in DISSIPATIVE:
            for i, ratio in arms:
                torque[:, i] += ratio * (joint.drive.value(kind) or 0.0) * friction(kind, shaft)
    both = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
    found: list[tuple[float | None, float | None]] = []
    for joint, s, own in zip(joints, speeds.T, torque.T, strict=True):
        if not own.any():
            found.append((joint.drive.viscous, joint.drive.coulomb))
            continue
        found.append(_nonnegative(np.stack([np.asarray(friction(kind, s)) for kind in both], axis=-1), own))
    return found


def _nonnegative(columns: Array, wanted: Array) -> tuple[float, float]:
    """Factors of two columns (n, 2), at least 0, whose sum is nearest to a third one."""
    x = np.linalg.lstsq(columns, wanted)[0]
    alone = np.maximum(columns.T @ wanted, 0.0) / np.maximum(np.square(columns).sum(axis=0), 1e-300)
    tried = np.diag(alone) if (x < 0.0).any() else x[None]
    errors = [np.linalg.norm(columns @ one - wanted) for one in tried]
    viscous, coulomb = tried[int(np.argmin(errors))].tolist()
    return viscous, coulomb
