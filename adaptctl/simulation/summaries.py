"""Error summaries computed during a run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.compilation.lanes import Precision
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.controller import GAINS, ReferencePoint
from adaptctl.control.lyapunov import has_sliding_variable
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.scalars import Column, Scalar, absolute, column, maximum, where
from adaptctl.simulation.closed_loop import ClosedLoop, Sample

FINAL_WINDOW = 2.0
"""s at the end for the final error"""
LARGEST_FLOAT = float(np.finfo(np.float64).max)


class ErrorSums(NamedTuple):
    """Sums of the tracking errors so far."""

    squares: Any
    final_squares: Any
    largest: Any
    outside: Any
    diverged: Any
    joint: Any


def sum_sizes(joints: int) -> dict[str, int]:
    """Lengths of the columns of `ErrorSums`, by name."""
    return ErrorSums(joints, joints, joints, 1, 1, 1)._asdict()


def judged_by(joints: int) -> dict[str, int]:
    """Lengths of the columns of error criteria of r `joints`."""
    return {"within": joints, "beyond": joints, "final": 1}


def summed(clock: Scalar, error: Column, columns: Mapping[str, Column]) -> ErrorSums:
    """Sums after one more control period."""
    before = ErrorSums(*(columns[name] for name in ErrorSums._fields))
    sizes = Column(map(absolute, error))
    joint = before.joint[0]
    for i in reversed(range(len(sizes))):
        gone = where(sizes[i] <= columns["beyond"][i], joint, i + 1.0)  # what is not a number is beyond
        joint = where(before.joint[0] > 0.5, before.joint[0], gone)
    runs, first = joint < 0.5, before.joint[0] < 0.5
    counted = Column(where(runs, x, 0.0) for x in error)
    late = where(clock < columns["final"][0], 0.0, 1.0)
    squares = counted * counted
    outside = before.outside[0]
    for size, bound in zip(sizes, columns["within"], strict=True):
        outside = where(size <= bound, outside, clock + 1.0)
    return ErrorSums(
        before.squares + squares,
        before.final_squares + late * squares,
        Column(where(runs, maximum(x, y), x) for x, y in zip(before.largest, sizes, strict=True)),
        Column((where(runs, outside, before.outside[0]),)),
        Column((where(runs, 0.0, where(first, clock + 1.0, before.diverged[0])),)),
        Column((joint,)),
    )


def summary(sums: ErrorSums, count: int, final: int, period: float, beyond: Array) -> dict[str, Any]:
    """Summaries of M runs, by name in `Rollouts`."""
    joint = sums.joint[:, 0].astype(np.int64) - 1
    lost = joint >= 0
    counted = np.where(lost, sums.diverged[:, 0] - 1.0, count)
    rms = np.sqrt(sums.squares / np.maximum(counted, 1.0)[:, None])
    last = np.sqrt(sums.final_squares / np.maximum(counted - final, 1.0)[:, None])
    last[(counted <= final) | (count < round(FINAL_WINDOW / period))] = np.nan
    largest = sums.largest.copy()
    if np.isinf(beyond).all():
        rms[lost], largest[lost] = np.nan, np.nan
    back = np.where(lost | (sums.outside[:, 0] >= count), np.nan, sums.outside[:, 0] * period)
    gone = np.where(lost, counted * period, np.nan)
    summaries = {"rms_error": rms, "largest_error": largest, "final_rms_error": last, "settling_time": back}
    return {name: frozen(x) for name, x in (summaries | {"diverged_at": gone, "diverged_joint": joint}).items()}


TRUTH = "truth"
"""column of the true values of adapted parameters"""
METRIC = "metric"
"""column of a full Gamma^-1: upper triangle by rows, half its diagonal; four times faster than solving with Gamma"""


class LyapunovRise(NamedTuple):
    """Lyapunov function V and its largest rise so far."""

    lyapunov: Any
    lyapunov_rise: Any


def rise_sizes(law: SlotineLi | None) -> dict[str, int]:
    """Lengths of the columns of `LyapunovRise`."""
    known = 0 if law is None else 1
    return LyapunovRise(known, known)._asdict()


def truth_sizes(law: SlotineLi | None) -> dict[str, int]:
    """Lengths of the constant columns for V, by name."""
    if law is None:
        return {}
    k = len(law.model.names)
    return {TRUTH: k} | ({METRIC: k * (k + 1) // 2} if _whole_gain(law) is not None else {})


@lru_cache(maxsize=8)  # asked for by every batch of arms
def watched(loop: ClosedLoop, precision: Precision) -> SlotineLi | None:
    """Controller whose V can be computed, else None."""
    law, plant = loop.controller, loop.plant
    if precision == "single":
        return None
    if not has_sliding_variable(law) or plant.loads or plant.is_elastic:
        return None
    if law.model.mechanism.equations != plant.mechanism.equations or plant.mechanism.equations.has_constraint_bias:
        return None
    start = np.asarray(law.initial)
    known = law.adaptation_law is None or law.adaptation_law.lyapunov_distance(law.model, start, start) is not None
    return law if known else None


def first_rise(
    law: SlotineLi | None, parameters: Array, gains: Mapping[str, Array]
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Initial and constant columns for V."""
    if law is None:
        return {}, {}
    # Not by BLAS, whose second thread takes longer to begin than so few products.
    stays = {TRUTH: np.einsum("mp,kp->mk", parameters, law.model.regrouping)}
    if (own := _whole_gain(law)) is not None:
        inverse = np.linalg.inv(gains.get("adaptation.gain", own)) * (1.0 - 0.5 * np.eye(len(own)))
        stays[METRIC] = inverse[(..., *np.triu_indices(len(own)))]
    return LyapunovRise(LARGEST_FLOAT, 0.0)._asdict(), stays


def _whole_gain(law: SlotineLi) -> Array | None:
    """Full Gamma (k, k) of a gradient law, else None."""
    own = law.adaptation_law
    return own.gain if isinstance(own, Descent) and own.gain.ndim == 2 else None


def risen(
    loop: ClosedLoop, sample: Sample, point: ReferencePoint, runs: Any, columns: Mapping[str, Column]
) -> LyapunovRise:
    """V and its largest rise (J) after one more period."""
    before = LyapunovRise(*(columns[name] for name in LyapunovRise._fields))
    if not len(before.lyapunov):
        return before
    value, rise = _lyapunov(loop, sample, point, columns), before.lyapunov_rise[0]
    larger = maximum(rise, value - before.lyapunov[0])
    return LyapunovRise(Column((value,)), Column((where(runs, larger, rise),)))


def _lyapunov(loop: ClosedLoop, sample: Sample, point: ReferencePoint, columns: Mapping[str, Column]) -> Scalar:
    """V in J."""
    law: Any = loop.controller.substituted(columns[GAINS]) if GAINS in columns else loop.controller
    true, equations = columns[TRUTH], loop.plant.mechanism.equations
    s = sample.v - point.v + column(law.bandwidth) * (loop.plant.primary(sample.q) - point.p)
    moving = equations.energy_regressor(sample.q, s) - equations.potential_regressor(sample.q)
    kinetic: Scalar = Column(moving[j] for j in law.model.columns) @ true
    if law.adaptation_law is None:
        return kinetic
    if METRIC in columns:
        return kinetic + _half_square(columns[METRIC], sample.estimate - true)
    return kinetic + law.adaptation_law.lyapunov_term(law.model, sample.estimate, true)


def _half_square(triangle: Column, error: Column) -> Scalar:
    """error' A error / 2, with A stored like `METRIC`."""
    rest = iter(triangle)
    rows = (Column(next(rest) for _ in error.of[i:]) @ Column(error.of[i:]) for i in range(len(error)))
    return Column(rows) @ error
