"""Comparisons to be shown: experiments', and some made by hand, whose motion is along sinusoids, torques are by inverse
dynamics, and errors fade."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.experiment import Experiment
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Comparison, ControllerRun, Finding, Setting, StepCost
from adaptctl.recording.comparison import NO_MODEL
from adaptctl.recording.summary import summary
from adaptctl.simulation import Rollout

PERIOD = 2e-3


LAW = "SlotineLi + Gradient"


def rollout(
    mechanism: Mechanism, samples: int, fade: float, estimate: Array | None = None, complete: bool = True
) -> Rollout:
    """Errors that fall from 0.1 at a rate `fade` (1/s); estimates (T, k) as given."""
    r = mechanism.dof
    time = PERIOD * np.arange(samples)
    rows = np.linspace(0.2, 0.4, r)
    reference = Sinusoids(np.linspace(-0.5, 0.5, r), rows, rows, start_time=0.5)(time)
    error = 0.1 * np.exp(-fade * time)[:, None] * np.ones(r)
    p, v = reference.p + error, reference.v - fade * error
    torque = mechanism.inverse_dynamics(p, v, reference.a)
    limits = np.minimum(mechanism.effort_limits, 1e3)
    applied = np.clip(torque, -limits, limits)
    return Rollout(
        time=time,
        p=p,
        v=v,
        reference_p=reference.p,
        reference_v=reference.v,
        reference_a=reference.a,
        torque=torque,
        applied=applied,
        clipped=np.any(applied != torque, axis=1).astype(float),
        energy=mechanism.energy(p, v),
        reward=-np.sum(error**2, axis=1),
        estimate=np.zeros((samples, 0)) if estimate is None else estimate,
        control_period=PERIOD,
        wall_time=0.25,
        interrupted=not complete,
    )


def comparison(mechanism: Mechanism, samples: int = 1500, complete: bool = True) -> Comparison:
    """An adaptive run whose estimates approach the truth, and the same with adaptation off."""
    space = essential_space(mechanism)
    basis = fundamental_basis(space)
    truth = ReducedModel(mechanism, basis).fundamental_parameters
    share = -np.expm1(-3.0 * PERIOD * np.arange(samples))
    learnt = rollout(mechanism, samples, 4.0, share[:, None] * truth, complete)
    lyapunov = 3.0 + 2.0 * np.exp(-PERIOD * np.arange(samples))
    runs = [
        ControllerRun("adaptive", "Slotine-Li, <learning>", NO_MODEL, learnt, lyapunov, StepCost(5e-6, 2e-7, 1470), LAW)
    ]
    if complete:
        runs.append(
            ControllerRun("adaptation-off", "Slotine-Li, adaptation off", NO_MODEL, rollout(mechanism, samples, 0.2))
        )
    return Comparison(
        experiment="by-hand",
        title="Made by hand",
        purpose="To be shown.",
        mechanism=mechanism,
        space=space,
        basis=basis,
        runs=tuple(runs),
        torque_limits=np.minimum(mechanism.effort_limits, 1e3),
        settings=(Setting("Λ", "8", "bandwidth, 1/s"),),
        seed=7,
        duration=samples * PERIOD,
        findings=(Finding("difference", 2e-11, "N m", "a difference"),),
        complete=complete,
    )


def no_progress(what: str, share: float) -> None:
    assert 0.0 <= share <= 1.0


def shown(experiment: Experiment) -> dict[str, Any]:
    """An experiment's summary, which must be fit for JSON; its own figures must draw."""
    compared = experiment.compare(no_progress)
    assert isinstance(compared, Comparison)
    for drawing in compared.more_drawings:
        assert drawing.draw().axes
    content: dict[str, Any] = json.loads(json.dumps(summary(compared), allow_nan=False))
    assert content["complete"]
    return content
