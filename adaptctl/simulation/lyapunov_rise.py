"""The largest rise of the Lyapunov function, found while a run goes on, so that no sample has to be kept."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.lanes import Precision
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.controller import GAINS, ReferencePoint
from adaptctl.control.lyapunov import has_sliding_variable
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.scalars import Column, Scalar, column, maximum, where
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.error_sums import LARGEST

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
    """(1,) J, V itself"""
    lyapunov_rise: Any
    """(1,) J, its largest rise from one tick to the next, 0 where it never rose"""


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


@lru_cache(maxsize=8)  # asked for by every herd of arms
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
    known = law.adaptation_law is None or law.adaptation_law.distance(law.model, start, start) is not None
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
