"""Sentences and drawings of an identification's report, on numbers by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.dynamics import load
from adaptctl.identification import Validation
from adaptctl.identification.report import (
    _counted,
    _excitation,
    _parameters,
    _residuals,
    _torques,
    consistency,
    verdict,
)

PUMA = load("puma560_measured")
rng = np.random.default_rng(2)
MEASURED = rng.normal(size=(200, 6))
VALIDATION = Validation("the last fifth", 9.0, 0.1 * np.arange(200.0), MEASURED, MEASURED * [1.1, 1, 1, 1, 1, 3.0])


def found(**others: Any) -> Any:
    own = {
        "mechanism": PUMA, "validation": VALIDATION, "validation_in_band": VALIDATION, "misfit_ratio": 1.25,
        "choice": SimpleNamespace(settings=SimpleNamespace(left_out=(1,))), "names": ("link2.mc_x", "joint1.viscous"),
        "estimate": np.array([2.0, 0.5]), "deviations": np.array([0.1, 9.0]), "deviation_ratio": 2.5,
        "intervals": np.array([[1.8, 2.2], [np.nan, np.nan]]),
        "model": SimpleNamespace(basis=None, columns=(3, PUMA.num_energy_parameters)),
        "combinations": [SimpleNamespace(strength=x) for x in (0.0, 3.0, 40.0)],
    }  # fmt: skip
    return SimpleNamespace(**(own | others))


def test_joints_are_not_predicted_from_their_own_torque_on_or_left_out() -> None:
    names = [joint.name for joint in PUMA.primary_joints]
    assert verdict(found()).endswith(f"; not predicted: {names[1]}, {names[5]}.")
    assert "the band of the motion" not in verdict(found())
    band = Validation("the last fifth", 4.0, VALIDATION.time, MEASURED, MEASURED)
    assert "below 4 Hz, the band of the motion)" in verdict(found(validation_in_band=band))


def test_the_cost_of_consistency_is_told_and_the_parameters_are_counted() -> None:
    assert "is 25.0% larger" in consistency(found())
    assert _counted(found()).endswith(": 1 of links and rotors, 1 of friction")
    links = SimpleNamespace(columns=(3, PUMA.num_energy_parameters - 1))
    assert _counted(found(model=links)) == f"2 of {len(PUMA.parameter_names)}"


@pytest.mark.parametrize("equations", [None, ["a = b", "c = d"]])
def test_parameters_have_their_deviations_and_relations_if_there_are_any(equations: list[str] | None) -> None:
    basis = None if equations is None else SimpleNamespace(equations=lambda: equations)
    parts: Any = _parameters(found(model=SimpleNamespace(basis=basis))).parts
    head, table, _, lines = parts
    assert lines.lines == (equations or [])
    assert "2.5 times those for white residuals" in head
    assert "joint1.viscous: no interval" in head
    assert [row[2:] for row in table.rows] == [("2", "0.1"), ("0.5", "9")]


def test_drawings_have_what_was_measured_predicted_and_left() -> None:
    torques, residuals = _torques(found()).axes, _residuals(found()).axes
    assert (len(torques), len(residuals)) == (6, 12)
    for j, ax in enumerate(torques):
        measured, predicted = (line.get_ydata() for line in ax.lines)
        np.testing.assert_allclose(measured, MEASURED[:, j])
        np.testing.assert_allclose(predicted, VALIDATION.predicted[:, j])
        np.testing.assert_allclose(residuals[2 * j].lines[0].get_ydata(), VALIDATION.error[:, j])
        heights = [bar.get_height() for bar in residuals[2 * j + 1].patches]
        np.testing.assert_allclose(heights, VALIDATION.autocorrelation(60)[:, j])
    assert torques[-1].get_xlabel() == "time in the log [s]"
    (line,) = _excitation(found()).axes[0].lines
    np.testing.assert_allclose([line.get_xdata(), line.get_ydata()], [[1, 2, 3], [40.0, 3.0, 1e-6]])
