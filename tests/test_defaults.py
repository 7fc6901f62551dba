"""Defaults that users rely on: a number that is left out is the one that the interface states."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from adaptctl.control import (
    BoundedGainForgetting,
    CompositeLearning,
    ComputedTorque,
    EModification,
    ErrorFeedback,
    FadedIn,
    GainDesign,
    Gains,
    Halted,
    PriorRanges,
    SigmaModification,
    Sinusoids,
    SlotineLi,
    Workspace,
    adaptation_gain,
    exciting_reference,
    hold_number,
)
from adaptctl.control.gains.hold import require_hold


@pytest.mark.parametrize(
    ("made", "defaults"),
    [
        (Sinusoids, {"phase": None, "start_time": 2.0}),
        (Halted, {"over": 1.0}),
        (FadedIn, {"over": 3.0}),
        (SlotineLi, {"adaptation": None, "initial": None, "period": 1e-3}),
        (ComputedTorque, {"damping_ratio": 1.0, "parameters": None}),
        (ComputedTorque.on, {"damping_ratio": 1.0, "parameters": None}),
        (SigmaModification, {"rate": 0.1, "prior": None}),
        (EModification, {"rate": 0.1, "prior": None}),
        (BoundedGainForgetting, {"weight": 1.0, "cutoff": 20.0}),
        (CompositeLearning, {"weight": 1.0, "cutoff": 20.0, "forgetting": 1.0, "recall": 2.0, "threshold": 0.0}),
        (PriorRanges, {"mass": 5.0, "first_moment": 2.0, "inertia": 0.6, "viscous": 5.0, "coulomb": 10.0}),
        (adaptation_gain, {"ranges": None, "rate": 0.6, "gains": None, "period": 1e-3}),
        (GainDesign.from_bandwidth, {"damping_ratio": 1.0, "period": 1e-3, "delay": 0}),
        (GainDesign.from_poles, {"period": 1e-3, "delay": 0}),
        (GainDesign.from_lqr, {"velocity": 0.0, "effort": 1.0, "period": 1e-3, "delay": 0}),
        (ErrorFeedback.loop, {"delay": 0}),
        (Gains.from_bandwidth, {"ratio": 1.0}),
        (hold_number, {"bandwidth": 0.0, "estimate": None, "workspace": None}),
        (require_hold, {"bandwidth": 0.0, "workspace": None}),
        (Workspace.within_limits, {"samples": 200, "seed": 0}),
        (Workspace.along, {"margin": 0.2}),
        (exciting_reference, {"frequency": 0.1, "harmonics": 5, "share": 0.8, "iterations": 100, "seed": 0}),
    ],
)
def test_what_is_left_out(made: Callable[..., Any], defaults: dict[str, Any]) -> None:
    parameters = inspect.signature(made).parameters
    assert {name: parameters[name].default for name in defaults} == defaults
