"""Words on an arm whose first joint slides: errors are not all in mrad, forces not all in N m."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from comparisons import comparison
from matplotlib.figure import Figure
from nightly import nightly
from synthetic_logs import known

from adaptctl.description import JointKind, Limits
from adaptctl.design import DesignTask
from adaptctl.design.report import quantities
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.joint_units import error_unit, position_unit, position_units
from adaptctl.errors import InputError
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.experiments.laws import friction_curves
from adaptctl.identification.preparation import prepare
from adaptctl.recording.judgement import final_error, first_error, outcome_words
from adaptctl.recording.result import silent
from adaptctl.recording.wording import coupling_unit
from adaptctl.tuning import tune

CART = """
schema = "adaptctl/denavit-hartenberg/1"
name = "cart"
convention = "standard"
base = { rpy = [1.5707963267948966, 0.0, 0.0] }

[[links]]
name = "cart"
joint = "rail"
type = "prismatic"
a = 0.0
alpha_deg = 90
range = [-0.5, 0.5]
velocity = 2.0
effort = 100.0
mass = 2.0
center_of_mass = [0.0, 0.0, 0.0]
inertia_at_center = { xx = 0.01, yy = 0.01, zz = 0.01 }

[[links]]
name = "pole"
joint = "pivot"
a = 0.3
alpha_deg = 0
range_deg = [-150, 150]
velocity = 6.0
effort = 25.0
mass = 1.2
center_of_mass = [-0.15, 0.0, 0.0]
inertia_at_center = { xx = 0.001, yy = 0.01, zz = 0.01 }
"""


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    path = tmp_path / "cart.toml"
    path.write_text(CART)
    return path


def test_units_of_both_kinds_are_told_together(cart: Path) -> None:
    arm, turning = load(cart), load("puma560_measured")
    assert (position_units(arm), position_unit(arm), error_unit(arm)) == (("m", "rad"), "rad or m", "mrad or mm")
    assert (position_unit(turning), error_unit(turning)) == ("rad", "mrad")


def test_runs_that_verify_gains_say_so(cart: Path) -> None:
    assert "mrad or mm; without adaptation" in str(tune(load(cart)).verified[0])
    assert "mrad; without adaptation" in str(tune(load("two_link")).verified[0])


def test_errors_of_each_unit_are_those_of_its_own_joints(cart: Path) -> None:
    shown = comparison(load(cart))
    rollout = shown.subject.rollout
    run = replace(shown.subject, rollout=replace(rollout, p=rollout.reference_p + np.array([0.003, -0.012])))
    shown = replace(shown, runs=(run,))
    assert shown.joints_by_unit == {"rad": [1], "m": [0]}
    assert first_error(shown, run) == final_error(shown, run) == "12 mrad and 3 mm"
    worse = replace(rollout, p=rollout.reference_p + np.array([0.3, 0.024]))
    off = replace(comparison(load(cart)).runs[1], rollout=worse)
    assert "remains at 24 mrad and 300 mm (2 and 100 times larger)." in outcome_words(replace(shown, runs=(run, off)))


def test_coupling_is_in_the_unit_of_its_joints(cart: Path) -> None:
    assert [coupling_unit(load(arm)) for arm in (str(cart), "puma560_measured")] == ["kg m", "kg m²"]
    task = DesignTask.within_limits(load(cart), 50, 0, 0.25)
    assert dict(quantities(task, 1.0))["coupling (RMS of off-diagonal entries)"].endswith(" kg m")
    links = load(cart).description.links
    alone = Mechanism(replace(load(cart).description, links=links[:1]))
    joint = replace(links[1].joint, kind=JointKind.PRISMATIC)
    sliding = Mechanism(replace(load(cart).description, links=(links[0], replace(links[1], joint=joint))))
    assert [coupling_unit(arm) for arm in (alone, sliding)] == ["kg m²", "kg"]


@nightly
def test_two_plants_say_so(cart: Path) -> None:
    compared = AdaptiveTracking(robot=str(cart), plant="both", duration=2.0).compare(silent)
    assert {f.unit for f in compared.findings if f.name.startswith("plants_apart")} == {"rad or m"}


def test_logs_beyond_limits_are_told_in_the_joints_units() -> None:
    """A joint that slides moves in m/s and takes N."""
    case = known(1, 1, duration=4.0)
    link = case.guess.description.links[0]

    def refused(limits: Limits) -> str:
        joint = replace(link.joint, kind=JointKind.PRISMATIC, limits=limits)
        arm = Mechanism(replace(case.guess.description, links=(replace(link, joint=joint),)))
        with pytest.raises(InputError) as caught:
            prepare(case.log, arm)
        return str(caught.value)

    assert " m/s, but the limit of the robot is 0.001; check" in refused(Limits(velocity=1e-3))
    assert " N, but the limit of the robot is 0.001; check" in refused(Limits(effort=1e-3))


def test_friction_over_speed_has_the_joints_units(cart: Path) -> None:
    figure = friction_curves(load(cart), {"rail.coulomb": 2.0}, np.linspace(-1.0, 1.0, 100).reshape(50, 2), 0.1)
    assert isinstance(figure, Figure)
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == ["rail [N]", "pivot [N·m]"]
    assert figure._supxlabel.get_text() == "velocity [rad/s or m/s]"  # type: ignore[attr-defined]
