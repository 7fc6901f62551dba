"""Joints that move one way alone in the rows that are fitted: what is constant is their friction's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_logs import Known, known

from adaptctl.identification import Identification
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.identify import identified

WORDS = "joint1: the rows that are fitted have one way of motion, in which friction and an offset are one constant"


def found(case: Known, turns_at: float) -> Identification:
    """Identification of a log whose second joint turns back once, after a share of the time."""
    log, time = case.log, case.log.time
    way = np.where(time < turns_at * time[-1], 1.0, -1.0)
    speed = 0.3 * way * (1.0 - 0.7 * np.cos(4.0 * time)) * (1.0 - np.exp(-(((time - turns_at * time[-1]) / 0.1) ** 2)))
    position = log.position.copy()
    position[:, 1] = np.cumsum(speed) * (time[1] - time[0])
    v = np.gradient(position, time, axis=0)
    torque = case.truth.inverse_dynamics(position, v, np.gradient(v, time, axis=0))
    friction = FrictionModel.named("viscous,coulomb,offset")
    return identified(case.guess, case.drives, [replace(log, position=position, torque=torque)], friction=friction)


@pytest.mark.parametrize(("turns_at", "is_one_way"), [(0.7, True), (0.3, False)])
def test_a_joint_that_turns_back_only_in_rows_held_out_has_friction_and_no_offset(
    turns_at: float, is_one_way: bool
) -> None:
    case = known(7, duration=10.0, rate=200.0, noise=0.0)
    result = found(case, turns_at)
    values = dict(zip(result.names, result.estimate.tolist(), strict=True))
    assert any(WORDS in note for note in result.warnings) == is_one_way
    assert ("joint1.offset" in values) != is_one_way
    assert "joint2.offset" in values
    assert values["joint1.coulomb"] == pytest.approx(1.5, rel=0.2)
    assert result.validation.joint_relative_errors[1] < 0.1
