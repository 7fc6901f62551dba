"""Conditions of a contest: what acts on an arm, when and how much, what seeds draw and laws are told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from contest_rows import ARM, entry, reasons

from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.entries import ContestEntry
from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import LAWS
from adaptctl.contest.scene import Scene, robot_name, scene_of
from adaptctl.contest.unseen_motion import unseen_torque_error
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects import ControlDelay, ElasticJoints, Encoder, Friction, PayloadHeld
from adaptctl.simulation.effects.effect import ActuatorEffect
from adaptctl.tuning.learning_rule import torque_error


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of(ARM, 1e-3)


def test_a_wrong_file_is_30_percent_wrong_by_seed_and_the_truth_is_true(scene: Scene) -> None:
    truth = 2.0 * scene.mechanism.inertial_parameters
    assert Known.of(scene, Knowledge.TRUTH, 1, truth).parameters is truth
    ratio = Known.of(scene, Knowledge.WRONG_FILE, 1, truth).parameters[0] / scene.mechanism.inertial_parameters[0]
    assert ratio == pytest.approx(1.3) or ratio == pytest.approx(0.7)
    with pytest.raises(InputError, match="knows limits may not have"):
        _ = Known.of(scene, Knowledge.LIMITS, 1, truth).parameters


def test_conditions_do_what_they_say(scene: Scene) -> None:
    limits = scene.tuning.torque_limits
    np.testing.assert_allclose(CONDITIONS["saturation"].plant(scene).torque_limits, 0.6 * limits)
    halted = CONDITIONS["halt"].reference(scene.reference(1))
    assert not halted(13.5).v.any()
    held = CONDITIONS["payload"].plant(scene)
    assert [held.payload_mass(t) > 0.0 for t in (5.9, 6.1)] == [False, True]
    friction = CONDITIONS["friction"].parameters(scene, 1) - scene.mechanism.inertial_parameters
    names = [name for name, x in zip(scene.mechanism.parameter_names, friction, strict=True) if x]
    assert {name.rpartition(".")[2] for name in names} == {"viscous", "coulomb"}


def test_mujoco_moves_the_arm_as_our_plant_does() -> None:
    ours = entry("gradient", "clean", "links-wrong", seeds=(1,)).rows()
    theirs = replace(entry("gradient", "clean", "links-wrong", seeds=(1,)), plant="mujoco").rows()
    assert reasons(theirs) == {""}
    for one, other in zip(ours, theirs, strict=True):
        assert other["error"] == pytest.approx(one["error"], rel=0.02)


def test_torques_on_an_unseen_motion_are_those_that_an_estimate_gets_wrong(scene: Scene) -> None:
    law = LAWS[0].make(Known.of(scene, Knowledge.TRUTH, 1, scene.rubbing))
    own = scene.model.regrouping @ scene.rubbing
    errors = [unseen_torque_error(scene, law, share * own, scene.rubbing, 1) for share in (1.0, 0.75, 0.0)]
    assert errors == pytest.approx([0.0, 0.25, 1.0], abs=1e-12)
    assert np.isnan(unseen_torque_error(scene, law, np.zeros(0), scene.rubbing, 1))
    weak = scene._replace(tuning=replace(scene.tuning, torque_limits=np.array([1.0, 1e9])))
    motion, model = scene.reference(20_001)(np.linspace(0.0, 20.0, 201)), scene.model
    first = model.slotine_li_regressor(motion.p, motion.v, motion.v, motion.a)[:, 0]  # all that such limits weigh
    other = np.linspace(0.5, 2.0, len(own)) * own
    ratio = np.linalg.norm(first @ (other - own)) / np.linalg.norm(first @ own)
    assert unseen_torque_error(weak, law, other, scene.rubbing, 1) == pytest.approx(ratio)
    rows = ContestEntry("gradient", ARM, "", ("payload",), (1, 2), 8.0, (), "adaptctl").rows()
    assert all(0.001 < row["unseen"] < 1.0 for row in rows)


def test_pushes_and_weights_are_as_told(scene: Scene) -> None:
    limits = scene.tuning.torque_limits
    assert scene.pushed(0.1, 1) == pytest.approx((0.0, 0.1 * limits[1]))
    assert scene.pushed(0.05) == pytest.approx(tuple(0.05 * limits))
    known = Known.of(scene, Knowledge.LIMITS, 1, scene.rubbing)
    composite: Any = next(law for law in LAWS if law.name == "composite").make(known)
    weight = composite.adaptation_law.prediction_weight
    assert weight * torque_error(known.torque_limits, known.damping) ** 2 == pytest.approx(np.ones(2))


def test_other_engines_have_conditions_of_torques_and_loads_alone(scene: Scene) -> None:
    for name, condition in CONDITIONS.items():
        acting = [isinstance(each, ActuatorEffect | PayloadHeld) for each in condition.effects(scene)]
        assert condition.foreign == all(acting), name


def test_effects_are_as_large_as_their_conditions_say(scene: Scene) -> None:
    found = {name: condition.effects(scene) for name, condition in CONDITIONS.items()}
    encoders = {name: each for name, some in found.items() for each in some if isinstance(each, Encoder)}
    assert {name: each.velocity_noise for name, each in encoders.items()} == {
        "noise": 0.03, "halt": 0.03, "encoder-12": 0.0, "encoder-16-200-hz": 0.0,
    }  # fmt: skip
    assert encoders["encoder-12"].resolution == pytest.approx(2.0 * np.pi / 4096)
    assert encoders["encoder-16-200-hz"].resolution == pytest.approx(2.0 * np.pi / 65536)
    assert found["late"] == (ControlDelay(1),)
    periods = {name: condition.control_period for name, condition in CONDITIONS.items()}
    assert {name: 1.0 / x for name, x in periods.items() if x != 1e-3} == pytest.approx(
        {"clean-500-hz": 500.0, "low-rate": 200.0, "encoder-16-200-hz": 200.0}
    )
    for name in ("elastic-motor", "elastic-link"):
        springs: Any = found[name][0]
        assert isinstance(springs, ElasticJoints)
        assert (springs.stiffness, springs.encoders) == (1e4, name.partition("-")[2])
        critical = 2.0 * np.sqrt(springs.stiffness * springs.motor_inertia)  # of a motor on a spring
        assert springs.damping / critical == pytest.approx(np.full(2, 0.1))
        assert scene.tuning.gains.damping * 2e-3 / springs.motor_inertia == pytest.approx(np.full(2, 5.0))


def test_friction_is_a_twentieth_of_the_damping_and_at_most_of_the_limits(scene: Scene) -> None:
    damping, limits = scene.tuning.gains.damping, scene.tuning.torque_limits
    weak = scene._replace(tuning=replace(scene.tuning, torque_limits=np.array([2.0, 1.0])))
    assert scene.friction == pytest.approx(np.array([damping, damping]) / 20.0)  # damping is below these limits
    assert (damping < limits).all()
    assert weak.friction == pytest.approx(np.array([damping, [2.0, 1.0]]) / 20.0)
    named = dict(zip(scene.mechanism.parameter_names, scene.rubbing, strict=True))
    assert [named["elbow.viscous"], named["shoulder.coulomb"]] == pytest.approx([damping[1] / 20, damping[0] / 20])
    static: Any = CONDITIONS["stribeck"].effects(scene)[0]
    assert isinstance(static, Friction)
    assert (static.viscous, static.coulomb) == (0.0, 0.0)
    assert static.stribeck == pytest.approx(0.5 * scene.friction[1])
    assert CONDITIONS["friction"].plant(scene).substeps > CONDITIONS["clean"].plant(scene).substeps


@pytest.mark.parametrize(
    ("name", "levels"),
    [
        ("push", {0.0: 0.0, 5.999: 0.0, 6.001: 1.0, 10.999: 1.0, 11.001: 0.0}),
        ("push-ramped", {5.999: 0.0, 6.5: 0.25, 7.0: 0.5, 9.0: 1.0, 10.999: 1.0, 11.001: 0.0}),
    ],
)
def test_a_push_is_there_when_and_as_far_as_it_says(scene: Scene, name: str, levels: dict[float, float]) -> None:
    push: Any = CONDITIONS[name].effects(scene)[0]
    limit = scene.tuning.torque_limits[1]
    assert push.initial_state(np.zeros((3, 2)), 1e-3).tolist() == [[0.0]] * 3
    for time, level in levels.items():
        torque, after = push.apply(Column((1.0, 2.0)), Column((time,)), 1e-3)
        assert list(torque) == pytest.approx([1.0, 2.0 + 0.1 * level * limit])
        assert list(after) == pytest.approx([time + 1e-3])


def test_a_payload_is_a_twentieth_of_the_arm_and_there_when_it_says(scene: Scene) -> None:
    assert scene.mass == pytest.approx(2.0 + 1.2)  # as in two_link.toml
    for name, times in {"payload": (6.0, np.inf), "dropped": (0.0, 8.0)}.items():
        plant = CONDITIONS[name].plant(scene)
        for time in (0.0, 5.999, 6.001, 7.999, 8.001, 20.0):
            inside = times[0] <= time < times[1]
            assert plant.payload_mass(time) == pytest.approx(inside * scene.mass / 20.0)
            loaded = CONDITIONS[name].loaded(scene, scene.mechanism.inertial_parameters, time)
            added = dict(
                zip(scene.mechanism.parameter_names, loaded - scene.mechanism.inertial_parameters, strict=True)
            )
            assert (added["upper.m"], added["lower.m"]) == pytest.approx((0.0, inside * scene.mass / 20.0))
        of_light: list[Any] = [CONDITIONS[name].effects(SimpleNamespace(mass=x))[0] for x in (0.0, 0.1, 0.4)]  # type: ignore[arg-type]
        assert [each.payload.mass for each in of_light] == pytest.approx([0.02] * 3)
    assert {name: x.event for name, x in CONDITIONS.items() if x.event} == {
        "payload": 6.0, "dropped": 8.0, "push": 11.0, "push-ramped": 11.0, "push-all": 11.0,
    }  # fmt: skip


@pytest.mark.parametrize("draws", [(), ("reference",), ("initial error",)])
def test_seeds_draw_what_a_contest_asks_for_alone(draws: tuple[str, ...]) -> None:
    clean, noise = (replace(entry("pd", name), draws=draws).rows() for name in ("clean", "noise"))
    assert (clean[0]["error"] == clean[1]["error"]) == (not draws)
    assert noise[0]["error"] != noise[1]["error"]


def test_a_seed_begins_a_reference_at_most_ten_seconds_later(scene: Scene) -> None:
    found: Any = scene.tuning.reference
    begun = []
    for seed in range(30):
        drawn: Any = scene.reference(seed)
        shifts = (np.asarray(drawn.phase) - found.phase) / (2.0 * np.pi * np.asarray(found.frequency))
        later = shifts.flat[0]
        np.testing.assert_allclose(drawn(5.0).p, found(5.0 + later).p, atol=1e-12)
        begun.append(later)
    assert 0.0 < min(begun) < 1.0 < 9.0 < max(begun) < 10.0


def test_a_wrong_file_is_wrong_by_seed_and_unlike_the_links_of_that_seed(scene: Scene) -> None:
    own = scene.mechanism.inertial_parameters
    told = [Known.of(scene, Knowledge.WRONG_FILE, seed, own).told for seed in range(8)]
    true = [CONDITIONS["links-wrong"].parameters(scene, seed) for seed in range(8)]
    links = [[round(float(x[k] / own[k]), 6) for k in (0, 10)] for x in told + true]
    assert {x for each in links for x in each} == {0.7, 1.3}
    assert len({tuple(each) for each in links}) > 2
    assert links[:8] != links[8:]
    assert links[:4] == [[0.7, 1.3], [0.7, 1.3], [1.3, 1.3], [0.7, 1.3]]  # for ever, so that rows stay those of a seed


@pytest.mark.parametrize(
    ("robot", "name"), [("two_link", "two_link"), ("arms/b.urdf", "b"), ("arm.toml", "arm"), ("{some}/x/y.xml", "y")]
)
def test_a_robot_is_called_by_its_name_or_file(robot: str, name: str) -> None:
    assert robot_name(robot) == name
