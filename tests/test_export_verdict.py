"""Controllers that fail in simulation before they are exported: refused with the reason, or written with it."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import ARM, GAIN, guarded, law_named, slotine_li
from nightly import at_night
from test_export import exported

import adaptctl
from adaptctl.cli.export import _print
from adaptctl.cli.main import main
from adaptctl.codegen.closed_loop_check import _motion, _unlearned, centre, check_closed_loop, default_reference
from adaptctl.codegen.interface import Interface
from adaptctl.control import ComputedTorque, Sinusoids
from adaptctl.errors import InputError, VerdictError
from adaptctl.scalars import column


def test_a_law_that_runs_away_is_not_exported(tmp_path: Path) -> None:
    wild = ComputedTorque(ARM, np.full(3, 2500.0))
    with pytest.raises(InputError, match=r"check: in simulation the loop diverges after .* s"):
        exported(tmp_path, wild, check=True)
    assert list(tmp_path.iterdir()) == []


def test_a_law_that_the_guards_stop_is_not_exported() -> None:
    wild = guarded(ComputedTorque(ARM, np.full(3, 2500.0)), stop_damping=0.1, control_period=1e-3)
    with pytest.raises(InputError, match="check: in simulation the safety limits stop the arm after"):
        check_closed_loop(Interface(wild), default_reference(Interface(wild)), 5.0)


def test_a_law_that_rings_or_never_learns_is_not_exported() -> None:
    lively = guarded(
        ComputedTorque(ARM, np.full(3, 800.0)), torque=1e7, rates=1e12, stop_damping=0.1, control_period=1e-3
    )
    with pytest.raises(VerdictError, match=r"check: in simulation a joint oscillates after .* s; use smaller gains"):
        check_closed_loop(Interface(lively), Sinusoids(np.zeros(3), np.full(3, 0.1), np.ones(3), start_time=0.0), 2.0)
    slow = guarded(slotine_li(1e-9 * GAIN), torque=400.0)
    reference = default_reference(Interface(slow))
    with pytest.raises(VerdictError, match=r"check: in simulation it does not learn: the error is .* finally; use"):
        check_closed_loop(Interface(slow), reference, 20.0)
    assert check_closed_loop(Interface(guarded(slotine_li(GAIN), torque=400.0)), reference, 20.0)["failure"] is None


@pytest.mark.parametrize(
    ("started", "ended", "learned"),
    [(0.03, 0.0099, True), (0.03, 0.0101, False), (0.006, 0.0049, True), (0.006, 0.0051, False), (0.001, 0.004, True)],
)
def test_learned_is_an_error_below_5_mrad_or_a_third_of_the_first(started: float, ended: float, learned: bool) -> None:
    assert (_unlearned(Interface(slotine_li(GAIN)), started, ended) is None) is learned
    assert _unlearned(Interface(slotine_li(None)), started, ended) is None  # what does not adapt need not learn


def test_the_motion_of_test_vectors_is_one_that_an_arm_could_make() -> None:
    interface = Interface(slotine_li(GAIN))
    reference: Any = default_reference(interface)
    assert np.ravel(reference.amplitude) == pytest.approx(np.full(3, 0.1))
    assert np.ravel(reference.frequency) == pytest.approx([0.2, 0.26, 0.32])
    step = 1e-5
    (p, v), points = _motion(interface, reference, step * np.arange(3)), reference(step * np.arange(3))
    np.testing.assert_allclose((p[2] - p[0]) / (2.0 * step), v[1], rtol=1e-6)
    off = p - points.p
    assert 0.01 < np.abs(off).max() <= 0.02  # m or rad from the reference
    with_period = [(_motion(interface, reference, np.array([0.0, 1.0 / x]))[0] - reference(np.array([0.0, 1.0 / x])).p)
                   for x in (3.0, 4.0, 5.0)]  # fmt: skip
    for j, both in enumerate(with_period):  # of whole numbers of Hz from 3 on
        assert both[0, j] == pytest.approx(both[1, j], abs=1e-12)
        assert both[0, (j + 1) % 3] != pytest.approx(both[1, (j + 1) % 3], abs=1e-4)


def test_a_tool_is_moved_about_its_place_at_home_while_its_joints_move_about_theirs() -> None:
    interface = Interface(law_named("tool in the world"))
    reference: Any = default_reference(interface)
    law: Any = interface.innermost
    p0, step = centre(interface), 1e-5
    assert np.ravel(reference.amplitude) == pytest.approx(np.full(2, 0.05))
    x, _ = law.point(column(law.model.mechanism.configuration(p0)))
    assert np.ravel(reference.center) == pytest.approx([float(part) for part in x])
    p, v = _motion(interface, reference, np.arange(0.0, 0.5, step))
    np.testing.assert_allclose((p[2:] - p[:-2]) / (2.0 * step), v[1:-1], atol=1e-6)
    assert np.abs(p - p0).max(axis=0) == pytest.approx(np.full(interface.controller.dof, 0.02), rel=1e-3)
    assert p[0] == pytest.approx(p0 + 0.02 * np.sin(1.0))


@pytest.mark.parametrize(
    ("home", "expected"), [(0.0, 0.0), (2.9, np.deg2rad(150.0) - 0.15), (-3.0, 0.15 - np.deg2rad(150.0))]
)
def test_the_centre_is_home_or_near_it_within_the_limits(home: float, expected: float) -> None:
    arm = adaptctl.load("two_link")
    controller = SimpleNamespace(neutral_configuration=np.array([0.0, home]))
    interface: Any = SimpleNamespace(controller=controller, mechanism=arm)
    assert centre(interface) == pytest.approx([0.0, expected])
    links = list(arm.description.links)
    narrow = replace(links[1].joint, limits=replace(links[1].joint.limits, lower=0.2, upper=0.4))
    links[1] = replace(links[1], joint=narrow)
    interface.mechanism = adaptctl.Mechanism(replace(arm.description, links=tuple(links)))
    assert centre(interface) == pytest.approx([0.0, 0.3])  # no room for the margin: the middle


def test_what_failed_is_exported_where_that_is_asked_for_and_says_so(tmp_path: Path) -> None:
    wild = ComputedTorque(ARM, np.full(3, 2500.0))
    checked = exported(tmp_path, wild, check=True, anyway=True).manifest["check"]
    assert checked["finite"] is False
    assert "the loop diverges after" in checked["failure"]
    assert checked["rms_error_last_10_s"] is None


GRAMS = """
schema = "adaptctl/mechanism/1"
name = "arm"
[[links]]
name = "upper"
axis = [0, 1, 0]
position = [0, 0, 0.3]
range_deg = [-120, 120]
effort = 40
mass = 2.5
center_of_mass = [0, 0, 0.2]
inertia_at_center = { xx = 0.03, yy = 0.03, zz = 0.004 }
[[links]]
name = "fore"
parent = "upper"
axis = [0, 1, 0]
position = [0, 0, 0.4]
range_deg = [-140, 140]
effort = 15
mass = 1400 # grams
center_of_mass = [0, 0, 0.15]
inertia_at_center = { xx = 0.012, yy = 0.012, zz = 0.002 }
"""


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PlausibilityWarning")
def test_gains_that_fail_in_simulation_are_not_exported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, place = tmp_path / "grams.toml", tmp_path / "out"
    robot.write_text(GRAMS)
    assert main(["tune", str(robot)]) == 3
    assert capsys.readouterr().out.startswith("FAILED: the arm does not learn with these gains: nominal: failed")
    assert main(["export", str(robot), "--out", str(place), "--check", "--law", "computed-torque"]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert "adaptctl: arm: these gains fail in simulation (nominal: failed, tracking error inf)" in said.err
    assert not place.exists()
    tuning = adaptctl.tune(adaptctl.load(robot))
    assert not tuning.verified[0].is_learning
    model = adaptctl.ReducedModel.full(tuning.mechanism)
    with pytest.raises(VerdictError, match="use them anyway with anyway=True"):
        tuning.controller(model)
    assert tuning.controller(model, anyway=True).adaptation is not None
    assert tuning.controller(model, adaptation=False).adaptation is None
    assert main(["export", str(robot), "--out", str(place), "--anyway"]) == 0
    assert (place / "manifest.json").is_file()


@pytest.mark.parametrize("anyway", [False, at_night(True)])
def test_a_check_that_fails_is_a_verdict_on_the_command_line(
    anyway: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["export", "puma560_geared", "--law", "task-space", "--check", "--out", str(tmp_path / "out")]
    if anyway:
        assert main([*asked, "--anyway"]) == 0
        assert "FAILED: in simulation the safety limits stop the arm after" in capsys.readouterr().out
    else:
        assert main(asked) == 3
        assert "check: in simulation the safety limits stop the arm after" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["guarded", "tool in the world", "guarded loop"])
def test_a_check_says_what_it_saw(name: str) -> None:
    law = guarded(slotine_li(GAIN), torque=400.0) if name == "guarded" else law_named(name)
    interface = Interface(law)
    found = check_closed_loop(interface, default_reference(interface), 3.0)
    assert found["finite"] is True
    assert found["duration"] == 3.0
    assert found["reference"]["kind"] == "Sinusoids"
    if interface.follows_joints:
        assert 0.0 < found["rms_error_last_10_s"] < 0.1
    else:
        assert found["rms_error_last_10_s"] is None


def test_a_check_is_of_mechanisms_of_as_many_links_as_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    interface, swing = Interface(slotine_li(GAIN)), Sinusoids(np.zeros(3), np.full(3, 0.1), np.ones(3))
    for most, checked in ((len(ARM.links), True), (len(ARM.links) - 1, False)):
        monkeypatch.setattr("adaptctl.codegen.closed_loop_check.MAX_COMPILED_LINKS", most)
        with nullcontext() if checked else pytest.raises(InputError, match=r"check: .* without the check"):
            assert check_closed_loop(interface, swing, 0.01)["finite"]
    bare: Any = SimpleNamespace(mechanism=None, controller=None)
    with pytest.raises(InputError, match="no mechanism to simulate"):
        check_closed_loop(bare, swing)


def test_a_check_can_be_repeated_from_what_it_states() -> None:
    interface = Interface(slotine_li(GAIN))
    reference = Sinusoids(np.zeros(3), np.full(3, 0.1), np.full(3, 0.5), start_time=0.25)
    found = check_closed_loop(interface, reference, 0.5)
    numbers = json.loads(json.dumps(found["reference"]))
    assert numbers.pop("kind") == "Sinusoids"
    assert check_closed_loop(interface, Sinusoids(**numbers), 0.5) == found


def test_the_outcome_is_told_with_its_check_its_memory_and_how_to_test_it(capsys: pytest.CaptureFixture[str]) -> None:
    check = {"rms_error_first_10_s": 0.0123, "rms_error_last_10_s": 0.00045, "duration": 600.0, "failure": None}
    manifest = {"flops": 1470, "control_period": 2e-3, "guarded": True, "check": check, "state_bytes": 320}
    told = []
    for more in ({"stack_bytes_about": 100}, {"stack_bytes_about": 10**7, "check": check | {"failure": "it fell"}}):
        done: Any = SimpleNamespace(
            directory=Path("my arm"), files=["arm.c", "arm.h"], name="arm", manifest=manifest | more
        )
        _print(done, "mrad")
        told.append(capsys.readouterr().out)
    assert told[0].splitlines()[0] == "my arm: arm.c, arm.h"
    for words in ("1470 operations", "every 0.002 s; with safety", "RMS error 12.3 mrad, final 0.45 mrad", "320 bytes"):
        assert words in told[0]
    assert "cd 'my arm' && cc -std=c99 arm.c test_arm.c -lm" in told[0]
    assert ["--law slotine-li" in text for text in told] == [False, True]
    assert ["it fell" in text for text in told] == [False, True]
    bare = {"flops": 9, "control_period": 1.0, "guarded": False, "check": None}
    _print(SimpleNamespace(directory=Path("d"), files=["a"], name="arm", manifest=bare), "mrad")  # type: ignore[arg-type]
    last = capsys.readouterr().out
    assert "without safety" in last
    assert not re.search("checked|state|cc ", last)
