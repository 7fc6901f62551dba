"""Gains of whole arms: the loops do as they are told, what is too stiff is refused, and the command says it all."""

from __future__ import annotations

import json
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.cli.main import main
from adaptctl.control import ComputedTorque, GainDesign, ReferencePoint, sampled_gain
from adaptctl.control.gains.workspace import Workspace, sampled_configurations
from adaptctl.description import GROUND, Description, Joint, JointKind, Link, Pose, builtin_names
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import DivergedRunWarning, GainError, InputError
from adaptctl.simulation import rollout
from adaptctl.simulation.effects import ControlDelay
from adaptctl.tuning.default_gains import DefaultGains, near_reference
from tests.robot_files import urdf


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_geared")


@pytest.fixture(scope="module")
def design(puma: Mechanism) -> GainDesign:
    return GainDesign.from_bandwidth(puma, 8.0, 1.2)


def test_gains_are_slotine_and_lis(design: GainDesign) -> None:
    gains = design.gains
    rates = np.array([feedback.rate for feedback in design.feedback])
    np.testing.assert_allclose(gains.bandwidth + gains.damping / design.inertia, rates, rtol=1e-12)
    assert design.sampled_gain == pytest.approx(sampled_gain(design.mechanism, design.damping, 1e-3), rel=1e-12)
    assert design.check_sample_time() is design


def test_one_bandwidth_a_joint(puma: Mechanism) -> None:
    rates = np.linspace(4.0, 14.0, 6)
    np.testing.assert_allclose(GainDesign.from_bandwidth(puma, rates).bandwidth, rates, rtol=0.01)


def test_the_least_inertia_is_that_of_a_joint_whose_others_are_free(design: GainDesign) -> None:
    """tau_i alone gives a_i = (M^-1)_ii tau_i."""
    p = sampled_configurations(design.mechanism)[:20]
    for q in p:
        for i, unit in enumerate(np.eye(6)):
            v = np.zeros(6)
            a = design.mechanism.forward_dynamics(q, v, unit) - design.mechanism.forward_dynamics(q, v, v)
            assert 1.0 / a[i] >= design.least_inertia[i] * design.inertia[i] * (1.0 - 1e-9)


def test_the_least_inertia_of_a_joint_alone_is_its_rods_and_typical() -> None:
    """A rod of 2 kg and 1 m turns about its end with 2/3 kg m^2 at every angle."""
    rod = Link(
        "rod",
        GROUND,
        Joint("joint", JointKind.REVOLUTE),
        Pose.identity(),
        Pose.identity(),
        from_center_of_mass(2.0, [0.5, 0.0, 0.0], np.diag([1e-4, 1.0 / 6.0, 1.0 / 6.0])),
    )
    alone = GainDesign.from_bandwidth(Mechanism(Description("rod", (rod,))), 4.0)
    np.testing.assert_allclose(alone.inertia, 2.0 / 3.0, rtol=1e-12)
    np.testing.assert_allclose(alone.least_inertia, 1.0, rtol=1e-12)


@pytest.mark.parametrize("delay", [0, 1])
def test_the_fastest_is_what_the_period_just_carries(puma: Mechanism, delay: int) -> None:
    asked = GainDesign.from_bandwidth(puma, 50.0, control_period=2e-3, delay=delay)
    limit = GainDesign.from_bandwidth(puma, 50.0 * asked.max_bandwidth_factor, control_period=2e-3, delay=delay)
    assert limit.sampled_gain == pytest.approx(limit.largest_sampled_gain, rel=1e-4)
    assert GainDesign.from_bandwidth(
        puma, 50.0 * 0.99 * asked.max_bandwidth_factor, control_period=2e-3, delay=delay
    ).check_sample_time()
    with pytest.raises(GainError, match=r"The largest stable gains have all poles at 0\.99"):
        GainDesign.from_bandwidth(
            puma, 50.0 * 1.01 * asked.max_bandwidth_factor, control_period=2e-3, delay=delay
        ).check_sample_time()


def test_a_delay_beyond_the_margin_is_unstable_in_the_plant(puma: Mechanism) -> None:
    """Computed torque with true parameters decouples the joints, so the margin of one loop is the arm's."""
    law = ComputedTorque(puma, 60.0)
    ticks = GainDesign.from_bandwidth(puma, 60.0).margins[0].delay / 1e-3
    assert 8.0 < ticks < 14.0
    for delay, stable in ((round(0.6 * ticks), True), (round(1.4 * ticks), False)):
        env = TrackingEnv(puma, 1, duration=1.5, initial_error=0.01, effects=[ControlDelay(delay)], torque_limits=1e4)
        with nullcontext() if stable else pytest.warns(DivergedRunWarning):
            run = rollout(env, law, seed=0)
        assert (np.abs(run.error[-200:]).max() < 0.01) == stable


def test_a_massless_arm_has_no_gains() -> None:
    with pytest.raises(InputError, match="positive inertia"):
        GainDesign.from_bandwidth(Mechanism(random_chain(1, 1).description.with_parameters(np.zeros(10))), 8.0)


def test_a_delay_is_a_whole_number(puma: Mechanism) -> None:
    with pytest.raises(InputError, match="delay: expected a whole number from 0 to 100, got -1"):
        GainDesign.from_bandwidth(puma, 8.0, delay=-1)


def said(capsys: pytest.CaptureFixture[str], *command: str) -> dict[str, Any]:
    assert main(["gains", *command, "--json"]) == 0
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    return content


def test_the_command_prints_the_design(capsys: pytest.CaptureFixture[str], puma: Mechanism) -> None:
    flags = "--bandwidth", "12", "--damping-ratio", "1", "--control-period", "0.002", "--delay", "1"
    content = said(capsys, "puma560_geared", *flags)
    design = GainDesign.from_bandwidth(puma, 12.0, control_period=2e-3, delay=1)
    assert content["schema"] == "adaptctl/gains/2"
    assert content["robot"]["sha256"] == puma.description.sha256
    for i, joint in enumerate(content["joints"]):
        assert joint["name"] == f"joint{i + 1}"
        assert joint["slotine_li_damping"] == pytest.approx(design.gains.damping[i])
        assert joint["delay_margin"] == pytest.approx(design.margins[i].delay)
    assert content["sampled_gain"] == pytest.approx(design.sampled_gain)


def test_the_command_knows_three_methods(capsys: pytest.CaptureFixture[str], puma: Mechanism) -> None:
    poles = said(capsys, "puma560_geared", "--method", "poles", "--poles", "-6+3j", "-6-3j")
    assert poles["joints"][0]["slotine_li_bandwidth"] is None
    assert poles["joints"][0]["rate"] == pytest.approx(GainDesign.from_poles(puma, [-6 + 3j, -6 - 3j]).feedback[0].rate)
    lqr = said(capsys, "puma560_geared", "--method", "lqr", "--weights", "900", "1", "0.5")
    assert lqr["joints"][0]["stiffness"] == pytest.approx(
        GainDesign.from_lqr(puma, 900.0, 1.0, 0.5).feedback[0].stiffness
    )
    assert main(["gains", "puma560_geared", "--damping-ratio", "1"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert words.startswith("puma560_geared: gains from a bandwidth and a damping ratio, discretised for a control")
    assert "At this period, poles up to" in words
    assert main(["gains", "puma560_geared"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert words.startswith(
        "puma560_geared: gains by the tuning rules, near a reference within the torque limits, discretised"
    )
    assert "joint1 K is limited by the torque limit" in words


FOREIGN = ("ur5_robot.urdf", "kinova.urdf", "xarm7.urdf", "so101.urdf")


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize(
    "robot",
    mostly_at_night(
        [*builtin_names(), *map(str, map(urdf, FOREIGN))],
        "semi_direct_drive",
    ),
)
def test_the_commands_gains_and_tune_tell_one_k(capsys: pytest.CaptureFixture[str], robot: str) -> None:
    """One rule answers both, also where friction holds the arm (the xArm) and where a light wrist does (the Kinova)."""
    given = [] if robot == "puma560" else ["--bandwidth", "6"]
    designed = said(capsys, robot, *given)
    assert main(["tune", robot, *given, "--json"]) == 0
    tuned = json.loads(capsys.readouterr().out)
    for one, other in zip(designed["joints"], tuned["joints"], strict=True):
        assert one["slotine_li_damping"] == other["damping"]
        assert one["slotine_li_bandwidth"] == other["bandwidth"]
        assert one["limited_by"] == other["limited_by"]


def near(rule: DefaultGains) -> Workspace:
    return near_reference(rule.mechanism, rule.reference, rule.initial_error)


def test_gains_hold_along_the_whole_reference(puma: Mechanism) -> None:
    rule, asked = DefaultGains.for_mechanism(puma), list[Array]()

    def reference(time: Any) -> ReferencePoint:
        asked.append(time)
        return rule.reference(time)

    samples = near_reference(puma, reference, rule.initial_error).samples
    np.testing.assert_allclose(asked[0], 20.0 * np.arange(60) / 59)
    for end in (0.0, 20.0):
        assert np.abs(samples - rule.reference(np.array([end])).p).max(axis=1).min() < 1e-9


def test_a_design_of_gains_has_their_poles(puma: Mechanism) -> None:
    """A joint of inertia m under K and Lambda has the poles -Lambda and -K/m; its samples are those of the loop that is
    held, so the poles are the sampled ones to the first order in the period."""
    rule = DefaultGains.for_mechanism(puma, control_period=1e-4)
    gains = rule.carried(5.0, 0.1).gains
    design = GainDesign.from_gains(puma, gains, near(rule), control_period=1e-4)
    assert design.gains.damping == pytest.approx(gains.damping, rel=0.0)
    for i, feedback in enumerate(design.feedback):
        slow, fast = sorted((5.0, gains.damping[i] / design.inertia[i]))
        assert -feedback.poles[0].real == pytest.approx(slow, rel=0.05)
        assert -feedback.poles[1].real == pytest.approx(fast, rel=0.05)
    M = puma.mass_matrix(near(rule).samples)
    np.testing.assert_allclose(design.inertia, np.median(np.diagonal(M, axis1=1, axis2=2), axis=0), rtol=1e-3)


def test_viscous_friction_is_inertia_to_a_held_torque() -> None:
    """A joint with B ends a period at (T/m) (1 - exp(-x))/x per unit of torque, x = T B/m, instead of T/m; its velocity
    decays besides by exp(-x). The gain at which it rings is 2 (m/T) (x/2) coth(x/2)."""
    for viscous in (0.0, 30.0, 3000.0):
        one = random_chain(3, 1).with_drives([Drive(viscous=viscous)]) if viscous else random_chain(3, 1)
        m, period = float(random_chain(3, 1).mass_matrix(np.zeros(1))[0, 0]), 1e-2
        rule = DefaultGains.for_mechanism(one, control_period=period)
        design = GainDesign.from_gains(one, rule.carried().gains, near(rule), control_period=period)
        x = period * viscous / m
        limit = 2.0 * m / period if x == 0.0 else (1.0 + np.exp(-x)) * viscous / (1.0 - np.exp(-x))
        assert design.inertia[0] == pytest.approx(0.5 * period * limit, rel=1e-6)


def test_gains_are_less_where_the_torque_is_late(puma: Mechanism, capsys: pytest.CaptureFixture[str]) -> None:
    early, late = (said(capsys, "puma560_measured", "--delay", delay) for delay in "01")
    assert late["largest_sampled_gain"] == pytest.approx(0.5 * early["largest_sampled_gain"])
    for one, other in zip(early["joints"][3:], late["joints"][3:], strict=True):  # the wrist, whose K the period holds
        assert other["slotine_li_damping"] < 0.6 * one["slotine_li_damping"]
    assert late["sampled_gain"] < late["largest_sampled_gain"]


def test_poles_that_round_off_loses_may_be_as_much_faster_as_one_likes(capsys: pytest.CaptureFixture[str]) -> None:
    slow = said(capsys, "two_link", "--method", "poles", "--poles", "-1e-29", "-1e-29")
    assert slow["fastest"] is None


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (
            ["puma560_measured", "--bandwidth", "1000", "--damping-ratio", "1"],
            "the fastest at 216.4 1/s instead of 1000",
        ),
        (["puma560_geared", "--bandwidth", "-1", "--damping-ratio", "1"], "bandwidth: expected positive numbers"),
        (["puma560_geared", "--bandwidth", "-1"], "bandwidth: expected a number above 0 and at most 1000, got -1.0"),
        (["puma560_geared", "--bandwidth", "1001"], "bandwidth: expected a number above 0 and at most 1000"),
        (["puma560_geared", "--control-period", "0"], "period: expected a positive time in s (1 ms is 0.001), got 0.0"),
        (
            ["puma560_geared", "--damping-ratio", "1", "--control-period", "0"],
            "--control-period: expected a positive time in s",
        ),
        (["puma560_geared", "--method", "poles", "--poles", "1", "2"], "poles: expected two in the left half-plane"),
        (["puma560_geared", "--delay", "0.5"], "--delay: expected a whole number, got '0.5'"),
        (["two_link", "--delay", "1000"], "delay: expected a whole number from 0 to 100, got 1000"),
        (["pumma"], "unknown robot 'pumma'"),
        (["puma560_geared", "--method", "lqr", "--bandwidth", "8"], "--bandwidth: applies only to --method bandwidth"),
        (["puma560_geared", "--method", "poles", "--damping-ratio", "1"], "--damping-ratio: applies only to --method"),
        (["puma560_geared", "--poles", "-6", "-5"], "--poles: applies only to --method poles: add it, or"),
        (["puma560_geared", "--weights", "1", "1", "1"], "--weights: applies only to --method lqr"),
    ],
)
def test_the_command_refuses_in_a_line(capsys: pytest.CaptureFixture[str], command: list[str], message: str) -> None:
    assert main(["gains", *command]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert message in shown.err
