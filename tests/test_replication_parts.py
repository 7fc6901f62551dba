"""Parts of the replication of Sheu and Walker (1991) on arms and tables that are not those of the paper."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description.inertia import inertia_tensor
from adaptctl.dynamics import load
from adaptctl.experiments.replication.arms import Arm, Study, index
from adaptctl.experiments.replication.judging import Check, Computation, Item, Outturn, Paper, Printed, Saying, printed
from adaptctl.experiments.replication.pages import _badge, parts
from adaptctl.experiments.replication.puma560 import _energies, _medians, figure3, figure4, table6
from adaptctl.experiments.replication.semi_direct_drive import decoupled, figure6
from adaptctl.recording.page import Table

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")


def test_energy_errors_that_can_be_drawn_are_all_that_are_printed_but_zero() -> None:
    pair = [_energies(printed().items[name]) for name in ("table3", "table10")]
    assert pair == [{10: 35.2, 25: 11.3, 30: 5.3, 34: 0.3, 35: 0.002}, {10: 0.7, 20: 0.03, 23: 0.009, 25: 0.0003}]
    assert _medians(np.array([[1.0, 5.0], [2.0, 7.0], [9.0, 6.0]]), 0, 1) == "2 % and 6 %"


def about_center(inertia: Array) -> Array:
    """Inertia tensor of a link's ten parameters about its center of mass, by Steiner's theorem."""
    arms = np.cross(np.eye(3), inertia[1:4] / inertia[0])
    return np.asarray(inertia_tensor(inertia) - inertia[0] * arms.T @ arms)


def test_links_of_a_decoupled_arm_are_moved_and_no_others() -> None:
    arm = load("semi_direct_drive_parallelogram")
    before, now = (one.inertial_parameters.reshape(-1, 10) for one in (arm, decoupled(arm)))
    np.testing.assert_array_equal(now[0], before[0])
    np.testing.assert_array_equal(now[:, 0], before[:, 0])
    np.testing.assert_allclose(now[1:4, 1], before[1:4, 1])
    np.testing.assert_allclose(now[1:, 2:4], 0.0, atol=1e-15)
    for one, other in zip(before[1:], now[1:], strict=True):
        np.testing.assert_allclose(about_center(other), about_center(one), atol=1e-12)
    crank, upper = (float(arm.links[k].parent_to_joint.translation[0]) for k in (3, 4))
    assert {crank, upper} == {0.45, 0.3}
    assert now[4, 1] - now[4, 0] * crank == pytest.approx(crank / upper * now[3, 1])


@pytest.mark.parametrize(("added", "is_wrong"), [(0.0, True), (-0.02, False), (-0.3, False)])
def test_an_arm_is_no_erratum_where_one_alike_could_be_rigid(added: float, is_wrong: bool) -> None:
    """Five of its links are not, but arms that move alike may be where I_x4 + I_y4 - I_z4 and more are not negative."""
    study = Study(printed(), 0, 2, 101, 1.0, 0.7, 50, 0.1)
    given = study.puma.parameters.copy()
    given[index("I_z", "4")] += added
    vars(study)["puma"] = Arm(study, study.puma.mechanism.with_parameters(given), "table1", "table4")
    found = table6(study)
    assert found.numbers["wrist"] == pytest.approx(-0.013 - added)
    assert found.numbers["impossible"] == 5
    assert found.agrees is is_wrong


def test_a_table_of_a_report_has_the_checks_at_their_rows_and_columns() -> None:
    places = [("a", "1"), ("a", "2"), ("b", "2")]
    checks = tuple(Check(row, column, f"{row}{column}", "x", Outturn.GIVEN) for row, column in places)
    item = Item("table1", "title", Outturn.GIVEN, "told", (), (), (), checks, Computation())
    badges = [_badge(verdict) for verdict in Outturn]
    assert all(cell.badge for cell in badges)
    assert len({cell.tone for cell in badges}) == len(badges)
    (table,) = (part for part in parts(item) if isinstance(part, Table))
    assert tuple(table.header) == ("entry", "1", "2")
    assert [[getattr(cell, "text", cell) for cell in row] for row in table.rows] == [["a", "x", "x"], ["b", "", "x"]]


def test_a_motion_is_a_sinusoid_with_its_own_velocities_and_accelerations() -> None:
    study = Study(printed(), 0, 2, 62, 1.0, 0.7, 5, 0.1)  # five times, a quarter of a period apart
    for arm in (study.puma, study.five_bar):
        motion, rate = arm.motion, 2.0 * np.pi * 0.7
        off = motion.p[1] - motion.p[0]
        v, a = rate * np.outer([1, 0, -1, 0, 1], off), -(rate**2) * np.outer([0, 1, 0, -1, 0], off)
        torques = arm.mechanism.inverse_dynamics(motion.p, v, a)
        np.testing.assert_allclose(motion.Y @ arm.parameters, torques, atol=1e-9 * np.abs(torques).max())


def test_energies_of_an_arm_are_small_where_both_bounds_hold_in_one_draw() -> None:
    study = Study(printed(), 0, 3, 62, 1.0, 0.7, 11, 0.1)
    errors = np.full((3, study.five_bar.space.rank + 1), 0.05)
    errors[1, 11], errors[2, 17] = 0.6, 0.2  # bounded by 0.5 and 0.1 %
    vars(study.five_bar)["percent_errors"] = errors
    assert figure3(study).claims["arm_energy"] == pytest.approx(1.0 / 3.0)


@pytest.mark.parametrize("kind", [Paper, Printed, Saying])
def test_what_the_paper_says_is_read_whole_and_never_changed(kind: Any) -> None:
    assert kind.__struct_config__.forbid_unknown_fields
    assert kind.__struct_config__.frozen


def test_drawn_torques_and_bounds_are_at_numbers_that_the_paper_prints() -> None:
    study, paper = Study(printed(), 0, 2, 62, 1.0, 0.7, 11, 0.1), printed()
    for step, table in ((figure4, "table3"), (figure6, "table10")):
        (axes,) = step(study).drawings[0].draw().axes
        counts = [line.get_label().split()[0] for line in axes.lines[1:]]
        assert len(counts) == 3
        assert [line.is_dashed() for line in axes.lines] == [False, False, False, True]
        assert set(counts) < set(paper.items[table].columns)
        assert counts[-1] == paper.items[table].columns[-1]
    bounds = re.findall(r"(\d+) components", paper.claims["arm_energy"].quote)
    found = figure3(study)
    for axes in found.drawings[0].draw().axes[1:]:
        below = next(line for line in axes.lines if line.get_marker() == "v")
        assert below.get_xdata().tolist() == [int(x) for x in bounds] == [11, 17]
        assert below.get_ydata().tolist() == [0.5, 0.1]
    median = np.median(study.five_bar.percent_errors, axis=0)
    assert found.numbers["generic_medians"] == f"{median[11]:.2g} % and {median[17]:.2g} %"
