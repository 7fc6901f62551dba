"""Summaries of a run's errors that are kept while it runs, so that no sample has to be."""

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

SETTLED = 2.0
"""s at the end of a run over which its final error is taken."""
LARGEST = float(np.finfo(np.float64).max)


class ErrorSums(NamedTuple):
    """Sums of the tracking errors (positions less the reference's) of a run of r joints over its control periods so
    far: Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled), or arrays (M, r) or (M, 1)
    for M runs. From the period on in which the run diverges, an error being NaN or larger than its bound `beyond`, rad
    (m if prismatic), (r,), errors are not counted any more. Nothing is checked.

    `squares` (r,), rad^2 (m^2), are sums of the errors' squares, and `final_squares` (r,) those of the periods at the
    run's end over which its final error is taken; `largest` (r,), rad (m), are the errors' largest magnitudes.
    `outside` (1,) is the number of periods up to and including the last one with an error larger than its bound
    `within`, rad (m), (r,), 0 where there was none; `diverged` (1,) is the number of periods up to and including the
    one in which the run diverged, 0 where it did not; `joint` (1,) is the number, from 1, of the first joint whose
    error made it diverge, 0 where none did.
    """

    squares: Any
    final_squares: Any
    largest: Any
    outside: Any
    diverged: Any
    joint: Any


def sum_sizes(joints: int) -> dict[str, int]:
    """Lengths, by name, of the columns (vectors) that hold a run's `ErrorSums`, which are sums of tracking errors of r
    `joints`: r for "squares", "final_squares" and "largest", 1 for "outside", "diverged" and "joint". Nothing is
    checked."""
    return ErrorSums(joints, joints, joints, 1, 1, 1)._asdict()


def judged_by(joints: int) -> dict[str, int]:
    """Lengths, by name, of the columns (vectors) of the criteria for tracking errors of r `joints`. They are r for the
    bounds, rad (m if prismatic), of the errors' magnitudes, "within", to which a run is to return, and "beyond", past
    which it has diverged; 1 for "final", the zero-based index of the control period from which on errors count as
    final. Nothing is checked."""
    return {"within": joints, "beyond": joints, "final": 1}


def summed(clock: Scalar, error: Column, columns: Mapping[str, Column]) -> ErrorSums:
    """The `ErrorSums`, sums of a run's tracking errors, after one more control period, over Columns, vectors of scalars
    of any kind (floats, arrays, or symbols to be compiled).

    `clock` is the period's index, from 0, and `error` (r,) are its tracking errors, positions of r joints less the
    reference's, rad (m if prismatic). `columns` has, by name, the sums before the period, "squares", "final_squares"
    and "largest" (r,), "outside", "diverged" and "joint" (1,), and the criteria for errors: the bounds "within" and
    "beyond" (r,), rad (m), and "final" (1,), the index of the first period whose errors are final. An error that is NaN
    or larger than `beyond` makes the run diverge: from this period on all sums stay. Raises `KeyError` where a column
    is missing, `IndexError` where "beyond" is too short, `ValueError` where "within" or "largest" has another length.
    """
    before = ErrorSums(*(columns[name] for name in ErrorSums._fields))
    sizes = Column(map(absolute, error))
    joint = before.joint[0]
    for i in reversed(range(len(sizes))):
        sound = where(sizes[i] <= columns["beyond"][i], 1.0, 0.0)  # what is not a number is beyond
        joint = where(before.joint[0] > 0.5, before.joint[0], where(sound > 0.5, joint, i + 1.0))
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
    """Summaries of M runs of r joints by their names in `Rollouts`, from their `sums`, arrays (M, r) or (M, 1), after
    `count` control periods of `period` (s): root mean squares and largest magnitudes of tracking errors, rad (m if
    prismatic), times of return and divergence, s, and the joints that diverged.

    Errors count as final from the period of index `final` on. `beyond` (r,), rad (m), are the bounds by which runs
    diverged. In a run that diverged, `rms_error` and `largest_error` are NaN if all bounds are infinite; else they are
    of the time before. `final_rms_error` is NaN where a run diverged before the period `final` and where it is shorter
    than 2 s. Nothing is checked.
    """
    joint = sums.joint[:, 0].astype(np.int64) - 1
    lost = joint >= 0
    counted = np.where(lost, sums.diverged[:, 0] - 1.0, count)
    rms = np.sqrt(sums.squares / np.maximum(counted, 1.0)[:, None])
    last = np.sqrt(sums.final_squares / np.maximum(counted - final, 1.0)[:, None])
    last[(counted <= final) | (count < round(SETTLED / period))] = np.nan
    largest = sums.largest.copy()
    if np.isinf(beyond).all():
        rms[lost], largest[lost] = np.nan, np.nan
    back = np.where(lost | (sums.outside[:, 0] >= count), np.nan, sums.outside[:, 0] * period)
    gone = np.where(lost, counted * period, np.nan)
    summaries = {"rms_error": rms, "largest_error": largest, "final_rms_error": last, "settling_time": back}
    return {name: frozen(x) for name, x in (summaries | {"diverged_at": gone, "diverged_joint": joint}).items()}


TRUTH = "truth"
"""Name of the column of the true values of the parameters that are adapted."""
METRIC = "metric"
"""Name of the column of Gamma^-1, where Gamma is no diagonal: its upper triangle, row by row, with half its diagonal.
To solve with Gamma in each control period takes four times as long as the rest of it."""


class LyapunovRise(NamedTuple):
    """The Lyapunov function V of Slotine and Li's law at the latest control period, and its largest rise so far:
    Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled), or arrays (M, 1) for M arms.
    Nothing is checked.

    `lyapunov` (1,), J, is V = s^T H s/2 plus the adaptation law's distance between estimated and true parameters, at
    the beginning of the period. s is the sliding variable, rad/s (m/s if prismatic), the velocity errors plus bandwidth
    (1/s) times position errors, s^T its transpose, and H the mass matrix. `lyapunov_rise` (1,), J, is its largest rise
    from one period to the next until the run diverged, 0 where it never rose. Both are empty, (0,), where V is not
    known.
    """

    lyapunov: Any
    lyapunov_rise: Any


def rise_sizes(law: SlotineLi | None) -> dict[str, int]:
    """Lengths, by name, of the columns "lyapunov" and "lyapunov_rise", a Lyapunov function V and its largest rise so
    far, J: 1 each, or 0 where `law` is None. `law` is the controller of which V is computed, None where V is not known,
    which `watched` returns. Nothing is raised."""
    known = 0 if law is None else 1
    return LyapunovRise(known, known)._asdict()


def truth_sizes(law: SlotineLi | None) -> dict[str, int]:
    """Lengths, by name, of the constant columns from which a Lyapunov function V is computed, as `first_rise` makes
    them. They are k for "truth", the true values of the k adapted parameters, and k (k + 1)/2 for "metric", the upper
    triangle of the inverse of the adaptation gain, only where the adaptation is gradient descent with a matrix (k, k)
    as gain. `law` is the controller of which V is computed, which `watched` returns; where it is None, as V is not
    known, the dict is empty. Nothing is checked."""
    if law is None:
        return {}
    k = len(law.model.names)
    return {TRUTH: k} | ({METRIC: k * (k + 1) // 2} if _whole_gain(law) is not None else {})


@lru_cache(maxsize=8)  # asked for by every batch of arms
def watched(loop: ClosedLoop, precision: Precision) -> SlotineLi | None:
    """The controller of a closed `loop`, if its Lyapunov function V can be computed in the run from joints, estimate
    and true parameters alone; else None. The answers for the 8 loops used last are kept.

    It can if all of this holds: the controller is Slotine and Li's law itself, without adaptation or with an adaptation
    law whose term of V depends on the estimate alone; the plant has rigid joints and no loads that come and go, and its
    equations of motion are those of the controller's model; no linear constraint fixes parameters; and `precision`,
    that of the run, is "double", not "single", in which rises would be round-off. Nothing is raised.
    """
    law, plant = loop.controller, loop.plant
    if precision == "single":
        return None
    if not isinstance(law, SlotineLi) or not has_sliding_variable(law) or plant.loads or plant.is_elastic:
        return None
    if law.model.mechanism.equations != plant.mechanism.equations or plant.mechanism.equations.has_known_share:
        return None
    start = np.asarray(law.initial)
    known = law.adaptation_law is None or law.adaptation_law.lyapunov_distance(law.model, start, start) is not None
    return law if known else None


def first_rise(
    law: SlotineLi | None, parameters: Array, gains: Mapping[str, Array]
) -> tuple[dict[str, Any], dict[str, Array]]:
    """The initial columns for computing a Lyapunov function V and its largest rise, and its constant columns, two dicts
    by name for M arms. `law` is the controller of which V is computed, which `watched` returns: None where V is not
    known, which gives two empty dicts.

    The first dict has "lyapunov", the largest finite float, from which nothing rises, and "lyapunov_rise", 0.0, the
    same for all arms. The second has "truth" (M, k), the true values of the k adapted parameters in SI units, and,
    where the adaptation is gradient descent with a matrix (k, k) as gain Gamma, "metric" (M, k (k + 1)/2), the upper
    triangle of its inverse, row by row, its diagonal entries halved. `parameters` (M, P) are the P true inertial and
    friction ones, SI units, in the order of `Mechanism.parameter_names`; `gains` has arms' own tunable numbers, (M,
    ...), by name, of which "adaptation.gain" (M, k, k) is read, the controller's where missing. Raises
    `numpy.linalg.LinAlgError` for a gain that is singular.
    """
    if law is None:
        return {}, {}
    # Not by BLAS, whose second thread takes longer to begin than so few products.
    stays = {TRUTH: np.einsum("mp,kp->mk", parameters, law.model.regrouping)}
    if (own := _whole_gain(law)) is not None:
        inverse = np.linalg.inv(gains.get("adaptation.gain", own)) * (1.0 - 0.5 * np.eye(len(own)))
        stays[METRIC] = inverse[(..., *np.triu_indices(len(own)))]
    return LyapunovRise(LARGEST, 0.0)._asdict(), stays


def _whole_gain(law: SlotineLi) -> Array | None:
    """Gamma (k, k) of a law of gradient descent; None where it is a diagonal, and for other laws."""
    own = law.adaptation_law
    return own.gain if isinstance(own, Descent) and own.gain.ndim == 2 else None


def risen(
    loop: ClosedLoop, sample: Sample, point: ReferencePoint, runs: Any, columns: Mapping[str, Column]
) -> LyapunovRise:
    """The `LyapunovRise`, Slotine and Li's Lyapunov function V and its largest rise so far, in J, after one more
    control period of a closed `loop`. It is over Columns, vectors of scalars of any kind (floats, arrays, or symbols to
    be compiled).

    `sample` is the period's record, a `Sample`, `point` the reference in it, columns (r,) of positions, rad (m if
    prismatic), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), of r joints; `runs` is a condition that is
    true until the run diverges, from when on the rise stays. `columns` has by name what `first_rise` gave or the period
    before left, "lyapunov", "lyapunov_rise", "truth" and "metric", and "gains", if any, (g,), the arm's own tunable
    numbers. Where V is not known, the first two are empty and are returned as they are. Raises `KeyError` where a
    column is missing.
    """
    before = LyapunovRise(*(columns[name] for name in LyapunovRise._fields))
    if not len(before.lyapunov):
        return before
    value, rise = _lyapunov(loop, sample, point, columns), before.lyapunov_rise[0]
    larger = maximum(rise, value - before.lyapunov[0])
    return LyapunovRise(Column((value,)), Column((where(runs, larger, rise),)))


def _lyapunov(loop: ClosedLoop, sample: Sample, point: ReferencePoint, columns: Mapping[str, Column]) -> Scalar:
    """V = s'Ms/2 and the adaptation law's term, in J; the first is the kinetic energy of joints that move at s, which
    the adapted parameters tell."""
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
    """error' A error / 2 of a symmetric A, from its upper triangle, row by row, with half its diagonal."""
    rest = iter(triangle)
    rows = (Column(next(rest) for _ in error.of[i:]) @ Column(error.of[i:]) for i in range(len(error)))
    return Column(rows) @ error
