"""Laws of the library in a contest, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from adaptctl import control
from adaptctl.contest.known import Knowledge, Known
from adaptctl.control import Controller, SlotineLi
from adaptctl.tuning.learning_rule import torque_error

CUTOFF, FORGETTING, LEAKAGE, SLIDING_LEAKAGE = 5.0, 2.0, 0.1, 0.5
"""rad/s of torque filters; 1/s of least squares and of sigma-modification; 1/rad of e-modification"""
DEAD_ZONE, STACK = 0.02, 24
"""rad/s of the sliding error; samples of concurrent learning"""


class Entrant(NamedTuple):
    """Law of a contest: its name, what it may know, and the controller that it makes of that."""

    name: str
    knows: Knowledge
    make: Callable[[Known], Controller[Any]]
    meaning: str
    tuned: str = "by the rule"


def slotine_li(known: Known, adaptation: Any, initial: Any = None) -> SlotineLi:
    """Slotine and Li's law with the gains by the rule."""
    given = initial, known.control_period, known.scene.tuning.workspace, known.torque_limits
    return SlotineLi(known.model, known.bandwidth, known.damping, adaptation, *given)


def _predicting(known: Known) -> dict[str, Any]:
    weight = 1.0 / torque_error(known.torque_limits, known.damping) ** 2
    return {"prediction_weight": weight, "cutoff": CUTOFF}


def _by_tuning(known: Known, adaptation: str) -> Controller[Any]:
    return known.scene.tuning.controller(known.model, adaptation, anyway=True)


def _pd(known: Known, parameters: Any) -> Controller[Any]:
    return control.PDGravity(known.mechanism, known.stiffness, known.damping, parameters)


def _computed_torque(known: Known) -> Controller[Any]:
    return control.ComputedTorque(known.mechanism, known.bandwidth, 1.0, known.parameters)


def _adaptive_computed_torque(known: Known) -> Controller[Any]:
    given = known.model, known.bandwidth, known.initial, known.gain
    period, limits = known.control_period, known.torque_limits
    return control.AdaptiveComputedTorque(*given, control_period=period, torque_limits=limits)


def _integral(known: Known) -> Controller[Any]:
    given = known.model, known.bandwidth, known.damping, known.gain
    rest = None, known.control_period, known.scene.tuning.workspace, known.torque_limits
    return control.PassivityIntegral(*given, *rest)


def _diagonal(known: Known) -> Any:
    return np.diag(known.gain)


LIMITS, WRONG, TRUTH = Knowledge.LIMITS, Knowledge.WRONG_FILE, Knowledge.TRUTH
TRUE_MODEL, PD_GRAVITY = "true", "pd-gravity"
"""Laws over which errors of others are told."""
LAWS = (
    Entrant(TRUE_MODEL, TRUTH, lambda k: slotine_li(k, None, k.initial), "Slotine and Li's law with the true model"),
    Entrant("computed-torque-true", TRUTH, _computed_torque, "computed torque with the true model"),
    Entrant("computed-torque-wrong", WRONG, _computed_torque, "computed torque with links 30 % wrong"),
    Entrant("pd", LIMITS, lambda k: _pd(k, np.zeros(len(k.mechanism.parameter_names))), "PD"),
    Entrant(PD_GRAVITY, TRUTH, lambda k: _pd(k, k.parameters), "PD with true gravity"),
    Entrant("learning", LIMITS, lambda k: _by_tuning(k, "learning"), "the default: guarded least squares with memory"),
    Entrant("gradient", LIMITS, lambda k: _by_tuning(k, "gradient"), "gradient"),
    Entrant("composite", LIMITS, lambda k: slotine_li(k, control.Composite(k.gain, **_predicting(k))), "composite"),
    Entrant(
        "sigma-modification",
        LIMITS,
        lambda k: slotine_li(k, control.SigmaModification(k.gain, LEAKAGE)),
        "σ-modification",
    ),
    Entrant(
        "e-modification",
        LIMITS,
        lambda k: slotine_li(k, control.EModification(k.gain, SLIDING_LEAKAGE)),
        "e-modification",
    ),
    Entrant(
        "dead-zone", LIMITS, lambda k: slotine_li(k, control.DeadZone(k.gain, np.full(k.dof, DEAD_ZONE))), "dead zone"
    ),
    Entrant(
        "bounded-gain-forgetting",
        LIMITS,
        lambda k: slotine_li(k, control.BoundedGainForgetting(_diagonal(k), **_predicting(k), forgetting=FORGETTING)),
        "least squares, bounded gain",
    ),
    Entrant(
        "cushioned-floor",
        LIMITS,
        lambda k: slotine_li(k, control.CushionedFloor(_diagonal(k), **_predicting(k), forgetting=FORGETTING)),
        "least squares, floor",
    ),
    Entrant(
        "composite-learning",
        LIMITS,
        lambda k: slotine_li(k, control.CompositeLearning(_diagonal(k), **_predicting(k), forgetting=FORGETTING)),
        "composite learning",
    ),
    Entrant(
        "concurrent-learning",
        LIMITS,
        lambda k: slotine_li(k, control.ConcurrentLearning(k.gain, **_predicting(k), stack_size=STACK)),
        "concurrent learning",
    ),
    Entrant("passivity-integral", LIMITS, _integral, "integral action, gradient"),
    Entrant("adaptive-computed-torque", WRONG, _adaptive_computed_torque, "adaptive computed torque, links 30 % wrong"),
)
"""All laws of the library that a contest has."""
