"""Parts of simulations: counts, limits and closed forms of a few numbers by hand."""

from __future__ import annotations

from collections import Counter
from importlib import import_module
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from every_law import ARM, PAIR, on, slotine_li

from adaptctl.arrays import MAX_DURATION, Array
from adaptctl.control import ReferencePoint, Sinusoids
from adaptctl.control.safety_filter import SafetyFilter
from adaptctl.dynamics import load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError, ReferenceWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation import HandPush, Plant, mujoco_plant, rollout, simulate
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, Episode
from adaptctl.simulation.effects import ControlDelay, Encoder, Friction, PayloadHeld
from adaptctl.simulation.members import Noise, _first_of, checked_seeds
from adaptctl.simulation.mujoco_plant import MuJoCoPlant
from adaptctl.simulation.references import Preview, ReferencesOfMany, SignalsAhead
from adaptctl.simulation.rollout import known_steps
from adaptctl.simulation.simulate_many import _is_in_joints, _members, _of_arms, simulate_many
from adaptctl.simulation.transmission import Motors, Transmission

TWO = load("two_link")
LAW = on(PAIR, None)


def ramp(t: Any) -> ReferencePoint:
    p = np.asarray(t)[:, None] * [1.0, 10.0]
    return ReferencePoint(p, 2.0 * p, 3.0 * p)


def test_a_preview_has_each_period_and_what_comes_after_it() -> None:
    preview = Preview(ramp, 2, 0.5, np.array([0.5, 2.0]), block=3)
    for k in (4, 0, 2, 3, 7):
        own = ramp([0.5 * k, 0.5 * k + 0.5, 0.5 * k + 2.0])
        wanted = np.concatenate((own.p[0], own.v[0], own.a[0], own.p[1], own.p[2]))
        np.testing.assert_allclose(preview.row(k), wanted)
        np.testing.assert_allclose(preview.rows(np.array([k, 1]))[0], wanted)
    with pytest.raises(InputError, match="reference: expected it to return ReferencePoint"):
        Preview(lambda t: t, 2, 0.5, np.zeros(0))  # type: ignore[arg-type, return-value]


def test_signals_are_computed_ahead_once_and_never_beyond_the_end() -> None:
    asked: list[Array] = []

    def watched(t: Any) -> ReferencePoint:
        asked.append(np.asarray(t))
        return ramp(t)

    ahead = SignalsAhead(ReferencesOfMany.of(watched, 2), 0.5, 9)
    for first, count in ((0, 2), (2, 3), (4, 5), (0, 1)):
        part = ahead.part(first, count)
        np.testing.assert_allclose(part["reference_p"][:, 0], 0.5 * np.arange(first, first + count))
    assert [len(times) for times in asked] == [9]
    assert ahead.part(8, 1)["reference_v"].tolist() == [[8.0, 80.0]]


def test_states_begin_unclipped_at_no_time() -> None:
    for plant in (Plant(TWO, 1e-3), MuJoCoPlant.of("two_link", 1e-3)):
        state = plant.init([0.1, 0.2], [0.3, 0.4])
        assert (state.time, state.clipped) == (0.0, False)
        assert not np.any(state.applied_torque)
        np.testing.assert_array_equal(
            [*state.p, *state.v, *state.measured_p, *state.measured_v], [0.1, 0.2, 0.3, 0.4] * 2
        )
        after = plant.step(state, plant.clip_torque([1e9, -1e9]))
        assert (after.time, after.clipped) == (1e-3, False)
        assert plant.step(state, [1e9, 0.0]).clipped is True


def test_what_prints_names_its_parts() -> None:
    assert type(Plant(TWO, np.float64(1e-3)).control_period) is float
    effects = [ControlDelay(1), Friction(1.0)]
    assert repr(Plant(TWO, 1e-3)) == "<Plant of 'two_link': period 0.001 s, effects: none>"
    assert "effects: ControlDelay, Friction>" in repr(plant := Plant(TWO, 1e-3, effects=iter(effects)))
    assert plant.effects == tuple(effects)
    assert repr(ClosedLoop(Plant(ARM, 1e-3), slotine_li())).endswith("and SlotineLi>")
    episode: Any = (Plant(TWO, 1e-3), None, None, None, None, 7, None)
    assert repr(Episode(*episode)) == "<Episode of 'two_link': 7 control periods>"


def test_progress_is_told_a_hundred_times_or_so_and_ends_at_one() -> None:
    env, law = TrackingEnv(PAIR.mechanism, Sinusoids(*np.full((3, 2), 0.1)), duration=0.25), LAW
    told: list[float] = []
    rollout(env, law, seed=0, progress=told.append)
    np.testing.assert_allclose(told, 0.008 * np.arange(1, 126))
    told.clear()
    simulate(env, law, seed=0, progress=told.append)
    assert told[-1] == 1.0
    assert all(0.0 < a < b for a, b in pairwise(told))


@pytest.mark.parametrize(
    ("steps", "most", "known"), [(5, 3, 3), (3, 5, 3), (0, 5, 5), (None, 1, 1), (7.0, None, None), (1, None, 1)]
)
def test_an_episode_has_the_fewest_steps_that_are_told(steps: Any, most: Any, known: int | None) -> None:
    env: Any = SimpleNamespace(unwrapped=SimpleNamespace(steps=steps), spec=SimpleNamespace(max_episode_steps=most))
    assert known_steps(env) == known


def test_springs_swing_and_fade_with_both_inertias() -> None:
    """Two joints that do not act on each other: the fastest counts."""
    arm = SimpleNamespace(
        inertial_parameters=np.zeros(0),
        with_parameters=lambda _: SimpleNamespace(mass_matrix=lambda p: np.tile(np.diag([2.0, 4.0]), (3, 1, 1))),
    )
    made: Any = Transmission(np.array([50.0, 60.0]), np.array([7.0, 5.0]), np.array([0.5, 1.0]), (None, None), (0, 1))
    waves, decay = made.rates(arm, np.zeros((3, 2)))
    assert waves == pytest.approx(np.sqrt(50.0 * (1.0 / 2.0 + 1.0 / 0.5)))
    assert decay == pytest.approx(7.0 * (1.0 / 2.0 + 1.0 / 0.5))
    heavy = np.tile(np.diag([1e-13, 1.0]), (3, 1, 1))
    arm.with_parameters = lambda _: SimpleNamespace(mass_matrix=lambda p: heavy)
    arm.name = "thin"
    with pytest.raises(InputError, match="thin: without rotors the mass matrix is singular"):
        made.rates(arm, np.zeros((3, 2)))


def test_a_push_lasts_and_rises_within_its_limits() -> None:
    def push(**given: float) -> HandPush:
        return HandPush(np.ones(3), **{"start": 0.0, "duration": 2.0, **given})

    assert push(rise=1.0).at(1.0)[0] == 1.0
    assert push(start=MAX_DURATION).at(MAX_DURATION)[0] == 1.0
    for given in (
        {"rise": 1.001},
        {"rise": -1e-9},
        {"start": -1e-9},
        {"start": 1.001 * MAX_DURATION},
        {"duration": 0.0},
    ):
        with pytest.raises(InputError, match="push: "):
            push(**given)


def test_a_contact_is_told_with_its_times_and_others(monkeypatch: pytest.MonkeyPatch) -> None:
    plant: Any = SimpleNamespace(mechanism=SimpleNamespace(name="arm"))
    reference = Sinusoids([0.0], [1.0], [1.0])
    others = {("a", "c"): 2, ("b", "c"): 1}
    for more, told in (({}, "3 of 201 times, but"), (others, "3 of 201 times, and 2 more pairs of bodies")):
        monkeypatch.setattr(mujoco_plant, "contacts_along", lambda *_, more=more: Counter({("a", "b"): 3, **more}))
        with pytest.warns(ReferenceWarning, match=f"'a' and 'b' are in contact at {told}"):
            mujoco_plant.warn_of_contacts(plant, reference)


@pytest.mark.parametrize(
    ("free", "shrunk"), [(0.99, 1), (0.81, 1), (0.79, 2), (0.8**19 * 1.001, 19), (0.8**19 * 0.999, 0)]
)
def test_motions_shrink_by_a_fifth_until_they_are_free(
    free: float, shrunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = MuJoCoPlant.of("two_link", 1e-3)
    drawn = Sinusoids([0.5, 0.5], [[1.0, 1.0]], [[1.0, 1.0]], [[0.3, 0.4]], start_time=3.0)
    monkeypatch.setattr(
        mujoco_plant, "contacts_along", lambda _, one: Counter(ab=int(one.amplitude[0, 0] > free)) - Counter()
    )
    if not shrunk:
        with pytest.raises(InputError, match="no contact-free motion"):
            mujoco_plant.clear_of_contacts(plant, drawn)
        return
    clear = mujoco_plant.clear_of_contacts(plant, drawn)
    np.testing.assert_allclose([*clear.amplitude[0], *clear.center], 0.8**shrunk * np.array([1.0, 1.0, 0.5, 0.5]))
    assert (clear.phase.tolist(), clear.start_time) == ([[0.3, 0.4]], 3.0)


def test_arms_are_counted_by_what_has_a_row_for_each() -> None:
    assert _members(None, {"p": (), "v": ()}) == 1
    assert _members(3, {"p": (3,), "v": ()}) == 3
    assert _members(None, {"p": (2,), "v": ()}) == 2
    for given, rows in ((3, {"p": (2,)}), (None, {"p": (2,), "v": (3,)}), (None, {"p": (2, 3)})):
        with pytest.raises(InputError, match="one row per arm in all arguments, got "):
            _members(given, rows)


class Memory(NamedTuple):
    """Of each arm, and of all."""

    each: Array
    shared: Array


def test_a_memory_is_that_of_the_controller_for_one_arm_or_each() -> None:
    loop, reference = {"plant": Plant(PAIR.mechanism, 1e-3), "duration": 1e-3}, Sinusoids(*np.full((3, 2), 0.1))
    for memory in (np.zeros(3), (np.zeros(3),)):
        with pytest.raises(InputError, match="memory: expected the result of SlotineLi"):
            simulate_many(controller=LAW, reference=reference, memory=memory, **loop)  # type: ignore[arg-type]
    each = Memory(np.arange(6.0).reshape(3, 2), np.array([7.0, 8.0]))
    rows, shared = _of_arms(each, slice(1, 3))
    assert (rows.tolist(), shared.tolist()) == ([[2.0, 3.0], [4.0, 5.0]], [7.0, 8.0])
    assert _of_arms(None, slice(1)) is None


def test_noise_is_of_batches_or_of_seeds_of_arms() -> None:
    batches = Noise.of(5, 5, 2, 3)
    assert [noise.members for noise in batches] == [2, 2, 1]
    assert [noise.drawn(4).shape for noise in batches] == [(4, 2, 3), (4, 2, 3), (4, 1, 3)]
    seeds = checked_seeds([4, 9, 2])
    own = Noise.of(seeds, 3, 2, 3)
    drawn = np.concatenate([noise.drawn(2) for noise in own], axis=1)
    for k, seed in enumerate((4, 9, 2)):
        np.testing.assert_array_equal(drawn[:, k], np.random.default_rng(seed).standard_normal((2, 3)))
    assert checked_seeds(3) == 3
    with pytest.raises(InputError, match="seed"):
        checked_seeds([3, -1])


def test_laws_of_many_arms_differ_in_numbers_alone() -> None:
    assert _first_of([LAW, LAW]) is LAW
    with pytest.raises(InputError, match="number 1 differs otherwise"):
        _first_of([LAW, slotine_li()])
    for wrong in ([], [LAW, 3], 5):
        with pytest.raises(InputError, match="expected a Controller or a sequence"):
            _first_of(wrong)


def test_what_is_filtered_has_a_reference_of_its_own_kind() -> None:
    inner = SimpleNamespace(reference_in_joints=False)
    filtered = SafetyFilter.__new__(SafetyFilter)
    object.__setattr__(filtered, "inner", inner)
    assert [_is_in_joints(one) for one in (filtered, inner, LAW)] == [False, False, True]  # type: ignore[arg-type]


def test_chunks_of_a_run_end_where_a_payload_comes_or_goes() -> None:
    plant = Plant(TWO, 0.1, effects=[PayloadHeld(1.0, 0.35, 0.8)])
    run: Any = SimpleNamespace(loop=SimpleNamespace(plant=plant), control_period=0.1, steps=12, count=0)
    lengths = []
    while run.count < run.steps:
        times = Driven.ahead(run, 5)
        lengths.append(len(times))
        assert times[0] == pytest.approx(0.1 * run.count)
        run.count += len(times)
    assert lengths == [4, 4, 4]
    assert [plant.payload_mass(time) for time in (0.3, 0.35, 0.79, 0.8)] == [0.0, 1.0, 1.0, 0.0]


def test_the_energy_of_springs_is_theirs_and_that_of_their_motors() -> None:
    springs = Transmission(np.array([3.0]), np.zeros(1), np.array([5.0]), (None,), (0,))
    theta, w, inertia = ([0.4], [2.0], [5.0])
    motors = Motors(Column(theta), Column(w), Column(inertia))
    assert springs.energy(Column([0.1]), motors) == pytest.approx(0.5 * 5.0 * 2.0**2 + 0.5 * 3.0 * 0.3**2)


@pytest.mark.parametrize("given", [{"record_every": 0}, {"threads": 0}, {"threads": 1.0}, {"batch_size": 0}])
def test_periods_between_samples_threads_and_arms_are_whole_numbers(given: dict[str, Any]) -> None:
    reference = Sinusoids(*np.full((3, 2), 0.1))
    with pytest.raises(InputError, match=f"{next(iter(given))}: expected a whole number"):
        simulate_many(Plant(PAIR.mechanism, 1e-3), LAW, reference, duration=0.01, **given)


class Interrupted(TrackingEnv):
    """Ctrl-C is pressed while the second part of a run is judged."""

    def episode(self, **given: Any) -> Episode:
        whole, begun = super().episode(**given), list[int]()

        def judge(*samples: Any) -> Any:
            begun.append(1)
            if len(begun) > 1:
                raise KeyboardInterrupt
            return whole.judge(*samples)

        return whole._replace(judge=judge)


def test_an_interrupted_run_ends_where_its_last_whole_part_did() -> None:
    slow = Sinusoids(*np.full((3, 2), 0.1))
    run, to_there = (
        simulate(kind(PAIR.mechanism, slow, duration=duration, effects=[Encoder(noise=1e-9)]), LAW, seed=0)
        for kind, duration in ((Interrupted, 2.5), (TrackingEnv, 2.0))
    )
    assert (run.interrupted, len(run.time), run.info["time"]) == (True, 2000, pytest.approx(2.0))
    for name in ("p", "v"):
        np.testing.assert_array_equal(run.info[name], to_there.info[name])  # type: ignore[arg-type]


def test_runs_of_many_arms_tell_of_references_beyond_limits() -> None:
    law, far = on(ReducedModel.full(TWO), None), Sinusoids([3.1, 0.0], [0.1, 0.1], [0.1, 0.1])
    with pytest.warns(ReferenceWarning, match="reference: shoulder goes to 3.2 rad, beyond -2.967 to 2.967"):
        simulate_many(Plant(TWO, 1e-3), law, far, duration=5.0, record_every=None)


def test_a_scene_begins_anew_with_its_clock() -> None:
    plant = MuJoCoPlant.of("two_link", 1e-3)
    state = plant.init(np.zeros(2), np.zeros(2))
    first = plant.step(plant.step(state, [5.0, 1.0]), [5.0, 1.0])
    again = plant.init(np.zeros(2), np.zeros(2))
    np.testing.assert_array_equal(again.drives, state.drives)
    assert plant._scene._data.time == 0.0
    np.testing.assert_array_equal(plant.step(plant.step(again, [5.0, 1.0]), [5.0, 1.0]).p, first.p)


def test_a_law_is_compiled_by_a_step_before_the_clock_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    called, law = list[str](), on(PAIR, None)
    step = type(law).step
    monkeypatch.setattr(type(law), "step", lambda *given: called.append("step") or step(*given))
    module = import_module("adaptctl.simulation.rollout")
    monkeypatch.setattr(module, "perf_counter", lambda: called.append("clock") or 1.0)
    rollout(TrackingEnv(PAIR.mechanism, Sinusoids(*np.full((3, 2), 0.1)), duration=0.003), law, seed=0)
    assert called == ["step", "clock", "step", "step", "step", "clock"]
