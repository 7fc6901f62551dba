"""Memories of adaptation laws along runs that are over: what was remembered, and how consistent a lift stayed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import ConsistentLift, Controller, ReferencePoint
from adaptctl.control.adaptation.natural import pseudos
from adaptctl.dynamics import Mechanism
from adaptctl.recording import ControllerRun, Finding
from adaptctl.simulation import Rollout


def memories(controller: Controller[Any], run: Rollout) -> Iterator[Any]:
    """Memory of an adaptive controller's law after every tick, found by ticking again on the same measurements.

    It differs from that of the run by round-off; nothing is yielded for a controller whose law has no memory.
    """
    p = run.p if run.measured_p is None else run.measured_p
    v = run.v if run.measured_v is None else run.measured_v
    if len(p) == 0 or _learning(controller.init(p[0], v[0])) is None:
        return
    state = controller.init(p[0], v[0])
    for k, goal in enumerate(zip(run.reference_p, run.reference_v, run.reference_a, strict=True)):
        _, state = controller.step(state, p[k], v[k], ReferencePoint(*goal))
        yield _learning(state)


def _learning(state: Any) -> Any:
    """Memory of the adaptation law, behind guards or not; None where there is none."""
    inner = state.of if hasattr(state, "of") else state
    return getattr(inner, "learning", None)


def memory_findings(controller: Controller[Any], run: ControllerRun, mechanism: Mechanism) -> Iterator[Finding]:
    """Findings: the share of periods that were remembered, and the smallest eigenvalue of a lift's pseudo-inertias."""
    law = getattr(getattr(controller, "of", controller), "adaptation_law", None)
    if isinstance(law, ConsistentLift):
        lifts = np.array([memory.lift for memory in memories(controller, run.rollout)])
        yield smallest_eigenvalue(mechanism, run, lifts)
        return
    if law is None or not hasattr(law, "threshold"):
        return
    learned = np.array([float(memory.learned[0]) for memory in memories(controller, run.rollout)])
    share = float(np.mean(learned > 0.0))
    meaning = f"{run.label}: share of periods whose excitation passed its threshold of {law.threshold:g} 1/s"
    yield Finding(f"remembered.{run.name}", share, "1", meaning if share else f"{meaning}: nothing was remembered")


def forgotten_notes(findings: tuple[Finding, ...]) -> list[str]:
    """Sentences on runs that remembered nothing."""
    found = (f for f in findings if f.name.startswith("remembered.") and f.value == 0.0)
    return [
        f"{f.meaning.split(':')[0]} remembered nothing: no excitation passed its threshold; a smaller one would."
        for f in found
    ]


def smallest_eigenvalue(mechanism: Mechanism, run: ControllerRun, parameters: Array) -> Finding:
    """Smallest eigenvalue of any link's pseudo-inertia over a run, of all parameters (T, P)."""
    bodies = len(mechanism.description.bodies)
    tens = parameters[:, : 10 * bodies].reshape(-1, bodies, 10)
    value = float(np.linalg.eigvalsh(pseudos(tens))[..., 0].min())
    meaning = f"{run.label}: smallest eigenvalue of any link's pseudo-inertia, over the whole run"
    return Finding(f"smallest_eigenvalue.{run.name}", value, "SI", meaning)
