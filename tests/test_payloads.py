"""Bodies that a robot carries in a log: found with what they weigh, or refused where a log does not show them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from nightly import nightly
from robot_files import urdf
from synthetic_logs import guessed, joint_drives, known, motion

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import InputError
from adaptctl.identification import IdentifiedPayload, identify, long_logs
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives, MotorEntry, PayloadEntry
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.long_logs import LongEvidence
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.taking import with_instants
from adaptctl.identification.torque_constants import Completion, completed

CASE = known(7, duration=2.0, rate=50.0)
MASS, CENTER = 2.0, np.array([0.05, -0.1, 0.15])
INERTIA = np.array([[0.02, 0.003, 0.0], [0.003, 0.03, -0.002], [0.0, -0.002, 0.025]])
TEN = from_center_of_mass(MASS, CENTER, INERTIA)
NUMBERS = np.array([MASS, *CENTER, *(INERTIA[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))])
TAKEN = 8.0


def torques(parameters: Array, p: Array, v: Array, a: Array) -> Array:
    return np.asarray(CASE.truth.with_parameters(parameters).inverse_dynamics(p, v, a))


def log(name: str, seed: int, since: float, size: float = 1.0, changed: float = 1.0) -> JointLog:
    """15 s with the body from a time on, of another size of motion, of a robot whose second link is changed."""
    rng = np.random.default_rng(seed)
    time, *states = motion(3, rng, 15.0, 100.0)
    p, v, a = (size * x for x in states)
    empty = CASE.truth.inertial_parameters.copy()
    empty[10:20] *= changed
    loaded = empty.copy()
    loaded[20:30] += TEN
    torque = np.where((time >= since)[:, None], torques(loaded, p, v, a), torques(empty, p, v, a))
    noise = 0.005 * np.sqrt(np.mean(torque**2, axis=0)) * rng.normal(size=torque.shape)
    return JointLog(name, time, p, torque + noise)


def drives(**payload: Any) -> Drives:
    return replace(joint_drives(CASE.guess), payloads=(PayloadEntry(link="link2", **payload),))


def of_unknown_constants(own: Drives) -> Drives:
    entries = ((motor.name, motor.position, motor.torque) for motor in own.motors)
    motors = [MotorEntry(name=n, position=p, torque=i, torque_constant="unknown") for n, p, i in entries]
    return replace(own, motors=tuple(motors))


def found(logs: list[JointLog], known_drives: Drives) -> Completion:
    evidence, _, _ = gathered(CASE.guess, known_drives, logs, ("limits",), cutoffs=(10.0,))
    return completed(evidence, 10.0)


def numbers(body: IdentifiedPayload) -> Array:
    inertia = body.inertia_at_center
    entries = [inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return np.array([body.mass, *body.center_of_mass, *entries])


EMPTY, LOADED = log("empty.csv", 1, np.inf), log("loaded.csv", 2, -np.inf)


@pytest.mark.parametrize("once", [False, True], ids=["two logs", "taken in one"])
def test_a_body_is_found_with_deviations(once: bool) -> None:
    logs = [log("taken.csv", 3, TAKEN)] if once else [EMPTY, LOADED]
    (body,) = found(logs, drives(log=logs[-1].source, **({"after": TAKEN} if once else {}))).payloads
    assert np.all(np.abs(numbers(body) - NUMBERS) < 3.0 * body.deviations)
    assert body.deviations[0] < 0.02 * MASS
    assert np.all(body.deviations[1:4] < 0.005)
    assert np.linalg.eigvalsh(body.inertia_at_center).min() > 0.0


def test_the_instant_at_which_a_body_is_taken_is_found() -> None:
    """In a log that is alone; with an empty one beside it, a body without an instant is carried from the start."""
    taken = log("taken.csv", 3, TAKEN)
    for logs, instant in (([taken], TAKEN), ([EMPTY, taken], -np.inf)):
        evidence, _, _ = gathered(CASE.guess, drives(log="taken.csv"), logs, ("limits",), cutoffs=(10.0,))
        known_drives, words = with_instants(evidence, 10.0)
        assert known_drives.payloads[0].after == pytest.approx(instant, abs=0.05)
        assert [word.startswith("payload in taken.csv: no log is without it") for word in words] == [True][: len(words)]
    assert not words


def test_a_log_in_stretches_tells_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Constants, a body and when it is taken, and the sums without it, are those of all rows at once."""
    taken = log("taken.csv", 3, TAKEN)
    carried, constants = drives(log="taken.csv", after=TAKEN), np.array([0.5, 2.0, 1.25])
    currents = replace(taken, torque=taken.torque / constants)
    unknown = of_unknown_constants(drives(log="taken.csv", mass=MASS, after=TAKEN))

    def told() -> tuple[Completion, Completion, float, NormalEquations]:
        evidence = [gathered(CASE.guess, drives(log="taken.csv"), [taken], ("limits",), cutoffs=(10.0,))[0]]
        assert isinstance(evidence[0], LongEvidence) == (long_logs.LONG == 0)
        instant = with_instants(evidence[0], 10.0)[0].payloads[0].after
        body = found([taken], carried)
        sums = gathered(CASE.guess, body.drives, [taken], ("limits",), cutoffs=(10.0,))[0].sums(10.0, 0.0)
        return body, found([currents], unknown), instant, sums

    whole = told()
    monkeypatch.setattr(long_logs, "LONG", 0)
    monkeypatch.setattr(long_logs, "KEPT", 700_000)
    monkeypatch.setattr(long_logs, "STRETCH", 700)
    parts = told()
    assert parts[2] == pytest.approx(whole[2], abs=1e-9)
    for one, other in zip(whole[:2], parts[:2], strict=True):
        np.testing.assert_allclose(numbers(other.payloads[0]), numbers(one.payloads[0]), rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(other.drives.constants, one.drives.constants, rtol=1e-6)
    for name in ("normal", "moment", "square", "count"):
        one, other = (getattr(sums, name) for sums in (whole[3], parts[3]))
        np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-6 * np.abs(one).max())


@nightly
def test_the_estimate_of_the_robot_is_without_it() -> None:
    """The file that is written has the empty robot, and the loaded log is no worse predicted."""
    options = {"friction": FrictionModel(), "cutoff": 10.0, "prior_weight": 1.0}
    result = identified(CASE.guess, drives(log="loaded.csv"), [EMPTY, LOADED], [LOADED], **options)  # type: ignore[arg-type]
    assert result.validation.relative_error < 0.01
    (body,) = result.payloads
    assert body.mass == pytest.approx(MASS, rel=0.02)
    assert any(warning.startswith("payload in loaded.csv at link2: 2 kg") for warning in result.warnings)


def test_a_mass_alone_settles_constants_of_either_sign() -> None:
    constants = np.array([0.5, -2.0, 1.25])
    currents = [replace(own, torque=own.torque / constants) for own in (EMPTY, LOADED)]
    result = found(currents, of_unknown_constants(drives(log="loaded.csv", mass=MASS)))
    assert result.drives.constants == pytest.approx(constants, rel=0.03)
    assert result.payloads[0].mass == pytest.approx(MASS, rel=1e-4)
    assert result.payloads[0].center_of_mass == pytest.approx(CENTER, abs=0.01)


def test_logs_that_hardly_show_a_body_are_refused() -> None:
    still = [replace(own, torque=own.torque + np.random.default_rng(4).normal(scale=20.0, size=own.torque.shape))
             for own in (log("empty.csv", 1, np.inf, 0.05), log("loaded.csv", 2, -np.inf, 0.05))]  # fmt: skip
    with pytest.raises(InputError, match=r"payload in loaded\.csv: the log hardly shows it \(mass "):
        found(still, drives(log="loaded.csv"))


def test_logs_of_two_robots_are_refused() -> None:
    other = log("loaded.csv", 2, -np.inf, changed=1.5)
    with pytest.raises(InputError, match=r"empty\.csv, loaded\.csv: one robot with the payloads given fits them"):
        found([EMPTY, other], drives(log="loaded.csv"))


def test_what_is_written_is_the_body_to_others() -> None:
    body = IdentifiedPayload("loaded.csv", "hand & <tool>", TEN, np.zeros((10, 10)))
    whole = f'<robot name="r"><link name="hand &amp; &lt;tool&gt;"/>{body.urdf()}</robot>'
    model = pinocchio.buildModelFromXML(whole, pinocchio.JointModelFreeFlyer())
    inertia = model.inertias[1]
    assert inertia.mass == pytest.approx(MASS)
    np.testing.assert_allclose(inertia.lever, CENTER, atol=1e-12)
    np.testing.assert_allclose(inertia.inertia, INERTIA, atol=1e-12)
    told = body.set_load()
    assert told["inertia_six"] == pytest.approx([0.02, 0.03, 0.025, 0.003, 0.0, -0.002])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"payload_mass": 2.0}, "payload_mass: of no payload; give payloads"),
        ({"payloads": {"other.csv": "tool0"}}, r"payloads: expected one of the logs log\.csv, got 'other\.csv'"),
        ({"payloads": {"log.csv": "a"}, "payload_mass": -1.0}, "payload_mass: expected a positive number of kg"),
    ],
)
def test_wrong_options_are_named(
    options: dict[str, Any], message: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    p = CASE.log.position
    rows = np.column_stack([CASE.log.time, p, CASE.log.torque])
    names = ",".join(["time", *(f"position.joint{j}" for j in range(3)), *(f"torque.joint{j}" for j in range(3))])
    np.savetxt("log.csv", rows, delimiter=",", header=names, comments="")
    units = {"time": "s", "position": "rad", "torque": "N m"}
    with pytest.raises(InputError, match=message):
        identify("log.csv", CASE.guess, units=units, **options)


@nightly
def test_constants_of_a_ur10_by_pinocchio() -> None:
    """Currents of Pinocchio's UR10, empty and with a load of which the mass is known; one constant is negative."""
    path = urdf("ur10_robot.urdf")
    constants = np.array([14.9, 13.3, -11.1, 10.6, 11.0, 11.5])
    arm, plain = adaptctl.load(path), pinocchio.buildModelFromUrdf(str(path))
    loaded = plain.copy()
    body = pinocchio.Inertia(2.805, np.array([0.02, -0.01, 0.06]), np.diag([0.008, 0.008, 0.006]))
    loaded.appendBodyToJoint(plain.getJointId("wrist_3_joint"), body, pinocchio.SE3.Identity())
    rotors, viscous, coulomb = ([3, 3, 1.2, 0.4, 0.4, 0.3], [15, 12, 8, 2, 2, 1.5], [12, 14, 8, 2.5, 2.5, 2])
    rng, logs = np.random.default_rng(0), []
    for name, model, duration in (("empty.csv", plain, 30.0), ("loaded.csv", loaded, 50.0)):
        time, p, v, a = motion(6, rng, duration, 100.0)
        data = model.createData()
        torque = np.array([pinocchio.rnea(model, data, *own) for own in zip(p, v, a, strict=True)])
        torque += rotors * a + viscous * v + coulomb * v / np.sqrt(v**2 + 1e-4)
        logs.append(JointLog(name, time, p, torque / constants + 0.05 * rng.normal(size=torque.shape)))
    own = joint_drives(arm)
    motors = tuple(
        MotorEntry(name=m.name, position=m.position, torque=m.torque, torque_constant="unknown") for m in own.motors
    )
    carried = PayloadEntry(log="loaded.csv", link=arm.links[-1].name, mass=2.805)
    evidence, _, _ = gathered(
        guessed(arm, rng, 0.15), replace(own, motors=motors, payloads=(carried,)), logs, ("limits",)
    )
    assert completed(evidence, min(evidence.rows)).drives.constants == pytest.approx(constants, rel=0.05)
