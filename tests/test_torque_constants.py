"""Motors whose torque constants nobody knows, and payloads that somebody does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nightly import nightly
from synthetic_logs import joint_drives, known, motion

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.readers.entries import Tensor
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives, MotorEntry, PayloadEntry
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.identification import Identification
from adaptctl.identification.identify import identified

CONSTANTS = np.array([0.5, 2.0, 1.25])
PAYLOAD = PayloadEntry(
    log="loaded.csv",
    link="link2",
    mass=4.0,
    center_of_mass=(0.1, -0.2, 0.15),
    inertia_at_center=Tensor(xx=0.1, yy=0.1, zz=0.1),
)


def motors(drives: Drives, constants: list[object]) -> Drives:
    """The same with torque constants."""
    pairs = zip(drives.motors, constants, strict=True)
    entries = [MotorEntry(name=m.name, position=m.position, torque=m.torque, torque_constant=k) for m, k in pairs]  # type: ignore[arg-type]
    return replace(drives, motors=tuple(entries))


def logs(seed: int) -> tuple[list[JointLog], Array]:
    """Currents of an empty and of a loaded arm, and the true parameters."""
    case = known(seed)
    ten = from_center_of_mass(PAYLOAD.mass, PAYLOAD.center_of_mass, PAYLOAD.inertia_at_center.matrix())
    D = case.truth.inertial_parameters
    loaded = D.copy()
    loaded[20:30] += ten
    found = []
    for name, parameters, draw in (("empty.csv", D, 0), ("loaded.csv", loaded, 1)):
        rng = np.random.default_rng(seed + draw)
        time, p, v, a = motion(3, rng, 15.0, 250.0)
        torque = case.truth.with_parameters(parameters).inverse_dynamics(p, v, a)
        noise = 0.005 * np.sqrt(np.mean(torque**2, axis=0)) * rng.normal(size=torque.shape)
        found.append(JointLog(name, time, p, (torque + noise) / CONSTANTS))
    return found, D


def found(seed: int, constants: list[object], payloads: tuple[PayloadEntry, ...]) -> Identification:
    case, (train, _) = known(seed), logs(seed)
    drives = replace(motors(joint_drives(case.guess), constants), payloads=payloads)
    given = [1.0 if k == "unknown" else float(str(k)) for k in constants]
    read = [replace(log, torque=log.torque * given) for log in train]
    return identified(case.guess, drives, read, read, friction=FrictionModel(), cutoff=25.0)


def constants(result: Identification) -> Array:
    return np.array([motor.torque_constant for motor in result.drives.motors], dtype=np.float64)


@nightly
def test_a_known_payload_settles_every_constant() -> None:
    result = found(3, ["unknown"] * 3, (PAYLOAD,))
    assert constants(result) == pytest.approx(CONSTANTS, rel=0.05)
    assert result.validation.relative_error < 0.02
    assert any("identified from the known" in remark for remark in result.warnings)


@nightly
def test_one_known_constant_settles_the_others() -> None:
    result = found(3, [0.5, "unknown", "unknown"], (PAYLOAD,))
    assert constants(result) == pytest.approx(CONSTANTS, rel=0.03)


@nightly
def test_without_either_they_are_known_up_to_one_scale_which_is_said() -> None:
    case, (train, _) = known(3), logs(3)
    drives = motors(joint_drives(case.guess), ["unknown"] * 3)
    result = identified(case.guess, drives, train[:1], train[:1], friction=FrictionModel(), cutoff=25.0)
    ratio = constants(result) / CONSTANTS
    assert ratio / ratio[0] == pytest.approx(np.ones(3), rel=0.05)
    assert 0.3 < ratio[0] < 3.0
    assert any("up to a common scale" in remark for remark in result.warnings)


@nightly
def test_a_payloads_torques_are_not_the_robots() -> None:
    """With all constants known, a loaded and an empty log are of one robot."""
    result = found(3, CONSTANTS.tolist(), (PAYLOAD,))
    assert result.validation.relative_error < 0.01
    ignored = found(3, CONSTANTS.tolist(), ())
    assert ignored.validation.relative_error > 3.0 * result.validation.relative_error


def test_payloads_that_cannot_be_are_refused() -> None:
    for wrong, message in (
        ({"link": "hand"}, "unknown link 'hand'; links: link0, link1, link2"),
        ({"mass": -1.0}, "this mass, centre and inertia are not physically consistent"),
    ):
        entry = PayloadEntry(**({name: getattr(PAYLOAD, name) for name in PAYLOAD.__struct_fields__} | wrong))
        with pytest.raises(InputError, match=message):
            found(3, CONSTANTS.tolist(), (entry,))
    assert Path(PAYLOAD.log).suffix == ".csv"
