"""Checks of logs: faults of rows and columns are named and mended, right logs pass as they are."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from nightly import nightly
from synthetic_logs import Known, known

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel, unmoved_terms
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified, identified_mechanism
from adaptctl.identification.log_checks import checked_log, still_joints, still_words, unmeasured, validate_signed


@pytest.fixture(scope="module")
def case() -> Known:
    return known(7, duration=10.0, rate=200.0, noise=0.01)


def put(values: Array, rows: slice | list[int], columns: int | slice, new: float | Array) -> Array:
    changed = values.copy()
    changed[rows, columns] = new
    return changed


def without_rows(log: JointLog) -> JointLog:
    """The log without one row in a hundred, its stamps as even as before."""
    kept = np.arange(len(log)) % 100 != 99
    return replace(log, time=log.time[: kept.sum()], position=log.position[kept], torque=log.torque[kept])


FAULTS: dict[str, tuple[Callable[[JointLog], JointLog], str]] = {
    "positions at 0": (
        lambda log: replace(log, position=put(log.position, [300, 700, 701, 1500], 1, 7.0)),
        "'joint1' has 4 positions that it cannot reach, the first in row 301, at 1.5 s; filled",
    ),
    "torques far off": (
        lambda log: replace(log, torque=put(log.torque, [400, 900], 2, 1e3)),
        "'joint2' has 2 torques that stand out of their neighbours, the first in row 401",
    ),
    "clipped": (
        lambda log: replace(log, torque=np.clip(log.torque, *(s * np.abs(log.torque).max() / 2 for s in (-1, 1)))),
        "is clipped: [0-9]+ rows have exactly",
    ),
    "frozen": (
        lambda log: replace(log, torque=put(log.torque, slice(1000, 1160), slice(None), log.torque[1000])),
        "the torques of joints 'joint0', 'joint1', 'joint2' are frozen at .* from 5 to 5.795 s",
    ),
    "dead": (
        lambda log: replace(log, torque=put(log.torque, slice(None), 1, 1e-4 * np.sin(log.time))),
        "'joint1' is .* to within 0.0002: its sensor seems dead",
    ),
    "absolute values": (
        lambda log: replace(log, torque=np.abs(log.torque) * [1.0, 1.0, -1.0]),
        r"torques fall to 0 and are never negative, of joints 'joint0' \(\d+ times\), 'joint1' \(\d+ times\): are",
    ),
    "a slip": (
        lambda log: replace(log, position=log.position + np.outer(log.time >= 5.0, [0.0, 0.5, 0.0])),
        r"the position of joint 'joint1' steps by (0\.[45]|-0\.[45]).* in row 1001, at 5 s, and stays there: its ",
    ),
    "a frozen position": (
        lambda log: replace(log, position=put(log.position, slice(880, 1080), 1, log.position[880, 1])),
        "the position of joint 'joint1' is frozen at .* from 4.4 to 5.395 s; cut",
    ),
    "a copied column": (
        lambda log: replace(log, torque=log.torque[:, [0, 0, 2]]),
        "the torques of joints 'joint0' and 'joint1' are equal in all rows",
    ),
    "rows lost at even stamps": (
        without_rows,
        "in 19 rows, the first row 100, at 0.495 s, all joints move 2 times as far as around it",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_joint_and_row(case: Known, fault: str) -> None:
    spoil, words = FAULTS[fault]
    checked, _ = checked_log(spoil(case.log), case.guess)
    assert any(re.search(words, note) for note in checked.notes), checked.notes


def test_impossible_rows_are_filled_as_they_were(case: Known) -> None:
    for fault in ("positions at 0", "torques far off"):
        checked, _ = checked_log(FAULTS[fault][0](case.log), case.guess)
        assert np.abs(checked.position - case.log.position).max() < 1e-4
        assert np.abs(checked.torque - case.log.torque).max() < 0.1 * np.ptp(case.log.torque, axis=0).max()


@pytest.mark.parametrize("quantum", [1e-9, 2 * np.pi / 4096, 0.01])
def test_right_logs_pass_as_they_are(case: Known, quantum: float) -> None:
    position, steps = np.round(case.log.position / quantum) * quantum, 0.02 * np.ptp(case.log.torque, axis=0)
    log = replace(case.log, position=position, torque=np.round(case.log.torque / steps) * steps)
    checked, facts = checked_log(log, case.guess)
    assert checked.notes == ()
    assert np.array_equal(checked.position, log.position)
    assert np.array_equal(checked.torque, log.torque)
    words = dict(facts)
    assert words["rows of synthetic"].startswith("2000 rows of 9.995 s at 200 Hz")
    assert (quantum < 1e-6) == (words["quanta of positions of synthetic"] == "below the noise")


def test_facts_tell_gaps_and_joints_that_stand_still(case: Known) -> None:
    kept = np.r_[:800, 900:2000]
    still = put(case.log.position, slice(None), 2, 0.3)[kept]
    _, facts = checked_log(JointLog("a", case.log.time[kept], still, case.log.torque[kept]), case.guess)
    words = dict(facts)
    assert "1 gaps, the longest of 0.505 s" in words["rows of a"]
    assert words["still joints of a"] == "joint2"


def test_joints_that_stand_still_in_all_logs_are_named(case: Known) -> None:
    held = replace(case.log, position=put(case.log.position, slice(None), 1, 0.3))
    assert still_joints([held, held], case.guess) == ["joint1"]
    (words,) = still_words(["joint1"])
    assert words.startswith("joint1 stands still: its friction and rotor inertia stay open")
    assert still_joints([held, case.log], case.guess) == []


def test_a_log_in_which_no_joint_moves_far_is_refused(case: Known) -> None:
    """Positions in m or rad that were taken for mm or mrad."""
    small = replace(case.log, position=2e-3 * case.log.position / np.abs(case.log.position).max())
    with pytest.raises(InputError, match=r"synthetic: no joint moves by 0.01 rad .* or more; check the unit"):
        identified(case.guess, case.drives, [small])


@pytest.mark.parametrize(("mean", "words"), [(0.0, r" \(all swing about 0, as velocities do\)"), (0.3, "")])
def test_positions_that_explain_nothing_and_swing_about_zero_may_be_velocities(
    case: Known, mean: float, words: str
) -> None:
    position = mean + case.log.position - case.log.position.mean(axis=0)
    log = replace(case.log, position=position, torque=np.random.default_rng(0).normal(size=position.shape))
    with pytest.raises(InputError, match=f"do not explain .* no velocities{words}; with noisy"):
        identified(case.guess, case.drives, [log], trust_log=True)


@pytest.mark.parametrize("drive", [Drive(viscous=0.7, coulomb=2.0), Drive()])
def test_friction_of_a_joint_that_stands_still_is_the_files(case: Known, drive: Drive) -> None:
    """A rough value of 1 was written before."""
    held = put(case.log.position, slice(None), 2, 0.3)
    v, a = (put(x, slice(None), 2, 0.0) for x in (np.gradient(held, case.log.time, axis=0), np.zeros_like(held)))
    a[:, :2] = np.gradient(v[:, :2], case.log.time, axis=0)
    log = replace(case.log, position=held, torque=case.truth.inverse_dynamics(held, v, a))
    guess = case.guess.with_drives([Drive(), Drive(), drive])
    evidence = gathered(guess, case.drives, [log])[0]
    untold = unmoved_terms(evidence.mechanism, still_joints([log], guess))
    fit = evidence.fit(FitSettings(FrictionModel(), 0.1, evidence.band, untold=untold), range(evidence.blocks))
    found = identified_mechanism(evidence, fit, guess)
    own = found.primary_joints[2].drive
    assert (own.viscous, own.coulomb, own.rotor_inertia) == (drive.viscous, drive.coulomb, None)
    assert found.primary_joints[1].drive.viscous == pytest.approx(2.0, rel=0.1)


@nightly
def test_friction_of_a_joint_that_stands_still_is_uncertain(case: Known) -> None:
    held = replace(case.log, position=put(case.log.position, slice(None), 2, 0.3))
    guess = case.guess.with_drives([Drive(), Drive(), Drive(viscous=0.7)])
    found = identified(guess, case.drives, [held], friction=FrictionModel(), prior_weight=0.1, trust_log=True)
    deviations = dict(zip(found.names, found.deviations.tolist(), strict=True))
    assert deviations["joint2.viscous"] > 0.7
    assert "joint2.coulomb" not in found.names


def test_a_refusal_begins_with_the_fault_that_leads_to_it(case: Known) -> None:
    dead = put(case.log.torque, slice(None), 1, 1e-4 * np.sin(case.log.time))
    wrong = replace(case.log, torque=dead, velocity=60.0 * np.gradient(case.log.position, case.log.time, axis=0))
    with pytest.raises(InputError, match=r"'joint1' is .*: its sensor seems dead; synthetic: joint .*: logged velocit"):
        identified(case.guess, case.drives, [wrong])


def test_what_was_not_measured_is_told_before_what_columns_mean(case: Known) -> None:
    logs = [FAULTS[fault][0](case.log) for fault in ("a frozen position", "dead")]
    remedies = ["record the torque of joint1", "cut the stretches out of the log that freeze joint1"]
    assert unmeasured(logs, case.guess) == remedies
    assert unmeasured([case.log], case.guess) == []


def test_torques_of_several_joints_that_have_lost_their_signs_are_refused(case: Known) -> None:
    with pytest.raises(InputError, match=r"never negative, of joints .*; torques without signs .*--trust-log"):
        identified(case.guess, case.drives, [FAULTS["absolute values"][0](case.log)])
    one = np.where(np.arange(3) == 1, np.abs(case.log.torque), case.log.torque)
    validate_signed([replace(case.log, torque=one)], case.guess)
