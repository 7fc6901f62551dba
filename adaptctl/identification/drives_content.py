"""Content of a drives file, and checks of it beyond the kinds of its keys."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import structs

from adaptctl.arrays import Array
from adaptctl.description.readers.entries import MAX_ENTRIES, Name, Tensor, Triple
from adaptctl.errors import InputError
from adaptctl.identification.column_units import Units

SCHEMA: Literal["adaptctl/drives/1"] = "adaptctl/drives/1"
_SOME = msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)


def _like(*examples: str) -> msgspec.Meta:
    """Examples of a key in TOML, for where it is missing."""
    return msgspec.Meta(examples=list(examples))


class MotorEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """
    Motor in a drives file: its columns in a log, and its torque constant in N m (N) for a unit of its column.

    In a file, a motor without a name has that of its joint, and without units those of all.
    """

    name: str = ""
    position: Annotated[Name, _like("'m1_position'")]
    torque: Annotated[Name, _like("'m1_torque'")]
    velocity: Name | None = None
    torque_constant: float | Literal["unknown"] | None = None
    position_unit: str | None = None
    velocity_unit: str | None = None


class UnitsEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Units of a log's columns in a drives file, as symbols."""

    time: Annotated[str, _like("'s'")]
    position: Annotated[str, _like("'rad'")]
    torque: Annotated[str, _like("'N m'")]
    velocity: str | None = None


class PayloadEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """
    Body in a drives file, fixed to a link in one log from `after` s on: kg, m and kg m^2 in the link's frame.

    What is left out of mass, centre and inertia is identified.
    """

    log: Name
    link: Name
    mass: float | None = None
    center_of_mass: Triple | None = None
    inertia_at_center: Tensor | None = None
    after: float = -math.inf

    @property
    def is_known(self) -> bool:
        """True if mass, centre and inertia are given."""
        return None not in (self.mass, self.center_of_mass, self.inertia_at_center)


class DrivesFile(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Content of a drives file: transmission (row: motor, column: joint), motors, columns, units and payloads."""

    schema: Literal["adaptctl/drives/1"] = SCHEMA
    joints: Annotated[list[Name], _SOME, _like("['shoulder', 'elbow']")]
    transmission: Annotated[list[list[float]], _SOME, _like("[[50, 0], [0, 50]]")]
    motors: Annotated[list[MotorEntry], _SOME, _like("[{ position = 'm1_position', torque = 'm1_torque' }]")]
    time: Name = "time"
    units: Annotated[UnitsEntry, _like("{ time = 's', position = 'rad', torque = 'N m' }")]
    joint_offsets: list[float] | None = None
    joint_offsets_deg: list[float] | None = None
    payloads: list[PayloadEntry] = []
    source: str = ""


def wrong_drives(content: DrivesFile) -> Iterator[str]:
    """Sentences on all that is wrong."""
    r = len(content.joints)
    if len(set(content.joints)) < r:
        yield "$.joints: expected unique names"
    if len(content.motors) != r or len(content.transmission) != r or any(len(row) != r for row in content.transmission):
        yield (
            f"$.transmission: expected a row for each of {len(content.motors)} motors, each with a number for each "
            f"of {r} joints, as many motors as joints"
        )
    else:
        names = [motor.name or joint for motor, joint in zip(content.motors, content.joints, strict=True)]
        yield from wrong_turning(np.array(content.transmission), content.joints, names, "$.transmission")
    yield from _wrong_units(structs.asdict(content.units), "$.units.")
    for i, motor in enumerate(content.motors):
        own = {"position": motor.position_unit, "velocity": motor.velocity_unit}
        yield from _wrong_units(own, f"$.motors[{i}].", "_unit")
    yield from _wrong_constants(content)
    yield from _wrong_offsets(content, r)


def wrong_turning(transmission: Array, joints: Sequence[str], motors: Sequence[str], what: str) -> Iterator[str]:
    """Sentences on ratios (r, r) by which motors do not determine the joints."""
    unmoved = [i for i in range(len(joints)) if not transmission[i, i]]
    for i in unmoved:
        yield f"{what}[{i}]: motor {motors[i]!r} must turn its own joint {joints[i]!r}, by a number other than 0"
    if not unmoved and not np.linalg.cond(transmission) < 1e6:
        yield f"{what}: the matrix is singular: the motors do not determine the joints"


def joint_offsets(content: DrivesFile) -> Sequence[float] | None:
    """Offsets in rad, None where the file has none."""
    degrees = content.joint_offsets_deg
    return content.joint_offsets if degrees is None else np.radians(degrees).tolist()


def _wrong_units(given: Mapping[str, str | None], before: str, after: str = "") -> Iterator[str]:
    good = {"time": "s", "position": "rad", "torque": "N m"}
    for what, symbol in given.items():
        if symbol is not None:
            try:
                Units.checked(**good | {what: symbol})
            except InputError as error:
                yield f"{before}{what}{after}: {error}"


def _wrong_constants(content: DrivesFile) -> Iterator[str]:
    unit = content.units.torque
    try:
        is_torque = Units.checked("s", "rad", unit).torque is not None
    except InputError:
        return  # told already
    for i, motor in enumerate(content.motors):
        k, key = motor.torque_constant, f"$.motors[{i}].torque_constant"
        if isinstance(k, float) and not (math.isfinite(k) and k):
            yield f"{key}: expected a number other than 0 or 'unknown', got {k}"
        elif not is_torque and k is None:
            yield f"{key} is missing: {unit!r} is not a torque; give N m per unit of it, or 'unknown'"
        elif is_torque and k not in (None, 1.0, -1.0):
            yield f"{key}: the log has torques in {unit}; remove it, or give -1 for torques of the other sign"


def _wrong_offsets(content: DrivesFile, r: int) -> Iterator[str]:
    if content.joint_offsets is not None and content.joint_offsets_deg is not None:
        yield "the joint offsets are given twice; give either joint_offsets (rad) or joint_offsets_deg"
    elif (offsets := joint_offsets(content)) is not None and len(offsets) != r:
        yield f"$.joint_offsets: expected a number for each of {r} joints, got {len(offsets)}"
