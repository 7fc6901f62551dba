"""Adapters of vendors' clients and `adaptctl drive`. `make check-robots` runs the clients themselves."""

from __future__ import annotations

import dataclasses
import json
import runpy
import socket
import struct
import sys
import threading
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest
from driven_robots import ARM
from random_trees import random_chain

import adaptctl
from adaptctl.cli.drive import _geared
from adaptctl.cli.main import main
from adaptctl.control import Gradient
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import inertia_tensor
from adaptctl.errors import InputError, StabilityWarning
from adaptctl.hardware import (
    ROTOR_PROFILES,
    FrankaRobot,
    HardwareLimits,
    MuJoCoRobot,
    UDPRobot,
    URRobot,
    motion_about,
    udp_plant,
    with_rotors,
)
from adaptctl.hardware.mujoco_robot import _within
from adaptctl.tuning.rotors import rotor_note

CENTER = np.array([0.3, 0.5])
LIMITS = HardwareLimits.of(ARM, torque_rate=1000.0)
SCENE = "scene"


class SimulatedVendor:
    """Arm behind the names of pylibfranka and ur_rtde: MuJoCo's, which compensates its weight and a tool's."""

    def __init__(self, period: float) -> None:
        self.robot = MuJoCoRobot(ARM, period, CENTER, compensates_gravity=True)
        self.calls: list[str] = []
        self.payload = 0.0

    @property
    def state(self) -> SimpleNamespace:
        p, v = self.robot._state.p.tolist(), self.robot._state.v.tolist()
        return SimpleNamespace(
            q=p, dq=v, tau_J_d=self.robot._torque.tolist(), O_ddP_O=[0.0] * 3, F_x_Ctotal=[0.0] * 3, m_total=0.0,
            I_total=[0.0] * 9, O_F_ext_hat_K=[3.0, -1.0, 12.0, 0.5, 0.0, 0.0],
        )  # fmt: skip

    def read_once(self) -> SimpleNamespace:
        self.robot.read()
        return self.state

    def start_torque_control(self) -> SimulatedVendor:
        self.calls.append("start")
        self.robot.start(np.zeros(2))
        return self

    def readOnce(self) -> tuple[SimpleNamespace, SimpleNamespace]:
        return self.read_once(), SimpleNamespace(to_sec=lambda: self.robot.period)

    def writeOnce(self, command: Any) -> None:
        self.robot.write(command.tau_J)
        if command.motion_finished:
            self.calls.append("finished")

    def load_model(self) -> Any:
        def gravity(state: Any) -> Any:
            assert state.O_ddP_O == [0.0, 0.0, -9.81]
            return self.robot.compensation(None)

        return SimpleNamespace(gravity=gravity)

    def stop(self) -> None:
        self.calls.append("stop")

    # ur_rtde
    def getTimestamp(self) -> float:
        return self.robot.read().time

    def getActualQ(self) -> list[float]:
        return self.state.q  # type: ignore[no-any-return]

    def getActualQd(self) -> list[float]:
        return self.state.dq  # type: ignore[no-any-return]

    def getPayload(self) -> float:
        return self.payload

    def getPayloadCog(self) -> list[float]:
        return [0.0, 0.0, 0.0]

    def getPayloadInertia(self) -> list[float]:
        return [0.0] * 6

    def getActualTCPForce(self) -> list[float]:
        return [3.0, -1.0, 12.0, 0.5, 0.0, 0.2]

    def getActualTCPPose(self) -> list[float]:
        return [0.4, 0.1, 0.3, 0.0, 3.1, 0.0]

    def initPeriod(self) -> int:
        return 1

    def waitPeriod(self, tick: int) -> None:
        assert tick == 1

    def directTorque(self, torque: list[float]) -> bool:
        if self.robot._braked:
            self.robot.start(np.zeros(2))
        self.robot.write(np.array(torque))
        return True

    def stopScript(self) -> None:
        self.calls.append("stop")


@pytest.fixture
def vendor(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> SimulatedVendor:
    arm = SimulatedVendor(request.param)
    franka = SimpleNamespace(
        Robot=lambda address, config: arm,
        RealtimeConfig=SimpleNamespace(kEnforce=1, kIgnore=0),
        Torques=lambda tau: SimpleNamespace(tau_J=np.array(tau), motion_finished=False),
    )
    monkeypatch.setitem(sys.modules, "pylibfranka", franka)  # type: ignore[arg-type]
    control = SimpleNamespace(RTDEControlInterface=lambda address: arm)
    receive = SimpleNamespace(RTDEReceiveInterface=lambda address: arm)
    monkeypatch.setitem(sys.modules, "rtde_control", control)  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "rtde_receive", receive)  # type: ignore[arg-type]
    return arm


REFERENCE = motion_about(CENTER, LIMITS)
MODEL = adaptctl.ReducedModel(ARM)


def law(period: float, delay: int = 0) -> adaptctl.SlotineLi:
    own = {"initial": MODEL.fundamental_parameters, "control_period": period}
    return adaptctl.SlotineLi(MODEL, 8.0, [6.0, 2.0], Gradient(np.full(len(MODEL.names), 0.02), delay=delay), **own)


@pytest.mark.parametrize("vendor", [1e-3], indirect=True)
def test_franka_is_handed_back_where_it_compensates_itself(vendor: SimulatedVendor) -> None:
    robot = FrankaRobot("robot", limits=LIMITS)
    assert robot.tool.tolist() == [0.0] * 10
    run = adaptctl.drive(robot, law(1e-3, 1), REFERENCE, 1.0)
    assert (run.stopped, vendor.calls) == ("", ["start", "finished"])
    assert run.peak_torque_rate <= 950.0
    assert run.final_rms_error.max() < 1e-3
    assert np.abs(vendor.robot._torque).max() == 0.0


@pytest.mark.parametrize("vendor", [2e-3], indirect=True)
def test_ur_knows_its_payload_and_stops_where_it_changes(vendor: SimulatedVendor) -> None:
    robot = URRobot("robot", LIMITS)
    assert robot.tool.tolist() == [0.0] * 10
    with pytest.warns(StabilityWarning, match="0 control periods late, and the robot states 1"):
        run = adaptctl.drive(robot, law(2e-3), REFERENCE, 1.5)
    assert (run.stopped, vendor.calls) == ("", ["stop"])
    assert run.final_rms_error.max() < 1e-3
    vendor.payload = 0.5
    with pytest.raises(RuntimeError, match="payload set at the robot changed"):
        robot.read()
    robot.stop()
    assert vendor.calls == ["stop", "stop"]
    vendor.robot = MuJoCoRobot(ARM, 2e-3, CENTER, compensates_gravity=True)
    assert URRobot("robot", LIMITS).tool[0] == 0.5


@pytest.mark.parametrize("vendor", [2e-3], indirect=True)
@pytest.mark.parametrize("stated", [[0.03, 0.04, 0.05, 0.001, -0.002, 0.003], []])
def test_urs_payload_is_the_body_that_is_set_there(vendor: Any, stated: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pinocchio's, of a point where no inertia is set."""
    center, (xx, yy, zz, xy, xz, yz) = np.array([0.1, -0.2, 0.3]), stated or [0.0] * 6
    monkeypatch.setattr(vendor, "payload", 2.0)
    monkeypatch.setattr(vendor, "getPayloadCog", center.tolist)
    monkeypatch.setattr(vendor, "getPayloadInertia", lambda: stated)
    body = pinocchio.Inertia(2.0, center, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])).matrix()
    tool = URRobot("robot", LIMITS).tool
    assert tool[:4] == pytest.approx([2.0, *(2.0 * center)])
    np.testing.assert_allclose(inertia_tensor(tool), body[3:, 3:], atol=1e-15)


@pytest.mark.parametrize("vendor", [1e-3], indirect=True)
@pytest.mark.parametrize(("said", "helps"), [("no Realtime kernel", True), ("connection timed out", False)])
def test_only_a_kernel_without_real_time_is_helped_by_doing_without(vendor: Any, said: str, helps: bool) -> None:
    def refused(address: str, config: object) -> None:
        raise OSError(said)

    sys.modules["pylibfranka"].Robot = refused  # type: ignore[attr-defined]
    with pytest.raises(InputError, match=f"^robot: no Franka robot: {said}") as told:
        FrankaRobot("robot", limits=LIMITS)
    assert ("--any-kernel" in str(told.value)) == helps


@pytest.mark.parametrize("vendor", [1e-3], indirect=True)
def test_franka_feels_what_it_estimates_if_asked(vendor: SimulatedVendor) -> None:
    assert not hasattr(FrankaRobot("robot", limits=LIMITS), "force")
    robot = FrankaRobot("robot", limits=LIMITS, feels_force=True)
    now, reading = robot.read().time, robot.force()
    assert (reading.time, reading.point) == (now, None)
    assert reading.force.tolist() == [3.0, -1.0, 12.0]


@pytest.mark.parametrize("vendor", [2e-3], indirect=True)
def test_ur_measures_a_wrench_in_the_axes_of_its_description(vendor: SimulatedVendor) -> None:
    assert not hasattr(URRobot("robot", LIMITS), "force")
    robot = URRobot("robot", LIMITS, force_sensor=True)
    now, reading = robot.read().time, robot.force()
    assert reading.time == now
    for found, wanted in zip(reading[1:], ([-3.0, 1.0, 12.0], [-0.5, 0.0, 0.2], [-0.4, -0.1, 0.3]), strict=True):
        assert found == pytest.approx(wanted)
    same = URRobot("robot", LIMITS, force_sensor=True, base_turn=0.0)
    same.read()
    assert same.force().point == pytest.approx([0.4, 0.1, 0.3])


def test_a_simulated_arm_stands_within_its_range_and_away_from_its_ends() -> None:
    """At zero, which is outside of one joint's range, the end of another's, and where a third may turn for ever."""
    limits = HardwareLimits(np.ones(4), np.ones(4), [0.8, -2.0, -np.inf, -1.0], [5.2, 0.0, np.inf, 1.0])
    np.testing.assert_allclose(_within(np.zeros(4), limits), [3.0, -1.0, 0.0, 0.0])


def plant(port: int, count: int, answers: list[tuple[float, ...]]) -> None:
    """Motor driver that also hears of a stranger, of old counts and of malformed datagrams."""
    robot = MuJoCoRobot(ARM, 2e-3, CENTER)
    link, stranger = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with link, stranger:
        link.settimeout(4.0)
        for k in range(count):
            reading = robot.read()
            datagram = struct.pack("<5d", k, *reading.p, *reading.v)
            link.sendto(datagram, ("127.0.0.1", port))
            if k == 20:
                stranger.sendto(struct.pack("<5d", k + 0.5, 1.0, 1.0, 0.0, 0.0), ("127.0.0.1", port))
                endless = [struct.pack("<5d", number, *[0.0] * 4) for number in (np.nan, np.inf)]
                for bad in (datagram + b"12345678", datagram[:-3], datagram, *endless):
                    link.sendto(bad, ("127.0.0.1", port))
            if k >= 5:  # no answer comes to what is read before
                try:
                    answer = struct.unpack("<4d", link.recv(4096))
                except TimeoutError:
                    return
                answers.append(answer)
                if robot._braked:
                    robot.start(np.array(answer[1:3]))
                robot.write(np.array(answer[1:3]))


def test_udp_follows_one_peer_and_drops_what_is_not_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.hardware.udp_robot.PATIENCE", 2000.0)  # however busy the machine is
    robot = UDPRobot("127.0.0.1:0", LIMITS, 2e-3)
    robot.has_brakes = True  # type: ignore[attr-defined]  # as this plant has
    answers: list[tuple[float, ...]] = []
    peer = threading.Thread(target=plant, args=(robot.port, 1400, answers))
    peer.start()
    run = adaptctl.drive(robot, law(2e-3), REFERENCE, 0.8)
    peer.join()
    assert run.stopped == ""
    assert run.final_rms_error.max() < 0.01
    counts = [answer[0] for answer in answers]
    assert counts == sorted(set(counts))
    assert all(count == int(count) for count in counts)


def test_addresses_are_checked() -> None:
    for address in ("here", "127.0.0.1", "127.0.0.1:99999", "127.0.0.1:x"):
        with pytest.raises(adaptctl.InputError, match="expected HOST:PORT"):
            UDPRobot(address, LIMITS)
    with pytest.raises(adaptctl.InputError, match="cannot listen there"):
        UDPRobot("203.0.113.1:5150", LIMITS)


def test_rotors_are_guessed_where_the_file_has_none() -> None:
    with pytest.warns(adaptctl.errors.SimplificationWarning, match="no rotor inertia of shoulder, elbow: guessed"):
        geared = with_rotors(ARM)
    assert [joint.drive.rotor_inertia for joint in geared.primary_joints] == pytest.approx([0.155, 0.1])
    with warnings.catch_warnings(action="error"):
        assert with_rotors(geared) is geared
    with pytest.warns(adaptctl.errors.SimplificationWarning, match="no rotor inertia of elbow: guessed"):
        partly = with_rotors(ARM.with_drives([Drive(0.3), Drive()]))
    assert [joint.drive.rotor_inertia for joint in partly.primary_joints] == pytest.approx([0.3, 0.1])


def limited(arm: adaptctl.Mechanism) -> adaptctl.Mechanism:
    """The arm with torque limits, on hinges alone."""
    links = [
        dataclasses.replace(
            k, joint=dataclasses.replace(k.joint, kind=ARM.links[0].joint.kind, limits=ARM.links[0].joint.limits)
        )
        for k in arm.links
    ]
    return adaptctl.Mechanism(dataclasses.replace(arm.description, links=tuple(links)))


def test_published_rotors_are_taken_by_type() -> None:
    with warnings.catch_warnings(action="error"):
        found = with_rotors(limited(random_chain(0, 7)), "fr3")
    assert [joint.drive.rotor_inertia for joint in found.primary_joints] == list(ROTOR_PROFILES["fr3"].inertias)
    with pytest.raises(adaptctl.errors.NotFoundError, match="unknown profile 'fr4'; known: fr3, fr3-menagerie"):
        with_rotors(ARM, "fr4")
    with pytest.raises(adaptctl.InputError, match="fr3 has 7 joints, but two_link has 2"):
        with_rotors(ARM, "fr3")


@pytest.mark.parametrize("source", ["URDF file arm.urdf", "Made up."])
def test_gains_that_lean_on_rotors_which_a_urdf_cannot_have_are_noted(source: str) -> None:
    arm = adaptctl.Mechanism(dataclasses.replace(ARM.description, source=source))
    note = rotor_note(arm)
    assert note.startswith("shoulder, elbow: URDF has no rotor inertias") == source.startswith("URDF")
    assert rotor_note(arm.with_drives(Drive(0.1))) == ""


def test_command_drives_a_scene_and_says_what_happened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = lambda arm, period, reference, tool, delay: adaptctl.ComputedTorque(arm, 8.0)  # noqa: E731
    monkeypatch.setattr("adaptctl.hardware.ready_controller", quick)
    given = ["drive", "mujoco", SCENE, "--robot", SCENE, "--root", "stand", "--duration", "0.8"]
    assert main([*given, "--out", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["stopped"] == ""
    assert summary["first_error"] < 1e-9
    assert set(summary["final_rms_error"]) == {"yaw", "lift", "elbow"}
    assert summary["peak_torque_rate"] <= 950.0
    assert (tmp_path / "run" / "recording.rrd").stat().st_size > 0
    assert len(adaptctl.Rollout.load(tmp_path / "run" / "run.parquet").time) == 800
    assert "RMS error of the last 0.8 s" in capsys.readouterr().out
    assert main([*given[:-1], "-1", "--out", str(tmp_path / "other")]) == 2
    assert "--duration: expected a positive time" in capsys.readouterr().err
    assert main(["drive", "ur", "x", *given[3:], "--out", str(tmp_path / "other")]) == 1
    assert "pip install ur_rtde" in capsys.readouterr().err


def test_a_simulated_robot_tells_its_rotors_and_no_other_is_guessed_for_it() -> None:
    """A guess of fourteen times a wrist's own inertia made the loop ring until it was stopped."""
    arm = adaptctl.load("two_link")
    geared = arm.with_drives(Drive(rotor_inertia=0.05))
    for simulated, expected in ((arm, None), (geared, 0.05)):
        told = _geared(arm, MuJoCoRobot(simulated, 0.004), None)
        assert [joint.drive.rotor_inertia for joint in told.primary_joints] == [expected, expected]
    assert _geared(geared, MuJoCoRobot(arm, 0.004), None).description == geared.description


@pytest.mark.parametrize("words", [[], ["--help"], ["two_link", "long"], ["two_link", "1", "2", "3"], ["two_lin"]])
def test_a_wrong_line_of_the_simulated_arm_is_told_what_it_is(
    words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["udp_plant", *words])
    with pytest.raises(SystemExit, match=r"ROBOT \[SECONDS\] \[PORT\]|did you mean 'two_link'"):
        runpy.run_path(udp_plant.__file__, run_name="__main__")
