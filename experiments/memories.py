"""Findings on what adaptation laws remembered in a run, and on how consistent the bodies of their estimates stayed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import ConsistentLift, Controller, Natural
from adaptctl.control.adaptation.natural import pseudos
from adaptctl.dynamics import Mechanism
from adaptctl.recording import ControllerRun, Finding


def memory_findings(controller: Controller[Any], run: ControllerRun, mechanism: Mechanism) -> Iterator[Finding]:
    """Iterator over findings, a `Finding` (named number with unit) each, on what the adaptation law of a `controller`
    stored or kept in a `run`. For laws with a threshold of excitation (composite and concurrent learning): the fraction
    of samples (no unit) in which it was passed. For natural adaptation and the consistent lift: the least eigenvalue,
    SI units, of the estimated pseudo-inertia (4, 4) of any link of `mechanism` over all samples. None for other
    laws. Nothing is checked."""
    law, learning = getattr(getattr(controller, "of", controller), "adaptation_law", None), run.rollout.learning
    if isinstance(law, Natural):
        yield smallest_eigenvalue(mechanism, run, run.rollout.estimate)
    elif isinstance(law, ConsistentLift):
        yield smallest_eigenvalue(mechanism, run, learning)
    elif learning.size and (threshold := getattr(law, "threshold", None)) is not None:
        share = float(np.mean(learning > 0.0))
        meaning = f"{run.label}: share of periods whose excitation passed its threshold of {threshold:g} 1/s"
        yield Finding(f"remembered.{run.name}", share, "1", meaning if share else f"{meaning}: nothing was remembered")


def forgotten_notes(findings: tuple[Finding, ...]) -> list[str]:
    """List of sentences for the report, one for each of the `findings` that states that a law's excitation never passed
    its threshold, so that nothing was stored for learning. Nothing is checked."""
    found = (f for f in findings if f.name.startswith("remembered.") and f.value == 0.0)
    return [
        f"{f.meaning.split(':')[0]} remembered nothing: no excitation passed its threshold; a smaller one would."
        for f in found
    ]


def smallest_eigenvalue(mechanism: Mechanism, run: ControllerRun, parameters: Array) -> Finding:
    """Least eigenvalue, as a `Finding` in SI units, of the pseudo-inertia (4, 4) of any link of `mechanism` over the T
    samples of a `run`, positive where all links stayed physically consistent. `parameters` (T, P) are, at each sample,
    of every link m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), then those of drives,
    which are not used. Raises `ValueError` for a run without samples."""
    bodies = len(mechanism.description.bodies)
    tens = parameters[:, : 10 * bodies].reshape(-1, bodies, 10)
    value = float(np.linalg.eigvalsh(pseudos(tens))[..., 0].min())
    meaning = f"{run.label}: smallest eigenvalue of any link's pseudo-inertia, of the run's samples"
    return Finding(f"smallest_eigenvalue.{run.name}", value, "SI", meaning)
