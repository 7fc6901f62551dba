"""Springs from logs: found where they are, and named without a number where the motion does not tell them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nightly import at_night
from synthetic_logs import Known, known, motion

from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.errors import InputError
from adaptctl.identification.choice import choose
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.hypotheses import AS_IS, LogMeaning, TriedHypothesis
from adaptctl.identification.identify import identified
from adaptctl.identification.listed_hypotheses import COUNTERBALANCE, DELAY, SPRING
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.springs import (
    is_answered,
    known_springs,
    left_out,
    spring_kinds,
    told_kinds,
    validate_told,
    with_springs,
    with_untold_springs,
)
from adaptctl.identification.uncertainty import Uncertainty, uncertainty
from adaptctl.identification.validation import validate_plausible

STIFFNESS, REST = 40.0, 0.3
STEP = PreparationStep("", "")
NAMED = FrictionModel.named("viscous,coulomb,offset,stiffness,sine,cosine")


@pytest.fixture(scope="module")
def case() -> Known:
    """Three revolute joints across gravity, a spring at the second."""
    made = known(7, duration=10.0, rate=100.0, noise=0.01)
    torque = made.log.torque.copy()
    torque[:, 1] += STIFFNESS * (made.log.position[:, 1] - REST)
    return replace(made, log=replace(made.log, torque=torque))


def test_a_spring_is_found_and_one_that_is_gravity_is_named(case: Known) -> None:
    """The first joint's mass moments are its sine and cosine; the true ones of all others are 0."""
    found = identified(case.guess, case.drives, [case.log], [case.log], friction=NAMED, cutoff=8.75, prior_weight=1.0)
    names, drives = list(found.names), [link.joint.drive for link in found.mechanism.links]
    assert [drive.sine is None for drive in drives] == [True, False, False]
    assert [drive.stiffness is None for drive in drives] == [False, False, False]
    for name, true in (("joint1.stiffness", STIFFNESS), ("joint0.stiffness", 0.0), ("joint2.sine", 0.0)):
        k = names.index(name)
        assert abs(found.estimate[k] - true) < 3.0 * found.deviations[k]
    assert found.deviations[names.index("joint1.stiffness")] < 0.1 * STIFFNESS
    told = [warning for warning in found.warnings if "does not tell" in warning]
    assert [warning.split(" from ")[0] for warning in told] == [
        "joint0: the log does not tell sine",
        "joint0: the log does not tell cosine",
    ]
    assert not any("a spring is at" in warning for warning in found.warnings)


@pytest.mark.parametrize("sprung", [at_night(True), False])
def test_a_spring_is_chosen_only_where_there_is_one(case: Known, sprung: bool) -> None:
    log = case.log if sprung else known(7, duration=10.0, rate=100.0, noise=0.01).log
    tried = with_springs(case.guess, None)
    evidence, _, _ = gathered(tried, case.drives, [log], cutoff=8.75)
    kinds = choose(evidence, None, 1.0, 8.75).settings.friction.kinds
    assert (DriveParameter.STIFFNESS in kinds) is sprung


def test_a_motion_too_small_for_a_spring_is_refused(case: Known) -> None:
    """Where the sine of the angle is the angle, a spring is the links' weight."""
    p = 0.5 + 0.03 * case.log.position
    v = np.gradient(p, 0.01, axis=0)
    torque = case.truth.inverse_dynamics(p, v, np.gradient(v, 0.01, axis=0))
    noise = 0.01 * np.sqrt(np.mean(torque**2, axis=0)) * np.random.default_rng(1).normal(size=p.shape)
    small = replace(case.log, position=p, torque=torque + noise)
    evidence, _, _ = gathered(with_springs(case.guess, NAMED), case.drives, [small], cutoff=8.75)
    with pytest.raises(InputError, match="friction: the log does not tell stiffness from the gravity of links"):
        choose(evidence, NAMED, 1.0, 8.75)


def test_a_spring_left_out_as_untold_is_an_error_of_others(case: Known) -> None:
    """The offset of the joint takes the spring's rest: farther than noise would move it."""
    evidence, _, _ = gathered(with_springs(case.guess, NAMED), case.drives, [case.log], cutoff=8.75)
    fit = evidence.fit(FitSettings(NAMED, 1e-3, 8.75, untold=("joint1.stiffness",)), range(evidence.blocks))
    place = evidence.mechanism.parameter_names.index("joint1.offset")
    noise = uncertainty(evidence, fit)
    offset = np.eye(len(fit.x))[[place]]
    off = abs(fit.x[place] + STIFFNESS * REST)
    assert 2.0 * noise.of(offset)[0] < off < 2.0 * with_untold_springs(noise, evidence, fit).of(offset)[0]


def test_the_error_by_a_spring_left_out_is_what_fitting_it_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """In least squares without a prior, whose normal equations are whole."""
    rng = np.random.default_rng(5)
    Y, t = rng.normal(size=(60, 4)), rng.normal(size=60)
    without, whole = (np.linalg.lstsq(Y[:, :k], t)[0] for k in (3, 4))
    equations = SimpleNamespace(whitened=lambda deviations: (Y.T @ Y, Y.T @ t))
    names = ("joint1.viscous", "joint1.coulomb", "joint1.offset", "joint1.stiffness")
    evidence: Any = SimpleNamespace(
        mechanism=SimpleNamespace(parameter_names=names), blocks=2, equations=lambda *_: equations,
        independent=lambda settings: np.arange(3),
    )  # fmt: skip
    settings = SimpleNamespace(friction=NAMED, untold=("joint1.stiffness",))
    fit: Any = SimpleNamespace(settings=settings, deviations=None, x=np.append(without, 0.0))
    inverse = np.zeros((4, 4))
    inverse[:3, :3] = np.linalg.inv(Y[:, :3].T @ Y[:, :3])
    monkeypatch.setattr("adaptctl.identification.springs.inverse_curvature", lambda *_: (inverse, None))
    before: Any = Uncertainty(*[np.eye(4)] * 3, None, np.eye(4), None)  # type: ignore[arg-type]
    bias = with_untold_springs(before, evidence, fit).bias - np.eye(4)
    moved, variance = without - whole[:3], np.linalg.inv(Y.T @ Y)[3, 3]
    each = moved / whole[3]
    np.testing.assert_allclose(bias[:3, :3], np.outer(moved, moved) + 9.0 * variance * np.outer(each, each))


def test_springs_of_the_file_are_tried_as_they_are(case: Known) -> None:
    filed = case.guess.with_drives([Drive(), Drive(cosine=1.0), Drive()])
    assert known_springs(filed, None) == (DriveParameter.COSINE,)
    assert with_springs(filed, None) is filed
    asked = with_springs(filed, FrictionModel.named("viscous,stiffness"))
    assert [name for name in asked.parameter_names if "joint" in name] == [f"joint{j}.stiffness" for j in range(3)]


def test_a_spring_that_has_most_of_the_torque_is_not_another_robot(case: Known) -> None:
    """Without the spring the equations leave more than half; with it, asked for, they explain the log."""
    torque = case.log.torque.copy()
    torque[:, 1] += 3000.0 * case.log.position[:, 1]
    stiff = replace(case.log, torque=torque)
    evidence, _, _ = gathered(with_springs(case.guess, NAMED), case.drives, [stiff], cutoff=8.75)
    with pytest.raises(InputError, match="do not explain"):
        validate_plausible(evidence, "log", 8.75)
    validate_plausible(evidence, "log", 8.75, known_springs(case.guess, NAMED))


def test_a_joint_of_one_speed_is_not_refused_for_springs_beside_its_friction() -> None:
    """An offset takes its place, so that the friction itself, which a plain fit tells, may have any sign."""
    made = known(7, duration=4.0, rate=100.0, noise=0.0)
    time, p, v, a = motion(3, np.random.default_rng(7), 4.0, 100.0)
    p[:, 2], v[:, 2], a[:, 2] = 0.3 * time + 3e-4 * np.sin(3.0 * time), 0.3 + 9e-4 * np.cos(3.0 * time), 0.0
    torque = made.truth.inverse_dynamics(p, v, a)
    noise = 0.05 * np.sqrt(np.mean(torque**2, axis=0)) * np.random.default_rng(0).normal(size=torque.shape)
    mechanism = with_springs(made.guess, None)
    log = replace(made.log, position=p, torque=torque + noise)
    evidence = gathered(mechanism, made.drives, [log])[0]
    validate_plausible(evidence, "log", max(evidence.rows), spring_kinds(mechanism))


def test_a_spring_that_no_fit_may_have_is_named_where_the_log_is_refused(case: Known) -> None:
    torque = case.log.torque.copy()
    torque[:, 1] += 3000.0 * case.log.position[:, 1]
    stiff = replace(case.log, torque=torque)
    friction = FrictionModel.named("viscous,coulomb")
    with pytest.raises(InputError, match=r"a spring is at joint1, of 3.*; --friction .*; .* do not explain"):
        identified(case.guess, case.drives, [stiff], [stiff], friction=friction, cutoff=8.75, prior_weight=1.0)


@pytest.mark.parametrize(
    ("kind", "terms", "freed", "answered"),
    [
        (SPRING, "viscous,stiffness", False, True),
        (SPRING, "viscous,sine,cosine", False, False),
        (COUNTERBALANCE, "viscous,sine,cosine", False, True),
        (SPRING, "viscous", True, False),
        (DELAY, "viscous,stiffness", True, True),
        (DELAY, "viscous,stiffness", False, False),
        (AS_IS, "viscous,stiffness", True, False),
    ],
)
def test_what_a_log_names_is_answered_by_a_spring_of_its_kind_or_a_delay_taken_off(
    kind: str, terms: str, freed: bool, answered: bool
) -> None:
    named, other = TriedHypothesis(kind, "", 0.1, named=True), TriedHypothesis(SPRING, "", 0.1)
    meaning = LogMeaning((named, other), None, False, STEP, False, STEP)
    assert is_answered(meaning, FrictionModel.named(terms), freed) == answered


def test_kinds_of_springs_are_told_that_are_at_one_joint() -> None:
    arm = known(1, 2).truth.with_drives(Drive(stiffness=1.0, sine=2.0))
    names, kinds = ("joint0.stiffness", "joint0.sine", "joint1.sine"), (DriveParameter.STIFFNESS, DriveParameter.SINE)
    assert told_kinds(arm, ()) == kinds
    assert told_kinds(arm, names) == kinds[:1]
    validate_told(FrictionModel.named("viscous,stiffness"), arm, names)
    with pytest.raises(InputError, match="does not tell sine from"):
        validate_told(FrictionModel.named("viscous,sine"), arm, names)


def test_springs_that_nobody_expects_are_not_told_as_untold(case: Known) -> None:
    right, sprung = (
        LogMeaning((TriedHypothesis(kind, "", 0.1, named=True),), None, False, STEP, False, STEP)
        for kind in (AS_IS, SPRING)
    )
    settings = FitSettings(NAMED, 1.0, 8.75, untold=("joint1.stiffness", "joint2.coulomb"))
    stiffness = (DriveParameter.STIFFNESS,)
    told = [list(left_out(settings, *given)) for given in (((), right), ((), sprung), (stiffness, right))]
    assert [len(words) for words in told] == [0, 1, 1]
    assert told[1][0].startswith("joint1: the log does not tell stiffness")
