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
    FadeIn,
    GainDesign,
    Gains,
    PriorRanges,
    SigmaModification,
    Sinusoids,
    SlotineLi,
    StoppedReference,
    Workspace,
    adaptation_gain,
    excitation_trajectory,
    sampling_ratio,
)
from adaptctl.control.gains.sampling_ratio import validate_sampling_ratio


@pytest.mark.parametrize(
    ("made", "defaults"),
    [
        (Sinusoids, {"phase": None, "start_time": 2.0}),
        (StoppedReference, {"duration": 1.0}),
        (FadeIn, {"duration": 3.0}),
        (SlotineLi, {"adaptation": None, "initial": None, "control_period": 1e-3}),
        (ComputedTorque, {"damping_ratio": 1.0, "parameters": None}),
        (ComputedTorque.from_model, {"damping_ratio": 1.0, "parameters": None}),
        (SigmaModification, {"leakage": 0.1, "prior": None}),
        (EModification, {"leakage": 0.1, "prior": None}),
        (BoundedGainForgetting, {"prediction_weight": 1.0, "cutoff": 20.0}),
        (
            CompositeLearning,
            {"prediction_weight": 1.0, "cutoff": 20.0, "forgetting": 1.0, "recall": 2.0, "excitation_threshold": 0.0},
        ),
        (PriorRanges, {"mass": 5.0, "first_moment": 2.0, "inertia": 0.6, "viscous": 5.0, "coulomb": 10.0}),
        (adaptation_gain, {"ranges": None, "gain_scale": 0.6, "gains": None, "control_period": 1e-3}),
        (GainDesign.from_bandwidth, {"damping_ratio": 1.0, "control_period": 1e-3, "delay": 0}),
        (GainDesign.from_poles, {"control_period": 1e-3, "delay": 0}),
        (GainDesign.from_lqr, {"velocity": 0.0, "effort": 1.0, "control_period": 1e-3, "delay": 0}),
        (ErrorFeedback.loop, {"delay": 0}),
        (Gains.from_bandwidth, {"damping_scale": 1.0}),
        (sampling_ratio, {"bandwidth": 0.0, "estimate": None, "workspace": None}),
        (validate_sampling_ratio, {"bandwidth": 0.0, "workspace": None}),
        (Workspace.within_limits, {"samples": 200, "seed": 0}),
        (Workspace.along, {"margin": 0.2}),
        (excitation_trajectory, {"frequency": 0.1, "harmonics": 5, "limit_share": 0.8, "iterations": 100, "seed": 0}),
    ],
)
def test_what_is_left_out(made: Callable[..., Any], defaults: dict[str, Any]) -> None:
    parameters = inspect.signature(made).parameters
    assert {name: parameters[name].default for name in defaults} == defaults
