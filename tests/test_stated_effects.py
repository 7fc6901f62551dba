"""Gains for the effects that a robot is known to have."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from two_links import ARM, changed

import adaptctl
from adaptctl.errors import InputError, TuningWarning, VerdictError
from adaptctl.simulation import simulate_many
from adaptctl.simulation.effects import ControlDelay, ElasticJoints, Encoder, FilteredDifferences
from adaptctl.simulation.effects.effect import Effect
from adaptctl.tuning import Tuning, stated_effects, tune, verification, with_friction
from adaptctl.tuning.default_gains import DefaultGains, Proposal
from adaptctl.tuning.stated_effects import HALVINGS, SPRING_DAMPING, Rates, held, late_share, plant_with, remedy
from adaptctl.tuning.verification import (
    LINK_ERROR,
    OTHER_STARTS,
    Trials,
    TrialSetting,
    Verification,
    _spread,
    base_model,
    holds,
    other_arms,
    scaled,
    verifications,
)
from benchmarks.stability import random_arm

ASKED = Rates(4.0, 0.5, 0.4)
CASES = 4
COUNTS = (Encoder(resolution=2.0 * np.pi / 4096.0), FilteredDifferences(60.0))


def run(first: float, last: float, largest: float = 0.1) -> Verification:
    return Verification("nominal", first, last, np.inf, largest, 0.0)


GOOD, BAD = run(0.04, 0.01), run(0.04, 0.02)


def test_lower_ratios_take_bandwidth_that_they_damp() -> None:
    assert ASKED.lowered(1.0, 0.1) == ASKED
    assert ASKED.lowered(0.5, 1e-3) == (4.0, 0.25, 0.2)
    assert ASKED.lowered(0.5, 0.025) == (2.5, 0.25, 0.2)


def test_a_run_holds_if_it_ends_below_a_third_of_its_first_error() -> None:
    assert holds(GOOD)
    assert not holds(BAD)
    assert not holds(run(0.04, 0.01, 1.5))


def test_from_two_periods_late_on_the_margin_is_that_at_one() -> None:
    assert (late_share(0), late_share(1), late_share(2)) == pytest.approx((1.0, 1.0, 2.0 * np.sin(np.pi / 10.0)))


def chosen(
    monkeypatch: pytest.MonkeyPatch,
    outcomes: list[tuple[Verification, ...]],
    delay: int = 0,
    effects: Any = COUNTS,
    columns: int = 10,
) -> Any:
    """What is held where runs of lower and lower gains end so, the last of them again and again."""
    left = iter(outcomes)

    def runs(*_: Any, duration: float = 20.0) -> tuple[Verification, ...]:
        return (GOOD,) if duration < 20.0 else next(left, outcomes[-1])

    monkeypatch.setattr(stated_effects, "verifications", runs)
    proposed = SimpleNamespace(proposed=lambda *rates: offered(rates[1]), control_period=1e-3)
    trials: Any = SimpleNamespace(plant=SimpleNamespace(effects=effects), delay=delay)
    model: Any = SimpleNamespace(columns=range(columns))
    found = held(trials, model, proposed, ASKED, offered(0.5), 0)  # type: ignore[arg-type]
    return found.proposal.gain, " ".join(found.notes)


def offered(hold: float) -> Any:
    return SimpleNamespace(gain=hold, feasible=SimpleNamespace(gains=None))


def test_the_highest_gains_are_taken_that_hold_in_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert chosen(monkeypatch, [(GOOD,) * CASES]) == (0.5, "")
    gain, told = chosen(monkeypatch, [(GOOD, BAD, GOOD, GOOD), (BAD,) * CASES, (GOOD,) * CASES])
    assert gain == 0.125
    assert "bandwidth of 4 1/s, a sampling ratio of 0.12" in told


def test_gains_that_hold_in_the_nominal_run_alone_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    gain, told = chosen(monkeypatch, [(BAD,) * CASES, (GOOD, BAD, BAD, BAD)])
    assert gain == 0.25
    assert "four" in told


def test_a_stated_delay_needs_to_hold_no_further_one(monkeypatch: pytest.MonkeyPatch) -> None:
    later = replace(BAD, name="both")
    assert chosen(monkeypatch, [(GOOD, later)], delay=1)[0] == 0.5
    assert chosen(monkeypatch, [(GOOD, later), (GOOD, GOOD)])[0] == 0.25


def test_without_stated_effects_only_gains_that_lose_the_arm_are_lowered(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = run(0.04, 0.01, 1.5)
    assert chosen(monkeypatch, [(BAD, lost, lost, lost)], effects=())[0] == 0.5
    gain, told = chosen(monkeypatch, [(lost, lost), (lost, lost), (GOOD, lost)], effects=())
    assert (gain, "0.12" in told) == (0.125, True)


def test_where_no_gains_hold_the_first_are_kept_and_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    gain, told = chosen(monkeypatch, [(BAD,) * CASES])
    assert gain == 0.5
    assert "no lower gains" in told


def test_where_no_gains_hold_half_the_bandwidth_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    gain, told = chosen(monkeypatch, [(BAD,) * CASES] * (1 + HALVINGS) + [(GOOD,) * CASES])
    assert gain == 0.5
    assert "bandwidth of 2 1/s" in told
    for tried, words in ((2 * HALVINGS + 2, "bandwidth of 1 1/s"), (3 * HALVINGS + 3, "no lower gains hold")):
        assert words in chosen(monkeypatch, [(BAD,) * CASES] * tried + [(GOOD,) * CASES])[1]


@pytest.mark.parametrize(("columns", "lowered"), [(100, True), (101, False)])
def test_gains_of_more_parameters_than_are_learned_are_lowered_for_stated_effects_alone(
    monkeypatch: pytest.MonkeyPatch, columns: int, lowered: bool
) -> None:
    lost = run(0.04, 0.01, 1.5)
    for effects, found in (((), lowered), (COUNTS, True)):
        gain, _ = chosen(monkeypatch, [(lost,), (GOOD,)], effects=effects, columns=columns)
        assert gain == (0.25 if found else 0.5)


def test_runs_that_do_not_forget_their_starts_do_not_hold() -> None:
    swinging = replace(run(0.04, 0.001), spread=5e-4)
    assert not holds(swinging)
    assert str(swinging) == "nominal: failed, springs swing by 0.5 mrad in the end"
    assert holds(replace(swinging, spread=3e-4))


def test_lighter_links_behind_strong_dampers_are_integrated_stably() -> None:
    rule = DefaultGains.for_mechanism(ARM)
    trials = Trials(
        plant_with(ARM, 1e-3, rule.limits, [ElasticJoints(200.0, 160.0, 0.02)]), rule.reference, rule.initial_error
    )
    gains = rule.carried(2.0, 0.1).gains
    light = scaled(ARM, np.full(len(ARM.links), 1.0 - LINK_ERROR))
    setting = TrialSetting(gains.bandwidth, gains.damping, rule.proposed(*ASKED, "mixed").gain, light)
    assert trials.without(base_model(ARM), [setting], 1.0).largest_error.max() < 1.0


@pytest.mark.parametrize(("look", "runs"), [(2.0, 1), (6.0, 0)])
def test_springs_are_tried_from_other_starts_at_last(monkeypatch: pytest.MonkeyPatch, look: float, runs: int) -> None:
    asked: list[Any] = []

    def spread(*given: Any) -> float:
        asked.append(given)
        return 0.0

    monkeypatch.setattr(verification, "_spread", spread)
    monkeypatch.setattr(verification, "FIRST_LOOK", look)
    rule = DefaultGains.for_mechanism(ARM)
    plant = plant_with(ARM, 1e-3, rule.limits, [ElasticJoints(2000.0, 5.0, 0.02)])
    first = rule.proposed(4.0, 0.05, 0.05, "mixed")
    trials = Trials(plant, rule.reference, rule.initial_error, nominal_only=True)
    found = verifications(trials, base_model(ARM), first.feasible.gains, first.gain, 0, 6.0)
    assert holds(found[0])
    assert len(asked) == runs


def test_only_encoders_behind_springs_are_told_of_their_damping() -> None:
    rule = DefaultGains.for_mechanism(ARM)
    gains = rule.carried().gains

    def told(*effects: Effect) -> str:
        plant = plant_with(ARM, 1e-3, rule.limits, effects)
        return remedy(Trials(plant, rule.reference, rule.initial_error), gains)

    alone = told(ElasticJoints(1e4, motor_inertia=0.02))
    assert "damping=" in alone
    assert f"down to {gains.bandwidth.max() / 4:.2g} 1/s fail" in alone
    M = ARM.mass_matrix(rule.reference(0.0).p)
    needed = 0.3 * (gains.damping + np.diagonal(M) * gains.bandwidth)
    assert f"need {needed[0]:.2g} at shoulder" in alone
    assert needed[0] > needed[1]
    assert told(ElasticJoints(1e4, motor_inertia=0.02, encoders="motor")) == told(*COUNTS) == told()


@pytest.mark.parametrize("link", [0.003, 0.03, 0.3])
def test_springs_of_the_damping_that_is_named_do_not_swing_one_joint_up(link: float) -> None:
    """By the poles of a motor and a link, with torque -K (v + bandwidth p) of the link."""
    k, motor, K, bandwidth = 5e3, 0.03, 0.4, 2.0

    def growth(share: float) -> float:
        d = share * K
        poles = [
            motor * link,
            (motor + link) * d,
            (motor + link) * k + K * d,
            K * (k + bandwidth * d),
            K * bandwidth * k,
        ]
        return float(np.roots(poles).real.max())

    assert growth(SPRING_DAMPING) < 0.0
    assert (growth(0.2) > 0.0) == (link == motor)


def test_a_stated_delay_is_told_to_the_law_and_lowers_gains() -> None:
    late = tune(ARM, effects=[ControlDelay(2)])
    law: Any = late.controller(base_model(ARM)).adaptation
    assert (late.delay, law.delay) == (2, 2)
    assert late.sampling_ratio == pytest.approx(0.5 * late_share(2), rel=0.05)


def test_what_is_no_effect_is_refused() -> None:
    with pytest.raises(InputError, match="effects"):
        tune(ARM, effects="late")
    with pytest.raises(InputError, match="effects"):
        tune(ARM, effects=[2])  # type: ignore[list-item]


def so101() -> Any:
    from adaptctl.contest.scene import loaded

    return with_friction(loaded("{example-robot-data}/so_arm_description/urdf/so101.urdf"))


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
def test_a_gradient_that_coarse_encoders_make_diverge_is_refused() -> None:
    mechanism = so101()
    tuning = tune(mechanism, effects=COUNTS)
    assert tuning.is_learning
    with pytest.raises(VerdictError, match="gradient"):
        tuning.controller(base_model(mechanism), "gradient")
    assert tuning.controller(base_model(mechanism), "gradient", anyway=True).adaptation is not None


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.TuningWarning")
def test_a_delay_that_no_gains_hold_is_refused() -> None:
    with pytest.raises(VerdictError, match="fail"):
        adaptctl.adaptive_controller(so101(), delay=16)


def behind(encoders: str, damping: float = 0.0) -> Tuning:
    """Tuning of the two-link arm with soft springs."""
    return tune(ARM, effects=[ElasticJoints(200.0, damping, 0.02, encoders)])


@pytest.mark.nightly
def test_springs_that_do_not_damp_are_refused_with_what_holds() -> None:
    with pytest.raises(VerdictError, match=r"damping=.*encoders='motor'") as told:
        behind("link").controller(base_model(ARM))
    needed = float(str(told.value).split("need ")[1].split(" ")[0])
    assert behind("link", needed).is_learning
    soft = behind("motor")
    assert soft.is_learning
    assert soft.verified[0].spread == 0.0  # not asked for, as motors are measured
    assert np.all(soft.gains.damping < 0.6 * tune(ARM).gains.damping)


@pytest.mark.nightly
def test_gains_with_damped_springs_hold_from_any_start() -> None:
    tuning, starts = behind("link", 0.1), 64
    assert 0.0 < tuning.verified[0].spread < 1e-4
    plant = plant_with(ARM, 1e-3, tuning.torque_limits, tuning.effects)
    start = np.random.default_rng(9).uniform(-1.0, 1.0, (starts, 2)) * tuning.initial_error + tuning.reference(0.0).p
    law = tuning.controller(base_model(ARM))
    run = simulate_many(plant, law, tuning.reference, duration=20.0, batch_size=starts, p=start, record_every=10)
    error = np.abs(run.p - tuning.reference(run.time).p[:, None])
    assert error.max() < 1.0
    assert error[run.time > 18.0].max() < 1e-3


def test_the_tuning_s_notes_are_warnings_of_the_controller() -> None:
    arm = changed(lambda joint: joint, source="URDF file arm.urdf")
    with pytest.warns(TuningWarning, match="two_link: shoulder, elbow: URDF has no rotor inertias"):
        adaptctl.adaptive_controller(arm, control_period=4e-3)


def begun(seed: int) -> tuple[Trials, Proposal, TrialSetting]:
    """Trials of a random arm whose hand is light, and the gains that its tuning begins with."""
    arm = with_friction(random_arm(np.random.default_rng(seed), 3, lighter=0.3))
    rule = DefaultGains.for_mechanism(arm, control_period=0.004)
    trials = Trials(plant_with(arm, 0.004, rule.limits, ()), rule.reference, rule.initial_error, True)
    first = rule.proposed(4.0, 0.5, 0.5, "mixed")
    gains = first.feasible.gains
    return trials, first, TrialSetting(gains.bandwidth, gains.damping, first.gain, arm.inertial_parameters)


@pytest.mark.parametrize("seed", [7, 30])
def test_gains_are_lowered_where_another_start_loses_the_arm(seed: int) -> None:
    """Which the one that is verified does not."""
    trials, first, setting = begun(seed)
    arm = trials.plant.mechanism
    found = tune(arm, control_period=0.004, nominal_only=True)
    assert "lowered to these" in found.notes[-1]
    assert found.is_learning
    assert verifications(trials, base_model(arm), first.feasible.gains, first.gain, 0)[0].max_error > 1.0
    assert trials.learn(base_model(arm), [setting], 2.0).largest_error.max() < 0.5


def test_other_starts_are_of_other_arms() -> None:
    """The arm itself is lost from none of them, but with links that are 30 % off; some have a heavier last link."""
    trials, _, setting = begun(30)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (OTHER_STARTS, 3))
    own = trials.learn(base_model(trials.plant.mechanism), [setting] * OTHER_STARTS, 0.5, signs * trials.off)
    assert own.largest_error.max() < 1.0
    masses = {round(arm[20] / setting.parameters[20], 9) for arm in other_arms(trials.plant.mechanism, 0)}
    assert masses == {0.7, 1.0, 1.3, 2.0}


def test_runs_spread_as_far_as_one_is_from_their_mean_in_the_end() -> None:
    time, apart = 0.05 * np.arange(100.0), np.linspace(-0.3, 0.4, 8)
    error = np.random.default_rng(0).normal(size=(100, 8, 2))
    error[time >= time[-1] - 2.0] = 0.7 + np.stack((apart, 2.0 * apart), axis=-1)

    def learn(model: Any, settings: list[Any], duration: float, off: np.ndarray) -> Any:
        assert (model, settings, duration) == ("model", ["setting"] * 8, 20.0)
        np.testing.assert_array_equal(np.abs(off), np.broadcast_to([0.1, 0.2], (8, 2)))
        assert {-1.0, 1.0} == set(np.sign(off).ravel())
        return SimpleNamespace(time=time, error=error)

    trials: Any = SimpleNamespace(plant=SimpleNamespace(dof=2), off=np.array([0.1, 0.2]), learn=learn)
    farthest = 0.4 - apart.mean()
    assert _spread(trials, "model", "setting", 0, 20.0) == pytest.approx(farthest * np.sqrt(2.5))  # type: ignore[arg-type]
    error[-1, 3, 1] = np.nan
    assert _spread(trials, "model", "setting", 0, 20.0) == np.inf  # type: ignore[arg-type]
