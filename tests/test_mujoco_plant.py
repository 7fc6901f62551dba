"""MuJoCo as the plant: its steps and clock, pushes, and contacts along a reference."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import MAX_DURATION
from adaptctl.control import Sinusoids
from adaptctl.dynamics import load
from adaptctl.errors import InputError, ReferenceWarning
from adaptctl.simulation import HandPush, mujoco_plant
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, contacts_along


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


def test_a_scene_begins_anew_with_its_clock() -> None:
    plant = MuJoCoPlant.of("two_link", 1e-3)
    state = plant.init(np.zeros(2), np.zeros(2))
    first = plant.step(plant.step(state, [5.0, 1.0]), [5.0, 1.0])
    again = plant.init(np.zeros(2), np.zeros(2))
    np.testing.assert_array_equal(again.drives, state.drives)
    assert plant._scene._data.time == 0.0
    np.testing.assert_array_equal(plant.step(plant.step(again, [5.0, 1.0]), [5.0, 1.0]).p, first.p)


def test_contacts_are_looked_for_over_twenty_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_plant, "contacts_at", lambda plant, positions: positions)
    reference: Any = lambda t: SimpleNamespace(p=t)  # noqa: E731
    found: Any = contacts_along(SimpleNamespace(), reference)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, 0.1 * np.arange(201))


@pytest.mark.parametrize(("periods", "steps"), [(1.0, 1), (3.0, 3), (2.5, 3), (0.5, 1)])
def test_a_control_period_is_whole_steps_of_mujoco(periods: float, steps: int) -> None:
    model = load("two_link").to_mujoco()
    plant = MuJoCoPlant.of(model, periods * model.opt.timestep)
    assert plant._scene._substeps == steps
    assert plant._scene._model.opt.timestep == pytest.approx(periods * model.opt.timestep / steps)
