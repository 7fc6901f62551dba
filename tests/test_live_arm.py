"""Live arms in reports: the module in the page is the experiment's own loop, and where there is none it says why."""

from __future__ import annotations

import base64
import importlib
import json
import re
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from comparisons import comparison
from every_law import ARM, GAIN, law_named, slotine_li
from wasm_machine import Machine

import adaptctl
from adaptctl.codegen import live_arm as module
from adaptctl.codegen.live_arm import LiveArm, live_arm
from adaptctl.control import Controller, Sinusoids, Spline
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.experiments.contest import live_contender
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.recording.report import report
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.effects import ControlDelay
from adaptctl.simulation.law_operations import law_flops
from adaptctl.simulation.references import REFERENCE

SWING = Sinusoids(np.zeros(3), np.full(3, 0.2), np.array([0.3, 0.5, 0.7]))


def shown(law: Controller[Any], mechanism: Mechanism, reference: Any = SWING, **more: Any) -> LiveArm | str:
    plant = Plant(mechanism, 1e-3, **more)
    started = plant.init(mechanism.neutral_configuration + 0.05, np.zeros(plant.dof))
    return live_arm(plant, law, reference, started, np.asarray(mechanism.inertial_parameters))


@pytest.mark.parametrize("name", ["gradient", "loop"])
def test_the_loop_in_the_page_is_the_one_that_is_simulated(name: str) -> None:
    law: Any = law_named(name)
    mechanism = law.model.mechanism
    reference = Sinusoids(mechanism.neutral_configuration, np.full(3, 0.2), np.array([0.3, 0.5, 0.7]))
    live = shown(law, mechanism, reference)
    assert isinstance(live, LiveArm)
    facts, machine = live.facts, Machine(live.binary)
    for values, at in zip(facts["start"], facts["state"], strict=True):
        machine.write(8 * at, values)
    machine.write(8 * facts["parameters"], facts["parameter"])
    machine.write(8 * facts["gains"], facts["gain"])
    plant = Plant(mechanism, 1e-3)
    loop, started = ClosedLoop(plant, law), plant.init(mechanism.neutral_configuration + 0.05, np.zeros(3))
    arms = loop.compiled().ensemble(1)
    loop.set_state(arms, started, law.init(started.p, started.v))
    arms.held["parameters"] = mechanism.inertial_parameters
    points = reference(1e-3 * np.arange(4))
    signals = dict(zip(REFERENCE, points, strict=True)) | {"noise": np.zeros((4, 0))}
    sample = Sample(*(x[:, 0] for x in arms.run(4, signals, record=True)))
    for k in range(4):
        machine.write(8 * facts["time"], [1e-3 * k])
        machine.call(machine.exports["period"])
        torque = machine.read(8 * facts["torque"], 3)
        np.testing.assert_allclose(torque, sample.torque[k], rtol=0, atol=1e-10 * np.abs(sample.torque).max())
        error = plant.positions(sample.q[k]) - points.p[k]
        np.testing.assert_allclose(machine.read(8 * facts["error"], 3), error, rtol=0, atol=1e-12)
        np.testing.assert_allclose(machine.read(8 * facts["goal"], 3), points.p[k], rtol=0, atol=1e-12)
        places = link_poses(mechanism, points.p[k] + error).translations
        np.testing.assert_allclose(machine.read(8 * facts["places"], places.size), places.ravel(), rtol=0, atol=1e-12)
        for at, to, size in zip(facts["next"], facts["state"], facts["sizes"], strict=True):
            machine.write(8 * to, machine.read(8 * at, size))


@pytest.mark.parametrize("fewer", [0, 1])
def test_a_law_of_as_many_operations_as_fit_is_shown(fewer: int, monkeypatch: pytest.MonkeyPatch) -> None:
    law = slotine_li(GAIN)
    monkeypatch.setattr(module, "MAX_LAW_FLOPS", (law_flops(law) or 0) - fewer)
    assert bool(module._obstacle(Plant(ARM, 1e-3), law, SWING)) == bool(fewer)


def test_friction_and_limits_of_the_page_act_on_the_arm() -> None:
    law, friction, limits = slotine_li(GAIN), np.array([2.0, 1.0, 0.5]), np.array([3.0, 2.0, 1.0])
    p, v = np.array([0.1, -0.2, 0.3]), np.array([0.5, -1.0, 2.0])

    def after(rubbing: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities after a period, and the torque that the law asks for."""
        plant = Plant(ARM, 1e-3, torque_limits=most)
        live = live_arm(plant, law, SWING, plant.init(p, v), np.asarray(ARM.inertial_parameters))
        assert isinstance(live, LiveArm)
        facts, machine = live.facts, Machine(live.binary)
        for values, at in zip(facts["start"], facts["state"], strict=True):
            machine.write(8 * at, values)
        for name, values in {"parameters": facts["parameter"], "gains": facts["gain"], "friction": rubbing}.items():
            machine.write(8 * facts[name], list(values))
        machine.call(machine.exports["period"])
        return np.array(machine.read(8 * facts["next"][1], 3)), np.array(machine.read(8 * facts["torque"], 3))

    free, asked = after(np.zeros(3), np.full(3, 1e6))
    M = ARM.mass_matrix(p[None])[0]
    assert (np.abs(asked) > limits).any()
    change = M @ (after(friction, np.full(3, 1e6))[0] - free) / 1e-3  # an impulse by the period
    np.testing.assert_allclose(change, -friction * v, rtol=0.02, atol=0.01)
    change = M @ (after(np.zeros(3), limits)[0] - free) / 1e-3
    np.testing.assert_allclose(change, np.clip(asked, -limits, limits) - asked, rtol=0.01, atol=0.2)


def test_facts_of_the_page_are_those_of_the_arm() -> None:
    live = shown(slotine_li(GAIN), ARM)
    assert isinstance(live, LiveArm)
    facts, names = live.facts, [joint.name for joint in ARM.primary_joints]
    assert (facts["period"], facts["joints"], facts["units"]) == (1e-3, names, ["mrad", "mm", "mrad"])
    mass = sum(link.inertia[0] for link in ARM.links)
    assert facts["heaviest"] == float(f"{0.25 * mass:.1g}")
    assert facts["damping"] == np.broadcast_to(slotine_li(GAIN).damping, 3).tolist()
    assert sum(facts["sizes"]) == sum(len(values) for values in facts["start"])


def test_the_page_is_told_where_its_goal_and_its_links_are() -> None:
    live = shown(slotine_li(GAIN), ARM)
    assert isinstance(live, LiveArm)
    facts, machine = live.facts, Machine(live.binary)
    for at, values in [*zip(facts["state"], facts["start"], strict=True), (facts["parameters"], facts["parameter"])]:
        machine.write(8 * at, values)
    machine.write(8 * facts["gains"], facts["gain"])
    machine.write(8 * facts["time"], [0.4])
    machine.call(machine.exports["period"])
    assert machine.read(8 * facts["goal"], 3) == pytest.approx(SWING(0.4).p)
    origins = link_poses(ARM, ARM.neutral_configuration + 0.05).translations
    assert facts["size"] == origins.size
    assert machine.read(8 * facts["places"], facts["size"]) == pytest.approx(origins.ravel())
    assert facts["parents"] == list(ARM.description.parents)
    places = link_poses(ARM, sampled_configurations(ARM)).translations
    assert facts["reach"] == pytest.approx(max(np.linalg.norm(place) for place in places.reshape(-1, 3)))


def test_payload_friction_and_gains_are_arguments() -> None:
    live = shown(slotine_li(GAIN), ARM)
    assert isinstance(live, LiveArm)
    facts = live.facts
    assert [group["name"][0] for group in facts["groups"]] == ["Λ", "K", "Γ"]
    masses = np.arange(len(ARM.inertial_parameters)) == 10 * (len(ARM.links) - 1)
    assert facts["load"] == masses.astype(float).tolist()  # 1 kg in the last link's origin
    start, count = facts["groups"][1]["places"][0]
    assert facts["gain"][start : start + count] == [3.0, 4.0, 2.0]
    assert json.loads(json.dumps(facts)) == facts


def test_where_there_is_no_live_arm_it_is_said_why(monkeypatch: pytest.MonkeyPatch) -> None:
    law = slotine_li(GAIN)
    assert "ControlDelay" in str(shown(law, ARM, effects=(ControlDelay(1),)))
    knots = Spline(np.zeros((6, 3)), np.arange(6.0))
    assert shown(law, ARM, knots) == "its reference is a Spline, not a sum of sinusoids"
    assert "too many operations" in str(shown(law_named("forgetting"), ARM))
    monkeypatch.setattr(module, "MAX_MODULE_BYTES", 1000)
    assert "as WebAssembly, above the limit of 1 kB" in str(shown(law, ARM))


def test_a_report_holds_the_live_arm_and_fetches_nothing() -> None:
    from dataclasses import replace

    arm = adaptctl.load("two_link")
    made = comparison(arm, samples=20)
    live = shown(slotine_li(GAIN), ARM)
    page = report(replace(made, live=live)).html({})
    assert isinstance(live, LiveArm)
    assert json.loads(page.split("const facts = ", 1)[1].split(";\n", 1)[0]) == live.facts
    assert not re.findall(r"(?:src|href)=\"(?!data:)[^\"]*//|fetch\(|XMLHttpRequest|import\(", page)
    for what in ('role="status"', 'aria-live="polite"', "aria-pressed", "aria-label", "<noscript>"):
        assert what in page
    for label, heading in (("", made.subject.label), ("by hand", "by hand")):
        assert live.html(heading) in report(replace(made, live=replace(live, label=label))).html({})
    without = report(replace(made, live="its reference is drawn by hand")).html({})
    assert "This report has no live simulation: its reference is drawn by hand." in without
    assert "live-play" not in without


def test_the_home_page_holds_a_learning_arm_and_fetches_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    docs = Path(__file__).parent.parent / "docs"
    monkeypatch.syspath_prepend(docs / "extensions")
    section = importlib.import_module("live_arm").live_section()
    assert "{live-arm}" in (docs / "index.md").read_text()
    facts = json.loads(section.split("const facts = ", 1)[1].split(";\n", 1)[0])
    machine = Machine(base64.b64decode(section.split('atob("', 1)[1].split('"', 1)[0]))
    places = {"parameters": facts["parameter"], "gains": facts["gain"]}
    for at, values in [*zip(facts["state"], facts["start"], strict=True), *((facts[k], x) for k, x in places.items())]:
        machine.write(8 * at, values)
    machine.call(machine.exports["period"])
    assert np.abs(machine.read(8 * facts["torque"], 6)).max() > 1.0
    for what in ('role="status"', "aria-pressed", "aria-label", "<noscript>"):
        assert what in section
    assert "http" not in section


def test_the_demo_shows_the_next_law_where_the_first_is_too_large() -> None:
    experiment = Puma560Adaptive()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = experiment.mechanism()
        contenders = experiment.contenders(mechanism, fundamental_basis(essential_space(mechanism)))[:2]
        live = live_contender(experiment.environment(mechanism), contenders, 0, {})
    assert isinstance(live, LiveArm)
    assert live.label == "Gradient, 36 parameters"
    assert live.label in live.html(live.label)


@pytest.mark.parametrize("count", [1, 2])
def test_contenders_that_no_page_can_show_are_told_why(count: int) -> None:
    env: Any = SimpleNamespace(unwrapped=object())
    contenders: Any = [SimpleNamespace(controller=None, label="law")] * count
    assert live_contender(env, contenders, 0, {}) == "object does not expose its plant and reference"
