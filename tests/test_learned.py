"""What was learned, saved and taken up again: information too, under other gains, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sampled_loops import arm, gains, loop, own_gain, reduced, swinging

from adaptctl import SlotineLi
from adaptctl.control import Gradient, GuardedLearning, save_learned, warm_start
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import InputError
from adaptctl.identification import learned_payload, told

ARM = "puma560_arm3"
TRUE = reduced(ARM).fundamental_parameters


def learner(share: float = 1.0) -> SlotineLi:
    weight = 1.0 / (3.3e-3 * gains(ARM).damping) ** 2
    law = GuardedLearning(share * own_gain(ARM), weight, min_speed=0.0)
    return SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, law, torque_limits=np.inf)


@pytest.fixture(scope="module")
def learned() -> tuple[SlotineLi, Any]:
    controller = learner()
    return controller, loop(controller, arm(ARM), swinging(arm(ARM)), 2.0).states[-1]


def started(controller: SlotineLi, path: Path, **options: Any) -> Any:
    reference = swinging(arm(ARM))(np.zeros(1))
    return warm_start(path, controller, controller.init(reference.p[0], reference.v[0]), **options)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_estimate_and_covariance_go_on_where_they_were(learned: Any, share: float, tmp_path: Path) -> None:
    """Of another gain, P^-1 differs by that of the gains alone."""
    controller, state = learned
    save_learned(tmp_path / "learned.json", controller, state)
    again = learner(share)
    warm: Any = started(again, tmp_path / "learned.json")
    np.testing.assert_array_equal(warm.estimate, state.estimate)
    law: Any = again.adaptation_law
    first: Any = controller.adaptation_law
    information = [
        np.linalg.inv(one.covariance(two.law_state)) - np.diag(1.0 / one.gain)
        for one, two in ((first, state), (law, warm))
    ]
    scale = np.sqrt(np.outer(first.gain, first.gain))
    np.testing.assert_allclose(information[1] * scale, information[0] * scale, rtol=1e-6, atol=1e-6)


def test_a_change_by_a_body_at_the_last_link_is_that_body(learned: Any) -> None:
    controller, state = learned
    tens = 10 * len(controller.model.mechanism.description.body_names)
    body = from_center_of_mass(1.5, [0.1, 0.0, 0.2], 0.01 * np.eye(3))
    change = np.asarray(controller.model.regrouping)[:, tens - 10 : tens] @ body
    found = learned_payload(controller, state._replace(estimate=controller.initial + change))
    assert found is not None
    np.testing.assert_allclose(found.ten[:4], body[:4], rtol=0.01, atol=2e-3)


@pytest.mark.parametrize(
    ("heavy", "off", "expected"),
    [
        (3.0, (0.99, 0.029, 0.0089), [True, True, True]),
        (3.0, (1.01, 0.001, 0.0001), [False, False, False]),
        (3.0, (0.5, 0.031, 0.0091), [True, False, False]),
        (0.2, (0.099, 0.029, 0.0007), [True, True, False]),
        (0.2, (0.101, 0.001, 0.0001), [False, False, False]),
    ],
)
def test_mass_centre_and_inertia_are_told_that_are_within_a_share_of_the_mass(
    heavy: float, off: tuple[float, float, float], expected: list[bool]
) -> None:
    payload: Any = SimpleNamespace(mass=heavy, deviations=np.repeat(off, [1, 3, 6]) / 1.96)
    assert told(payload).tolist() == expected


def test_it_errs_less_from_the_first_second(learned: Any, tmp_path: Path) -> None:
    controller, state = learned
    save_learned(tmp_path / "learned.json", controller, state)
    warm = started(controller, tmp_path / "learned.json")
    moved = {}
    for name, first in (("cold", None), ("warm", warm.estimate)):
        run = loop(replace(controller, initial=first), arm(ARM), swinging(arm(ARM)), 1.0, off=0.0)
        moved[name] = np.sqrt(np.mean((run.p - swinging(arm(ARM))(run.time).p) ** 2))
    assert moved["warm"] < 0.1 * moved["cold"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"geometry_sha256": "0"}, "whose geometry is another"),
        ({"parameters": [*reduced(ARM).names, "x"]}, r"was learned with other parameters \(x\)"),
        ({"sha256": "0"}, "the numbers were changed"),
        ({"saved_at": 1e9}, "the numbers were changed"),
    ],
)
def test_what_does_not_fit_is_refused(learned: Any, changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    controller, state = learned
    save_learned(path := tmp_path / "learned.json", controller, state)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(InputError, match=said):
        started(controller, path, max_age=60.0)


@pytest.mark.parametrize(
    ("hours", "age", "said"),
    [
        (5.0, 60.0, "18000 s ago, and max_age is 60 s"),
        (5.0, np.nan, "max_age is nan s"),
        (-5.0, 60.0, "ahead of this machine"),
    ],
)
def test_clocks_that_jump_by_hours_are_noticed(
    learned: Any, hours: float, age: float, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, state = learned
    monkeypatch.setattr("time.time", lambda: 1e9)
    save_learned(path := tmp_path / "learned.json", controller, state)
    monkeypatch.setattr("time.time", lambda: 1e9 + 3600.0 * hours)
    with pytest.raises(InputError, match=said):
        started(controller, path, max_age=age)


def test_another_law_and_states_of_others_are_refused(learned: Any, tmp_path: Path) -> None:
    controller, state = learned
    gradient = replace(controller, adaptation=Gradient(own_gain(ARM)))
    with pytest.raises(InputError, match="expected GuardedLearning"):
        save_learned(tmp_path / "x.json", gradient, state)
    for other in (np.zeros((2, len(TRUE))), np.zeros(len(TRUE) - 1)):
        with pytest.raises(InputError, match="one arm"):
            save_learned(tmp_path / "x.json", controller, state._replace(estimate=other))


def test_nothing_is_stored_after_a_period_off_time() -> None:
    """For two time constants of the filters; then data count again."""
    controller, reference = learner(), swinging(arm(ARM))
    states = loop(controller, arm(ARM), reference, 1.0).states
    law: Any = controller.adaptation_law
    state: Any = states[-1]
    skipped = state._replace(law_state=law.skip_period(state.law_state))
    point, ages = reference(1.0), []
    for _ in range(300):
        _, skipped = controller.step(skipped, point.p, point.v, point)
        ages.append(float(skipped.law_state.watch.age[0]))
    assert ages[190] == float(state.law_state.watch.age[0])
    assert ages[-1] > ages[190]
