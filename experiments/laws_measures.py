"""Measures of runs of adaptation laws: parameter errors, drift, recovery, memories, and the cost of a tick."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control import ConsistentLift, Controller, Natural
from adaptctl.control.adaptation.natural import pseudos
from adaptctl.control.memory import leaves
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import ControllerRun, Finding

WINDOW = 2.0
"""s over which errors are averaged, before an event and after it"""
TWICE = 2.0
FLOAT_TICKS = 20


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Standard deviations (k,) of a model's k parameters, SI units, where those of every link and drive are off by the
    fraction `share` of their size, independently. `parameters` (P,) are all P, SI units, a link's as m, mc_x, ...,
    I_zz; with its pseudo-inertia's mass m and second moment t, the sizes are m, sqrt(m t) and t."""
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)


@dataclass(frozen=True, eq=False)
class ParameterErrors:
    """Measure of how far estimates of a `model`'s k parameters are off: differences weighed by `weights` (k,), N m (N)
    by unit of each parameter, over the weighed norm of the true ones."""

    model: ReducedModel
    weights: Array

    @classmethod
    def along(cls, model: ReducedModel, p: Array, v: Array, a: Array) -> ParameterErrors:
        """The measure whose weights are the RMS torques that each parameter makes along a motion of T samples, p, v and
        a (T, r) each, over samples and joints."""
        rows = model.torque_regressor(p, v, a)
        return cls(model, np.sqrt(np.mean(rows**2, axis=(0, 1))))

    def of(self, run: ControllerRun) -> Array | None:
        """Parameter errors (T,), no unit, over the samples of a `run`; None where its controller estimates none, or
        others than this model has."""
        if run.rollout.estimate.shape[1] not in self.model.regrouping.shape:
            return None
        return self._apart(self._reduced(run.rollout.estimate), self.model.fundamental_parameters)

    def apart(self, one: Array, other: Array) -> float:
        """Distance, no unit, of two estimates (k,) or (P,) in this measure."""
        return float(self._apart(self._reduced(one), self._reduced(other)))

    def _reduced(self, estimate: Array) -> Array:
        """Estimates (..., k), of all parameters or of the kept ones, as kept ones."""
        regrouping = self.model.regrouping
        return estimate @ regrouping.T if estimate.shape[-1] == regrouping.shape[1] else estimate

    def _apart(self, one: Array, other: Array) -> Array:
        weighed = np.linalg.norm((one - other) * self.weights, axis=-1)
        return np.asarray(weighed / np.linalg.norm(self.model.fundamental_parameters * self.weights))


def drift(errors: ParameterErrors, run: ControllerRun) -> float:
    """Drift, 1/min, of the estimate of a `run` in its second half: from the mean of its third quarter to that of
    its last one."""
    third, fourth = (part.mean(axis=0) for part in np.array_split(run.rollout.estimate, 4)[2:])
    return errors.apart(third, fourth) / (0.25 * run.duration / 60.0)


@dataclass(frozen=True, eq=False)
class Recovery:
    """Return of a `run` from an `event`: `earlier`, the RMS error (rad, m if prismatic) of all joints before the first
    event; `time`, s after the event until the RMS error over the coming 2 s is below twice that, None for never; and
    `left`, the RMS error of the last 2 s before the next event over the earlier one, None where it has no samples."""

    run: ControllerRun
    event: str
    earlier: float
    time: float | None
    left: float | None

    @classmethod
    def of(cls, run: ControllerRun, event: str, earlier: float, begin: float, end: float) -> Recovery:
        """The recovery from an `event` at `begin` until the next one at `end`, s."""
        end = min(end, run.duration)
        last = run.rms_error(max(begin, end - WINDOW), end)
        coming = run.moving_rms_error(WINDOW)[round(WINDOW / run.rollout.spacing) - 1 :]
        times = run.rollout.time[: len(coming)]
        back = np.flatnonzero((times >= begin) & (times <= end - WINDOW) & (coming < TWICE * earlier))
        returned = float(times[back[0]]) - begin if back.size else None
        return cls(run, event, earlier, returned, None if last is None else last / earlier)

    @property
    def finding(self) -> Finding | None:
        """Time to return, s, or, where the run does not, its error at the end over the earlier one; None where neither
        is known."""
        place, label = f"after_{self.event.replace(' ', '_')}.{self.run.name}", self.run.label
        if self.time is not None:
            meaning = f"{label}: time after the {self.event} until the error is below twice the earlier"
            return Finding(f"return_{place}", self.time, "s", meaning)
        if self.left is None:
            return None
        meaning = f"{label}: does not return after the {self.event}; error at the end over the earlier"
        return Finding(f"not_back_{place}", self.left, "1", meaning)


def held_back(run: ControllerRun) -> Array:
    """Array (T,), above 0 at samples of a `run` at which a limit of a torque or of its rate held a torque back."""
    marks = [run.rollout.marks[name] for name in ("torque_limited", "rate_limited") if name in run.rollout.marks]
    return np.asarray(np.max([run.rollout.clipped, *marks], axis=0))


def memory_findings(controller: Controller[Any], run: ControllerRun, mechanism: Mechanism) -> Iterator[Finding]:
    """Iterator over findings on what a `controller`'s adaptation law remembered or kept in a `run`: for laws with a
    threshold of excitation the share of samples in which it was passed; for natural adaptation and the consistent lift
    the least eigenvalue of any link's estimated pseudo-inertia."""
    law, learning = getattr(getattr(controller, "of", controller), "adaptation_law", None), run.rollout.learning
    if isinstance(law, Natural | ConsistentLift):
        bodies = len(mechanism.description.bodies)
        kept = run.rollout.estimate if isinstance(law, Natural) else learning
        value = float(np.linalg.eigvalsh(pseudos(kept[:, : 10 * bodies].reshape(-1, bodies, 10)))[..., 0].min())
        meaning = f"{run.label}: smallest eigenvalue of any link's pseudo-inertia, of the run's samples"
        yield Finding(f"smallest_eigenvalue.{run.name}", value, "SI", meaning)
    elif learning.size and (threshold := getattr(law, "threshold", None)) is not None:
        share = float(np.mean(learning > 0.0))
        meaning = f"{run.label}: share of periods whose excitation passed its threshold of {threshold:g} 1/s"
        yield Finding(f"remembered.{run.name}", share, "1", meaning if share else f"{meaning}: nothing was remembered")


def forgotten_notes(findings: Iterable[Finding]) -> list[str]:
    """Sentences, one for each of the `findings` that says that a law's excitation never passed its threshold."""
    return [
        f"{f.meaning.split(':')[0]} remembered nothing: no excitation passed its threshold; a smaller one would."
        for f in findings
        if f.name.startswith("remembered.") and f.value == 0.0
    ]


def float_tick(controller: Controller[Any], run: ControllerRun) -> float:
    """Median time, s, of a `controller`'s tick on Python's floats, not compiled, over 20 states of a `run`. Raises
    `IndexError` for a run without samples."""
    o, on_floats = run.rollout, controller.on_floats
    kept = leaves(controller.init(o.p[0], o.v[0]))
    costs = []
    for k in np.linspace(0, len(o.time) - 1, FLOAT_TICKS).astype(int):
        started = time.perf_counter()
        on_floats(o.p[k], o.v[k], o.reference_p[k], o.reference_v[k], o.reference_a[k], *kept)
        costs.append(time.perf_counter() - started)
    return float(np.median(costs))
