"""Parts of simulations: counts, limits and closed forms of a few numbers by hand."""

from __future__ import annotations

from importlib import import_module
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import ARM, PAIR, on, slotine_li

from adaptctl.arrays import Array
from adaptctl.control import ReferencePoint, Sinusoids
from adaptctl.dynamics import load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation import Plant, rollout, simulate
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, Episode
from adaptctl.simulation.effects import ControlDelay, Encoder, Friction, PayloadHeld
from adaptctl.simulation.mujoco_plant import MuJoCoPlant
from adaptctl.simulation.references import Preview, ReferencesOfMany, SignalsAhead
from adaptctl.simulation.rollout import known_steps
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


def test_a_law_is_compiled_by_a_step_before_the_clock_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    called, law = list[str](), on(PAIR, None)
    step = type(law).step
    monkeypatch.setattr(type(law), "step", lambda *given: called.append("step") or step(*given))
    module = import_module("adaptctl.simulation.rollout")
    monkeypatch.setattr(module, "perf_counter", lambda: called.append("clock") or 1.0)
    rollout(TrackingEnv(PAIR.mechanism, Sinusoids(*np.full((3, 2), 0.1)), duration=0.003), law, seed=0)
    assert called == ["step", "clock", "step", "step", "step", "clock"]
