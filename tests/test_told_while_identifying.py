"""What an identification tells: its stages by name as they begin, and what a short log cannot tell."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

import adaptctl
from adaptctl.identification import Identification
from adaptctl.stages import watching

STAGES = [
    "reading logs",
    "checking logs",
    "filtering motions and torques",
    "measuring the noise of positions",
    "measuring the delay of torques",
    "comparing hypotheses about the columns",
    "checking that the log is of this robot",
    "cross-validating friction, filter and prior",
    "fitting links and friction",
    "validating the fit",
]


@pytest.fixture(scope="module", params=[4.0, 6.0])
def swung(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[float, Identification, list[str]]:
    """Seconds of a log of two joints that swing, its identification, and the stages of that as they began."""
    file, arm = tmp_path_factory.mktemp("swung") / "log.csv", adaptctl.load("two_link")
    time = np.arange(0.0, request.param, 0.01)
    angle = 2.0 * np.pi * np.array([0.5, 0.7]) * time[:, None]
    p, v = 0.5 * np.sin(angle), np.pi * np.array([0.5, 0.7]) * np.cos(angle)
    a = -0.5 * (2.0 * np.pi * np.array([0.5, 0.7])) ** 2 * np.sin(angle)
    rows = np.column_stack([time, p, arm.inverse_dynamics(p, v, a)])
    header = "time,position.shoulder,position.elbow,torque.shoulder,torque.elbow"
    np.savetxt(file, rows, delimiter=",", header=header, comments="")
    units = {"time": "s", "position": "rad", "torque": "N m"}
    given: Any = {"units": units, "friction": "viscous", "cutoff": 12.5, "prior_weight": 1.0, "trust_log": True}
    told: list[str] = []
    with watching(lambda name: nullcontext(told.append(name))):
        found = adaptctl.identify(file, arm, **given)
    return request.param, found, told


def test_a_short_log_is_told_what_it_cannot_tell(swung: tuple[float, Identification, list[str]]) -> None:
    duration, found, _ = swung
    assert any("a short log, of" in note for note in found.warnings) == (duration < 5.0)


def test_stages_are_told_in_their_order(swung: tuple[float, Identification, list[str]]) -> None:
    assert [name for name in dict.fromkeys(swung[2]) if not name.startswith("compiling")] == STAGES
