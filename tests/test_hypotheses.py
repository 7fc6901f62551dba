"""Hypotheses about a log: each fault is named, and a right log is left alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from nightly import mostly_at_night
from scipy.interpolate import CubicSpline
from synthetic_logs import Known, joint_drives, known, motion

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.contradictions import contradictions, excess_misfit
from adaptctl.identification.delay import delay_of
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION
from adaptctl.identification.gathering import gathered
from adaptctl.identification.held_out import HeldOut
from adaptctl.identification.hypotheses import AS_IS, LogMeaning, compared_hypotheses, validate_meaning
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.logs.units import POSITION, TORQUE

Fault = Callable[[JointLog, Known], JointLog]
SIGNS, ORDER = np.array([1.0, -1.0, 1.0]), [0, 2, 1]


@pytest.fixture(scope="module")
def case() -> Known:
    """Three revolute joints across gravity, links guessed."""
    return known(7, duration=10.0, rate=100.0, noise=0.01)


def judged(case: Known, *logs: JointLog) -> LogMeaning:
    evidence = gathered(case.guess, case.drives, logs)[0]
    return compared_hypotheses(evidence, delay_of(evidence))


def under(mechanism: Mechanism, gravity: list[float]) -> Mechanism:
    return type(mechanism)(replace(mechanism.description, gravity=np.array(gravity)))


def pulled(log: JointLog, case: Known, gravity: list[float]) -> JointLog:
    """The log under another gravity: statics differ alone."""
    still = np.zeros_like(log.position)
    before, after = (m.inverse_dynamics(log.position, still, still) for m in (case.truth, under(case.truth, gravity)))
    return replace(log, torque=log.torque + after - before)


FAULTS: dict[str, tuple[Fault, str]] = {
    "sign of a torque": (lambda log, _: replace(log, torque=log.torque * SIGNS), "column 'tau.joint1'"),
    "sign of a position": (lambda log, _: replace(log, position=log.position * SIGNS), "column 'p.joint1'"),
    "a mirrored joint": (
        lambda log, _: replace(log, position=log.position * SIGNS, torque=log.torque * SIGNS),
        "columns 'p.joint1' and 'tau.joint1' both have the other sign",
    ),
    "sign of all torques": (lambda log, _: replace(log, torque=-log.torque), "all torques"),
    "two torques exchanged": (
        lambda log, _: replace(log, torque=log.torque[:, ORDER]),
        "columns 'tau.joint1' and 'tau.joint2' are exchanged",
    ),
    "two positions exchanged": (
        lambda log, _: replace(log, position=log.position[:, ORDER]),
        "columns 'p.joint1' and 'p.joint2' are exchanged",
    ),
    "two joints exchanged": (
        lambda log, _: replace(log, position=log.position[:, ORDER], torque=log.torque[:, ORDER]),
        "all columns of joint1 and joint2 are exchanged",
    ),
    "zero of a joint": (
        lambda log, _: replace(log, position=log.position - [0.0, 0.5, 0.0]),
        "joint1 is at 28.* deg where its column has 0",
    ),
    "gravity turned": (lambda log, case: pulled(log, case, [0.0, 0.0, 9.81]), "gravity is along .*9.8"),
    "gravity absent": (lambda log, case: pulled(log, case, [0.0, 0.0, 0.0]), "gravity-compensated"),
    "scale of the times": (lambda log, _: replace(log, time=2.0 * log.time), "true times are 0[.](49|5|51)"),
    "scale of a torque": (
        lambda log, _: replace(log, torque=log.torque * [1, 0.02, 1]),
        "'tau.joint1' is about 0.0(19|2|21) ",
    ),
    "delay of the torques": (
        lambda log, _: replace(log, torque=np.concatenate([log.torque[:1].repeat(2, axis=0), log.torque[:-2]])),
        "the torques are (19|20|21) ms later than the positions",
    ),
    "a spring": (
        lambda log, _: replace(log, torque=log.torque + np.outer(log.position[:, 1] - 0.3, [0, 60.0, 0])),
        "a spring is at joint1, of (5[89]|6[012]).* N m/rad",
    ),
}


@pytest.mark.parametrize("kind", mostly_at_night(FAULTS, *list(FAULTS)[1::2]))
def test_a_fault_is_named_by_its_column_with_the_way_out(case: Known, kind: str) -> None:
    fault, words = FAULTS[kind]
    verdict = judged(case, fault(case.log, case))
    (named,) = [trial for trial in verdict.tried if trial.named]
    assert named.kind == kind, verdict.sentence
    assert re.search(words, verdict.sentence or ""), verdict.sentence
    assert named.error < 0.07
    assert not named.is_bound
    assert verdict.refuses == (kind not in ("a spring", "delay of the torques"))


def test_a_right_log_is_left_alone(case: Known) -> None:
    verdict = judged(case, case.log)
    first = verdict.tried[0]
    assert first.kind == AS_IS
    assert verdict.sentence is None
    assert not any(trial.named for trial in verdict.tried)
    assert len({trial.kind for trial in verdict.tried}) == len(FAULTS) + 3, "and counterbalances, units of positions"
    assert validate_meaning(verdict, False) == ()
    assert "joint2 is at" in verdict.alike.outcome, "the zero of a last joint, whose link is free"
    assert "joint1" not in verdict.alike.outcome


@pytest.mark.parametrize("unit", ["deg", "rev"])
def test_a_joint_in_a_unit_of_its_own_is_named(case: Known, unit: str) -> None:
    factor = np.where(np.arange(3) == 1, POSITION[unit], 1.0)
    verdict = judged(case, replace(case.log, position=case.log.position / factor))
    assert f"column 'p.joint1' is in {unit}, not rad" in (verdict.sentence or "")
    assert verdict.refuses


def test_angles_and_torques_of_another_unit_are_named(case: Known) -> None:
    def stated(**units: float) -> Known:
        return replace(case, drives=replace(case.drives, units=replace(case.drives.units, **units)))

    degrees = judged(stated(position=POSITION["deg"]), replace(case.log, position=np.radians(case.log.position)))
    assert "positions are in rad, not deg" in (degrees.sentence or "")
    for unit, other in (("N m", "mN m"), ("mN m", "N m")):
        log = replace(case.log, torque=case.log.torque * TORQUE[unit] / TORQUE[other])
        milli = judged(stated(torque=TORQUE[unit]), log)
        assert f"{other} taken for {unit}" in (milli.sentence or "")
        assert milli.refuses
    assert judged(stated(torque=TORQUE["mN m"]), case.log).sentence is None


def test_rows_are_those_of_the_filter_window_by_window(case: Known) -> None:
    rows = HypothesisRows.of(gathered(case.guess, case.drives, [case.log, replace(case.log, source="second")])[0])
    parts = rows._parts(rows.acceleration)
    np.testing.assert_allclose(
        rows.filtered(rows.acceleration), np.concatenate([f.signal(part) for _, f, part in parts]), rtol=1e-9, atol=1e-9
    )


def test_a_payload_in_one_of_two_logs_is_weighed(case: Known) -> None:
    rng = np.random.default_rng(5)
    other = replace(case.log, source="second", position=case.log.position[::-1] + 0.2 * rng.normal(size=3))
    rate = 100.0
    v = np.gradient(other.position, axis=0)
    a = np.gradient(v, axis=0)
    loaded = case.truth.inertial_parameters.copy()
    loaded[20:30] += [1.5, 0.3, 0.0, 0.15, 0.02, 0.0, -0.03, 0.08, 0.0, 0.06]
    motion = other.position, v * rate, a * rate**2
    full = case.truth.with_parameters(loaded).inverse_dynamics(*motion)
    verdict = judged(case, case.log, replace(other, torque=full))
    assert re.search("link2 carries a body in second .* of 1.5 kg", verdict.sentence or ""), verdict.sentence
    assert not verdict.refuses


def test_a_named_fault_refuses_a_log_unless_it_is_trusted(case: Known) -> None:
    verdict = judged(case, replace(case.log, torque=case.log.torque * SIGNS))
    with pytest.raises(InputError, match=r"'tau.joint1' has the other sign: .*; negate it, or .*--trust-log"):
        validate_meaning(verdict, False)
    assert validate_meaning(verdict, True) == (verdict.sentence,)


def test_no_meaning_is_given_to_torques_that_were_not_measured(case: Known) -> None:
    verdict = judged(case, replace(case.log, torque=case.log.torque * SIGNS))
    with pytest.raises(InputError, match=r"^record the torque of joint1, or take the log as it is by --trust-log"):
        validate_meaning(verdict, False, ["record the torque of joint1"])
    assert validate_meaning(verdict, True, ["record the torque of joint1"]) == ()


def test_torques_over_those_of_the_file_are_told_and_those_of_another_gear_side_asked_for(case: Known) -> None:
    """The file has links of the guess; 0.02 of all torques are as good a log, of a robot of a fiftieth of its mass."""
    right, geared = (judged(case, replace(case.log, torque=scale * case.log.torque)) for scale in (1.0, 0.02))
    told = [[float(x) for x in re.findall(r"(\S+) \(", verdict.slopes.outcome)] for verdict in (right, geared)]
    np.testing.assert_allclose(told[1], 0.02 * np.array(told[0]), rtol=0.06)
    assert not right.other_side
    assert geared.other_side
    assert geared.slopes.outcome.endswith("are they on the other side of gears?")
    assert geared.sentence is None
    assert not judged(case, replace(case.log, torque=50.0 * case.log.torque)).other_side


@pytest.mark.parametrize(
    ("rate", "late"),
    mostly_at_night(
        [(rate, late) for rate in (100.0, 250.0, 500.0, 1e3, 2e3, 5e3) for late in (0.0, 5e-4, 3e-3, 0.01, 0.03)],
        (1e3, 3e-3),
    ),
)
def test_a_delay_is_told_to_a_tenth_of_a_sample_or_called_not_determinable(rate: float, late: float) -> None:
    case = known(7, duration=10.0, rate=rate, noise=0.01)
    log = case.log
    at = log.time[log.time + late <= log.time[-1]] + late
    ahead = CubicSpline(log.time, log.position)(at)
    found = delay_of(gathered(case.guess, case.drives, [JointLog("late", at, ahead, log.torque[: len(at)])])[0])
    assert abs(found.value - late) < max(1e-3, 0.1 / rate) or not found.determinable
    assert found.determinable or rate < 1e3


def test_friction_that_gives_way_before_it_slides_is_no_delay(case: Known) -> None:
    """Dahl's friction, over 3 mrad after a reversal, is late at each joint by its own time."""
    step = np.diff(case.log.position, axis=0, prepend=case.log.position[:1])
    kept, slides = np.exp(-np.abs(step) / 3e-3), np.zeros_like(step)
    for i in range(1, len(step)):
        slides[i] = kept[i] * slides[i - 1] + (1.0 - kept[i]) * np.sign(step[i])
    friction = 0.3 * np.sqrt(np.mean(case.log.torque**2, axis=0)) * slides
    delay = delay_of(evidence_of(case.guess, case, case.log.torque + friction))
    assert abs(delay.value) < 2.0 * delay.deviation < 4e-3


def test_a_slide_that_a_turning_joint_carries_has_a_zero() -> None:
    """As far as the slide is out, so far do links beyond it turn about the joint before."""
    case = known(27, links=4, duration=10.0, rate=100.0, noise=0.01)
    assert not case.truth.primary_joints[1].kind.is_revolute
    said = judged(case, replace(case.log, position=case.log.position - [0.0, 0.5, 0.0, 0.0]))
    words = r"joint1 is at 0.5\d* m where its column has 0: .*; add 0.5\d* m to its positions, or give joint_offsets in"
    assert re.search(words, said.sentence or "")
    assert said.refuses


def test_a_spring_at_one_of_many_joints_is_named() -> None:
    """The error is a mean over the joints: of four it falls by less than a third where the spring's falls by two."""
    case = known(16, links=4, duration=10.0, rate=100.0, noise=0.01)
    spring = 10.0 * np.outer(case.log.position[:, 2] - 0.3, np.arange(4) == 2)
    verdict = judged(case, replace(case.log, torque=case.log.torque + spring))
    assert "a spring is at joint2, of " in (verdict.sentence or "")
    (named,) = [trial for trial in verdict.tried if trial.named]
    assert 1.5**0.75 < verdict.tried[0].error / named.error < 1.5
    assert not verdict.refuses


def moved(case: Known) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations of the log."""
    v = np.gradient(case.log.position, case.log.time, axis=0)
    return case.log.position, v, np.gradient(v, case.log.time, axis=0)


def test_meanings_that_a_log_does_not_tell_apart_are_all_named() -> None:
    """An arm in a vertical plane, hung from the ceiling, is one whose first joint is turned by 180 degrees."""
    arm = load("two_link")
    time, p, v, a = motion(arm.dof, np.random.default_rng(3), 10.0, 100.0)
    hung = JointLog("hung", time, p, under(arm, [-g for g in arm.description.gravity]).inverse_dynamics(p, v, a))
    evidence = gathered(arm, joint_drives(arm), [hung])[0]
    said = compared_hypotheses(evidence, delay_of(evidence)).sentence or ""
    first = arm.primary_joints[0].name
    assert f"{first} is at 180 deg where its column has 0" in said
    assert "; or, as the log tells as well, " in said
    assert "gravity is along" in said
    assert "delay" not in said


def evidence_of(file: Mechanism, case: Known, torque: Array) -> LogEvidence:
    return gathered(file, case.drives, [replace(case.log, torque=torque)])[0]


def asked_of_gears(file: Mechanism, case: Known, torque: Array) -> bool:
    return HypothesisRows.of(evidence_of(file, case, torque)).file_slopes()[1]


def test_gears_other_side_is_asked_of_the_joints_that_the_links_load_alone(case: Known) -> None:
    """A light last link with a rotor, which no file of links has, and which takes most of its torque, as at wrists."""
    truth, file = (
        m.with_parameters(m.inertial_parameters * np.where(np.arange(m.inertial_parameters.size) // 10 == 2, 0.01, 1.0))
        for m in (case.truth, case.guess)
    )
    p, v, a = moved(case)
    torque = truth.inverse_dynamics(p, v, a)
    torque[:, 2] += 0.05 * np.ptp(torque) / np.ptp(a[:, 2]) * a[:, 2]
    assert asked_of_gears(file, case, 0.02 * torque)
    assert not asked_of_gears(file, case, torque)


def test_neither_gears_nor_counterbalances_are_asked_of_placeholders(case: Known) -> None:
    """Links of the same values at each joint, and nearly the same ones, under a hundredth of their torques."""
    values = np.tile(case.guess.inertial_parameters[10:20], 3)
    same, other = (case.guess.with_parameters(values * scale) for scale in (1.0, np.repeat([1.0, 1.01, 1.02], 10)))
    torque = 0.01 * same.inverse_dynamics(*moved(case))
    evidence = [evidence_of(file, case, torque) for file in (other, same)]
    asked = [HypothesisRows.of(one).file_slopes()[1] for one in evidence]
    settings = FitSettings(SIMPLE_FRICTION, 0.1, evidence[0].band)
    told = ["; ".join(contradictions(one, one.fit(settings, range(one.blocks)))) for one in evidence]
    assert asked == [True, False]
    assert ["check for a counterbalance, for gravity compensation, and for its torque" in words for words in told] == [
        True,
        False,
    ]


def test_a_small_mean_of_a_torque_that_swings_is_no_counterbalance(case: Known) -> None:
    """The mean torque of a swing is a matter of chance; a torque that hardly swings about it has less than the file."""
    torque = case.guess.inverse_dynamics(*moved(case))
    swing = torque - torque.mean(axis=0)
    assert np.abs(torque.mean(axis=0)).max() > 0.1 * swing.std(axis=0).max()
    otherwise = [evidence_of(case.guess, case, values) for values in (swing, 0.01 * swing)]
    assert [bool(one.weighing_otherwise(one.band)) for one in otherwise] == [False, True]


def test_a_misfit_above_least_squares_is_a_warning_where_these_predict_better(case: Known) -> None:
    """Links of negative moments, which no body has; and bodies, of whose noise least squares take more."""
    negative = case.truth.inertial_parameters.copy()
    negative[4:30:10] -= 5.0 * np.abs(negative[4:30]).max()
    found = []
    for links, noise in ((negative, 0.0), (case.truth.inertial_parameters, 3.0)):
        torque = case.truth.with_parameters(links).inverse_dynamics(*moved(case))
        whole = evidence_of(case.guess, case, torque + noise * np.random.default_rng(3).normal(size=torque.shape))
        short, rest = whole.part(range(2)), whole.part(range(2, whole.blocks))
        fit = short.fit(FitSettings(SIMPLE_FRICTION, 0.1, whole.band), range(short.blocks))
        found.append(excess_misfit(short, fit, HeldOut(rest, "the rest", whole.band, whole.band)))
    assert "no body can have (check that the log is this robot's" in str(found[0].warning)
    assert found[1].warning is None
    assert "above that of least squares" in found[1].step.outcome
