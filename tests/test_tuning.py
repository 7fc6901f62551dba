"""Tuning: bounds that are kept, joints that limit only themselves, words that are true, and gains that learn."""

from __future__ import annotations

import json
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
from nightly import at_night, nightly

from adaptctl.cli.main import main
from adaptctl.control import Sinusoids
from adaptctl.control.gains.adaptation_ratio import adaptation_ratio
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.control.gains.sampling_ratio import sampling_ratios
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, SimplificationWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import LinearlyImplicitEuler, Plant, simulate_many
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.effects.actuators import ControlDelay
from adaptctl.tuning import Tuning, tune
from adaptctl.tuning.default_gains import DefaultGains
from adaptctl.tuning.feasible_gains import feasible_gains
from adaptctl.tuning.feasible_reference import judged_reference
from adaptctl.tuning.trial_runs import RECORD_INTERVAL
from adaptctl.tuning.verification import Trials, TrialSetting
from tests.random_trees import random_chain, random_tree
from tests.robot_files import urdf

PERIOD = 1e-3
PUMA = load("puma560_measured")


@pytest.fixture(scope="module")
def tuned() -> Tuning:
    return tune(PUMA)


def rule(tuning: Tuning) -> DefaultGains:
    return DefaultGains.for_mechanism(tuning.mechanism, reference=tuning.reference, initial_error=tuning.initial_error)


@pytest.mark.parametrize("name", ["semi_direct_drive", *map(at_night, ("puma560_measured", "puma560_friction"))])
def test_it_learns_as_described_and_late_and_with_other_links(name: str) -> None:
    tuning = tune(load(name))
    assert [run.name for run in tuning.verified] == ["nominal", "one-period delay", "link errors ±30%", "both"]
    for run in tuning.verified:
        assert run.is_learning, run
        assert run.final_rms_error < 2e-3
    assert tuning.is_learning


def test_the_nominal_run_alone_changes_no_choice() -> None:
    all_runs, alone = (tune(load("two_link"), nominal_only=only) for only in (False, True))
    numbers, expected = ([x for x in astuple(found.verified[0]) if isinstance(x, float)] for found in (alone, all_runs))
    assert len(numbers) == 6
    assert len(alone.verified) == 1
    assert numbers == pytest.approx(expected, rel=1e-12)
    assert alone.notes == all_runs.notes
    np.testing.assert_array_equal(alone.gains.damping, all_runs.gains.damping)
    np.testing.assert_array_equal(alone.adaptation, all_runs.adaptation)


def test_stated_effects_are_judged_by_all_runs() -> None:
    assert len(tune(load("two_link"), effects=[ControlDelay(1)], nominal_only=True).verified) == 4


def test_the_reference_stays_within_the_torque_limits(tuned: Tuning) -> None:
    points = tuned.reference(np.linspace(0.0, 20.0, 501))
    share = np.abs(PUMA.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / finite_torque_limits(PUMA)
    assert share.max() < 0.62
    np.testing.assert_allclose(share, tuned.torque_share, atol=0.02)
    lower, upper = np.array([(j.limits.lower, j.limits.upper) for j in PUMA.primary_joints]).T
    assert np.all((points.p > lower) & (points.p < upper))


@pytest.mark.parametrize("hold", [0.1, 0.5])
def test_gains_keep_to_the_numbers_that_are_asked(tuned: Tuning, hold: float) -> None:
    mine = rule(tuned)
    found = mine.proposed(4.0, hold, 0.2, "ranges")
    K = np.diag(found.feasible.gains.damping)
    numbers = PERIOD * np.linalg.eigvals(np.linalg.solve(PUMA.mass_matrix(mine.postures), K)).real
    assert numbers.max() <= hold * (1.0 + 1e-9)
    assert numbers.max() > 0.9 * hold  # and does not leave it lie
    affordable = 0.5 * tuned.torque_limits / (found.feasible.gains.bandwidth * tuned.initial_error)
    assert np.all(found.feasible.gains.damping <= affordable * (1.0 + 1e-9))
    assert np.all(found.feasible.gains.bandwidth <= 4.0)


@pytest.mark.parametrize("shares", ["ranges", "links", "parameters", "mixed"])
def test_adaptation_gains_have_the_number_that_is_asked(tuned: Tuning, shares: str) -> None:
    mine = rule(tuned)
    found = mine.proposed(4.0, 0.5, 0.3, shares)  # type: ignore[arg-type]
    rates, points = found.feasible.gains.bandwidth, mine.reference_points
    v_r, a_r = points.v - rates * mine.errors, points.a + rates**2 * mine.errors
    Y = PUMA.slotine_li_regressor(points.p + mine.errors, points.v, v_r, a_r)
    K = found.feasible.gains.damping
    products = (Y * found.gain) @ np.swapaxes(Y, -1, -2)
    exact = PERIOD * np.linalg.eigvals(products / K[:, None]).real.max()
    assert exact == pytest.approx(0.3, rel=1e-9)
    assert adaptation_ratio(Y, K, found.gain, PERIOD) == pytest.approx(0.3, rel=1e-9)
    assert np.all(found.gain > 0.0)


def test_a_rotor_shares_with_its_link() -> None:
    """A share of its own, as large as a whole link's, made estimates of rotors ring in the humanoid of gymnasium."""
    geared = load("puma560_geared")
    mine = rule(tune(geared, nominal_only=True))
    found, ranges = mine.proposed(4.0, 0.5, 0.3, "links"), mine.ranges
    names = list(geared.parameter_names)
    for link in geared.links:
        rotor, body = names.index(f"{link.joint.name}.rotor_inertia"), names.index(f"{link.name}.I_zz")
        assert found.gain[rotor] / found.gain[body] == pytest.approx((ranges[rotor] / ranges[body]) ** 2)


def test_mixed_shares_are_half_of_each_kind(tuned: Tuning) -> None:
    mine = rule(tuned)
    ranges, links, mixed = (mine.proposed(4.0, 0.5, 0.3, kind).gain for kind in ("ranges", "links", "mixed"))
    both = ranges + links
    np.testing.assert_allclose(mixed, both * (mixed[0] / both[0]), rtol=1e-9)


def test_a_light_wrist_does_not_weaken_the_shoulder(tuned: Tuning) -> None:
    """A last link of a hundredth of its mass: its own K falls, the first three joints' hardly do."""
    light = PUMA.inertial_parameters.copy()
    light[50:60] *= 0.01
    other = PUMA.with_parameters(light)
    postures = rule(tuned).postures
    given = tuned.torque_limits, postures, tuned.initial_error, PERIOD, 4.0, 0.5
    mine, its = (feasible_gains(arm, *given).gains.damping for arm in (PUMA, other))
    assert its[5] < 0.2 * mine[5]
    np.testing.assert_allclose(its[:3], mine[:3], rtol=0.1)


def test_the_rotor_that_is_named_allows_four_times_the_damping(tuned: Tuning) -> None:
    """The free inertia grows by the rotor's: 1/(M + r e e')^-1_jj = 1/(M^-1)_jj + r."""
    mine = rule(tuned)
    carried = mine.proposed(4.0, 0.5, 0.2, "ranges").feasible
    assert carried.limited_by_sampling[5]
    assert tuned.limited_by[5].startswith("K is limited by the sampling period; adding ")
    rotor = 3.0 * carried.free_inertia[5]
    drives = [Drive() for _ in range(5)] + [Drive(float(rotor))]
    helped = feasible_gains(
        PUMA.with_drives(drives), tuned.torque_limits, mine.postures, tuned.initial_error, PERIOD, 4.0, 0.5
    )
    assert helped.gains.damping[5] / carried.gains.damping[5] == pytest.approx(4.0, rel=0.3)


def test_ratios_are_told_of_positions_to_which_no_gain_was_fitted(tuned: Tuning) -> None:
    rng, gains = np.random.default_rng(77), tuned.gains
    points = tuned.reference(rng.uniform(0.0, 20.0, 20_000))
    error = tuned.initial_error * rng.choice([-1.0, 1.0], points.p.shape)
    v_r, a_r = points.v - gains.bandwidth * error, points.a + gains.bandwidth**2 * error
    Y = PUMA.slotine_li_regressor(points.p + error, points.v, v_r, a_r)
    fresh = adaptation_ratio(Y, gains.damping, tuned.adaptation, PERIOD)
    assert tuned.adaptation_ratio > 1.02 * 0.5  # more than where it was fitted
    assert 0.95 * tuned.adaptation_ratio < fresh < 1.05 * tuned.adaptation_ratio
    margin = rng.uniform(-0.2, 0.2, points.p.shape)
    ratios = sampling_ratios(PUMA, points.p + margin, gains.damping, PERIOD)
    assert 0.98 * tuned.sampling_ratio < ratios.max() < 1.02 * tuned.sampling_ratio


@pytest.mark.parametrize("kind", ["gradient", "learning"])
def test_a_trial_is_slotine_and_li_on_the_reduced_model(kind: str) -> None:
    arm = load("two_link")
    tuned, model = tune(arm), ReducedModel(arm)
    law = tuned.controller(model, kind)
    plant = Plant(arm, PERIOD, tuned.substeps, tuned.integrator, tuned.torque_limits)
    first = tuned.reference(0.0).p + tuned.initial_error
    theirs = simulate_many(plant, law, tuned.reference, duration=3.0, p=first, record_every=RECORD_INTERVAL)
    gains = tuned.gains
    setting = TrialSetting(gains.bandwidth, gains.damping, tuned.adaptation, arm.inertial_parameters)
    late = setting._replace(delayed=True)
    trials = Trials(plant, tuned.reference, tuned.initial_error)
    learns = kind == "learning"
    ours = trials.learn(model, [setting, late], 3.0) if learns else trials.run([setting, late], 3.0)
    np.testing.assert_allclose(ours.p[:, 0], theirs.p[:, 0], atol=1e-9)
    assert 1e-9 < np.abs(ours.p[:, 1] - theirs.p[:, 0]).max() < 0.05
    held = ours.applied[0, 1]
    np.testing.assert_array_equal(held, np.zeros(2))  # nothing is commanded before the first tick
    compiled = ClosedLoop._codes.cache_info().misses
    ClosedLoop(plant, law).compiled()
    assert ClosedLoop._codes.cache_info().misses == compiled + (not learns)  # a user's runs have the trials' code


@nightly
def test_a_search_is_no_worse_than_the_rule_where_it_judges(tuned: Tuning) -> None:
    searched = tune(PUMA, search=8)
    assert searched.is_learning
    assert searched.verified[3].final_rms_error < 1.2 * tuned.verified[3].final_rms_error
    again = tune(PUMA, search=8)
    # To round-off: equations are compiled once they are called often.
    np.testing.assert_allclose(again.gains.damping, searched.gains.damping, rtol=1e-9)
    np.testing.assert_allclose(again.adaptation, searched.adaptation, rtol=1e-9)


@nightly
@pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
def test_stiff_friction_is_integrated_not_refused() -> None:
    tuning = tune(load(urdf("xarm7.urdf")))
    assert tuning.integrator == LinearlyImplicitEuler()
    assert any("friction is too stiff" in note for note in tuning.notes)
    assert tuning.is_learning


def test_absurd_limits_are_none() -> None:
    """The iris has limits of 1e16 rad, where doubles are 2 rad apart."""
    with pytest.warns(SimplificationWarning, match="limits of zero"):
        tuning = tune(load(urdf("iris.urdf")))
    assert np.abs(tuning.reference(np.linspace(0.0, 20.0, 50)).p).max() < 2.0
    assert tuning.verified[0].final_rms_error < 1e-5


@nightly
def test_a_load_beyond_the_limits_is_told(tuned: Tuning) -> None:
    tight = np.where(np.arange(6) == 1, 8.0, tuned.torque_limits)
    upright = judged_reference(PUMA, tight, Sinusoids(np.zeros(6), np.full(6, 0.1), np.full(6, 0.2)))
    assert upright.static[1] > 1.0
    description = PUMA.description
    links = list(description.links)
    limits = replace(links[1].joint.limits, effort=8.0)
    links[1] = replace(links[1], joint=replace(links[1].joint, limits=limits))
    weak = Mechanism(replace(description, links=tuple(links)))
    tuning = tune(weak, reference=Sinusoids(np.zeros(6), np.full(6, 0.1), np.full(6, 0.2)))
    assert any(note.startswith("joint2: gravity and friction need ") for note in tuning.notes)
    assert not tuning.is_learning


def test_what_moves_nothing_is_named() -> None:
    chain = random_chain(3, 3)
    massless = chain.inertial_parameters.copy()
    massless[20:30] = 0.0
    last = chain.primary_joints[2].name
    with pytest.raises(InputError, match=rf"{last}: moves no inertia.*drive = {{ rotor_inertia"):
        tune(chain.with_parameters(massless))


def test_links_that_no_body_can_be_are_named() -> None:
    tree = random_tree(4, 3)
    wrong = tree.inertial_parameters.copy()
    wrong[10:20] *= -0.5
    with pytest.raises(InputError, match=r"physically consistent|moves no inertia"):
        tune(tree.with_parameters(wrong))


def test_numbers_may_be_numpys() -> None:
    two = load("two_link")
    plain, numpys = (
        tune(two, control_period=T, seed=k) for T, k in ((2.0**-10, 1), (np.float32(2.0**-10), np.int64(1)))
    )
    assert numpys.control_period == plain.control_period
    np.testing.assert_array_equal(numpys.gains.damping, plain.gains.damping)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"control_period": float("nan")}, r"control_period: expected a positive time in s \(1 ms is 0.001\)"),
        ({"control_period": 0.0}, r"control_period: expected a positive time in s \(1 ms is 0.001\)"),
        ({"control_period": -1.0}, r"control_period: expected a positive time in s \(1 ms is 0.001\)"),
        ({"bandwidth": 0.0}, "bandwidth: expected a number above 0"),
        ({"sampling_ratio": 2.0}, "sampling_ratio: expected a number above 0 and at most 1.5"),
        ({"adaptation_ratio": float("inf")}, "adaptation_ratio: expected a number above 0"),
        ({"search": -1}, "search: expected a whole number"),
        ({"initial_error": float("nan")}, "initial_error: expected"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        tune(PUMA, **settings)  # type: ignore[arg-type]


def test_the_command_tells_people_and_programs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "two_link"]) == 0
    assert "What limits the gains" in capsys.readouterr().out
    assert main(["tune", "two_link", "--json", "--search", "2"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["schema"] == "adaptctl/tuning/3"
    assert said["verified"][0]["name"] == "nominal"
    assert said["verified"][0]["is_learning"] is True
    assert main(["tune", "two_link", "--control-period", "nan"]) == 2
    assert "--control-period: expected" in capsys.readouterr().err


@nightly
def test_a_base_may_float(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    source = str(urdf("double_pendulum.urdf"))
    assert main(["basis", source, "--floating-base", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["dof"] == 8
    out = str(tmp_path / "out")
    assert (
        main(["experiment", "run", "adaptive", "--robot", source, "--floating-base", "--duration", "2", "--out", out])
        == 0
    )
