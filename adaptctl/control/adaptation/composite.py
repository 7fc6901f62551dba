"""Composite adaptation: tracking error and torque prediction error together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number, positive_numbers, positive_per_joint, stacked
from adaptctl.compilation import trace
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, each, spread
from adaptctl.scalars.column import combined


class Filtered(NamedTuple):
    """Internal state of the torque filters between control periods. `regressor` (e,) has the filters' states for those
    e entries of the torque regressor (r, k), k parameters, that are not always zero, joint by joint, in N m (N for a
    prismatic joint) per SI unit of each parameter; `torque` (r,) are the filtered torques of r joints in N m (N).
    Nothing is checked."""

    regressor: Any
    """rows of F[lambda H + N], as far as it is known before the next sample, without what is always zero"""
    torque: Any


class Prediction(NamedTuple):
    """A prediction of filtered torques: the linear equation W beta = torque, which the true parameters beta (k,), in SI
    units, fulfil as far as nothing disturbs.

    `rows` are the r rows (k,) of W, the filtered torque regressor of r joints, in N m (N for a prismatic joint) per
    unit of each of k parameters, `torque` (r,) the filtered torques in N m (N), `after`, a `Filtered`, the filters'
    internal state after the control period. Nothing is checked.
    """

    rows: list[Column]
    torque: Column
    after: Filtered


@dataclass(frozen=True)
class TorqueFilter:
    """First-order low-pass filter F = lambda/(d/dt + lambda) of both sides of the equations of motion tau = Y(p, v, a)
    beta. It gives the filtered torque regressor W = F[Y] without accelerations a (Slotine and Li 1989). `cutoff` is
    lambda in rad/s, `period` the control period T_c in s. Nothing is checked at construction.

    tau (r,) is the torque of r joints, Y (r, k) the torque regressor at positions p and velocities v, beta (k,) are the
    k parameters. With tau = d/dt (H beta) - N beta, H (r, k) the momenta's regressor and N (r, k) that of all
    generalised forces but tau, W = lambda H - F[lambda H + N] when F[H] starts at H: positions and velocities are
    enough. The torque is held over each period, for which its filter is exact; lambda H + N goes in by the trapezium
    between samples, with an error of the order of T_c^2.
    """

    cutoff: float
    control_period: float

    def start(self, model: ReducedModel, q: Array | Column, v: Array | Column) -> Filtered:
        """The internal state of the torque filters before the first control period, a `Filtered`, from which the
        filtered torque regressor W (r, k) and the filtered torques (r,) of the r joints begin at zero.

        q (..., n) are the positions of the spanning tree's n joints in rad (m for a prismatic joint), v (..., r) the
        velocities of the r primary (independent) ones in rad/s (m/s), arrays or columns, at which the `model`, of k
        parameters, starts. The state's field `regressor` has one number for each of the e entries of W that are not
        always zero, N m (N) per SI unit of the parameter: (..., e), or a `Column` of e scalars where q is one. Its
        field `torque` (r,), in N m (N), is zero. Raises `InputError` for a model whose linear constraints fix
        parameters at values other than zero: torques of these have no column in W.
        """
        momentum, forces = momentum_terms(model.mechanism.equations, column(q), column(v), model.columns)
        kept: list[Any] = []
        for row, change, places in zip(momentum, forces, momentum_columns(model), strict=True):
            scaled = self.cutoff * row
            first = scaled - self._new * (scaled + change)
            kept += [first[j] for j in places]
        first_rows = Column(kept) if isinstance(q, Column) else stacked(kept, q.shape[:-1])
        return Filtered(first_rows, np.zeros(model.mechanism.dof))

    def predicted(self, model: ReducedModel, period: Period, memory: Filtered) -> Prediction:
        """The linear equation W beta = torque for the `model`'s k parameters beta at the end of a control period, a
        `Prediction`. W (r, k) is the filtered torque regressor of r joints, from positions and velocities at the
        period's end, and torque (r,) the filtered torque, N m (N for a prismatic joint), from that held over the
        period.

        `period`, a `Period`, has these data; `memory` is the filters' internal state before it. Raises `InputError` for
        a mechanism whose linear constraints fix parameters at values other than zero.
        """
        momentum, forces = momentum_terms(model.mechanism.equations, period.q, period.v, model.columns)
        k, keep, last = len(model.columns), self._keep, iter(memory.regressor)
        rows: list[Column] = []
        before: list[Any] = []
        for row, change, places in zip(momentum, forces, momentum_columns(model), strict=True):
            scaled = self.cutoff * row
            now = scaled + change
            filtered = spread(Column(next(last) + self._new * now[j] for j in places), places, k)
            rows.append(scaled - filtered)
            before += [keep * filtered[j] + self._old * now[j] for j in places]
        torque = keep * memory.torque + (1.0 - keep) * period.torque
        return Prediction(rows, torque, Filtered(Column(before), torque))

    @property
    def _keep(self) -> Any:
        """Share of a filter's state that is left after a period."""
        return decayed(self.cutoff * self.control_period)[0]

    @property
    def _new(self) -> Any:
        """Weight of a linear input's value at the end of a period."""
        return 1.0 - decayed(self.cutoff * self.control_period)[1]

    @property
    def _old(self) -> Any:
        """Weight of its value at the start."""
        return 1.0 - self._keep - self._new


def decayed(x: Any) -> tuple[Any, Any]:
    """Two scalars of a scalar x without a unit, 0 < x <= 1, of any kind: exp(-x), and (1 - exp(-x))/x, the mean of
    exp(-u) over u from 0 to x. Both are right to a double's round-off; beyond that range, which is not checked, they
    are less exact.

    They come from the Pade approximant of order (5, 5) at x/4, doubling x twice.
    """
    y = 0.25 * x
    square = y * y
    odd = 15120.0 + square * (420.0 + square)
    even = 30240.0 + square * (3360.0 + 30.0 * square)
    below = 1.0 / (even + y * odd)
    left, mean = (even - y * odd) * below, (2.0 * odd) * below
    for _ in range(2):
        left, mean = left * left, (0.5 * mean) * (1.0 + left)
    return left, mean


@lru_cache(maxsize=64)
def momentum_columns(model: ReducedModel) -> list[list[int]]:
    """Lists of indices, from 0, among the `model`'s k parameters, one list for each of its mechanism's r joints: the
    parameters on which the joint's filtered torque ever depends. In a tree these are the parameters of the links that
    the joint moves, and of its own drive. Raises `InputError` for a mechanism whose linear constraints fix parameters
    at values other than zero."""
    equations, r = model.mechanism.equations, model.mechanism.dof

    def terms(q: Column, v: Column) -> list[Column]:
        return [row + change for row, change in zip(*momentum_terms(equations, q, v, model.columns), strict=True)]

    k, entries = len(model.columns), trace(terms, {"q": equations.joints, "v": r}).outputs
    always_zero = [isinstance(x, float) and x == 0.0 for x in entries]
    return [[j for j in range(k) if not always_zero[k * i + j]] for i in range(r)]


def validate_filter(law: str, weight: ArrayLike, cutoff: float) -> None:
    """Raise `InputError` unless the `cutoff` of a torque filter, in rad/s, and the `weight` of its prediction errors,
    one number or one a joint, are positive and finite. `law` is the adaptation law's name in messages."""
    positive_number(cutoff, "torque filter: cutoff: expected a positive number in rad/s")
    positive_numbers(weight, f"{law}: weight")


def validate_cutoff(cutoff: float, control_period: float) -> None:
    """Raise `InputError` unless the `cutoff` of a torque filter, in rad/s, is positive and finite, and times the
    control `period` in s at most 1, without a unit."""
    positive_number(cutoff, "torque filter: cutoff: expected a positive number in rad/s")
    if cutoff * control_period > 1.0:
        raise InputError(
            f"torque filter: cutoff: {cutoff:g} rad/s is too fast for a control period of {control_period:g} s; "
            f"use at most {1.0 / control_period:g} rad/s"
        )


def validate_predicted(law: str, model: ReducedModel, weight: ArrayLike, cutoff: float, control_period: float) -> None:
    """Raise `InputError` unless filtered torques of a `model` of r joints can be predicted in each control `period`, s:
    the `weight` is one number or (r,), the `cutoff`, rad/s, times the period at most 1, and no linear constraint fixes
    a parameter of the mechanism at a value other than zero. The torque of such a parameter is known and has no column
    in the regressor. The message begins with `law`, the adaptation law's name."""
    mechanism = model.mechanism
    positive_per_joint(weight, mechanism.dof, f"{law}: weight")
    validate_cutoff(cutoff, control_period)
    if mechanism.equations.has_known_share:
        fixed = mechanism.with_parameters(np.zeros(len(mechanism.parameter_names))).description
        pairs = zip(fixed.parameter_names, fixed.inertial_parameters.tolist(), strict=True)
        raise InputError(
            f"{law}: {mechanism.name}: constraints fix values other than zero, which torques without accelerations "
            f"cannot be predicted with: {', '.join(f'{name} ({value:g})' for name, value in pairs if value)}: leave "
            "these constraints out, or adapt by the tracking error alone, as Gradient does"
        )


@dataclass(frozen=True, eq=False)
class Composite(Descent[Filtered]):
    """Composite adaptation of the estimate (k,) of k parameters, by the tracking and the prediction error (Slotine and
    Li 1989).

        estimate' = -Gamma (Y' s + W'R (W estimate - F[tau]))

    s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic joint), tau (r,) the torque in N m (N), Y
    (r, k) the torque regressor, W (r, k) that behind the filter F = lambda/(d/dt + lambda), from positions and
    velocities alone. `gain` is Gamma, (k,) its diagonal or (k, k), in units of the parameters squared per J; `weight`
    is R's diagonal, one number or (r,), in 1/(N m s) (m/(N s)); `cutoff` is lambda in rad/s. A prime is the transpose,
    but on estimate a derivative in time. Raises `InputError` at construction for a gain that is not finite, symmetric
    and positive definite, and a weight or cutoff that is not positive and finite (a weight of NaN is a
    `NonFiniteError`), and, with a controller, for sizes that do not fit the model, linear constraints on parameters
    that fix some at values other than zero, and a cutoff above 1/T_c, T_c the control period.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: with the prediction error eps = W error, V = s'Ms/2 + error' Gamma^-1 error/2 has the time derivative
    -s'Ks - eps'R eps: s and eps go to zero, and under persistent excitation s and the error go to zero exponentially.
    Sampled, the step for the prediction error is solved implicitly, so that no weight is too large for the period.

    Gives up: the torque that is commanded must be the torque that acts: friction that is no parameter, actuator lag and
    delay are learned as inertia. Noise of velocities enters W with the gain lambda, and pulls the estimate to zero
    along what is little excited: choose lambda about as fast as the motion. Without excitation the estimate drifts
    under disturbance along what W does not see. Costs the evaluation of the momenta's regressor and r filters for each
    parameter.
    """

    tunable = ("gain", "prediction_weight", "cutoff")

    prediction_weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_filter("composite", self.prediction_weight, self.cutoff)

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain for k parameters, one positive weight of prediction errors or
        one for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, and no linear constraint that fixes
        a parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        super().validate(model, initial, control_period)
        validate_predicted("composite", model, self.prediction_weight, self.cutoff, control_period)

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Filtered:
        """The internal state before the first control period, a `Filtered`: the torque filters with zero output, that
        is, a filtered regressor and filtered torques of zero.

        `initial`, the initial estimate (k,) of k parameters, is not looked at; q (..., n) are the positions of the
        spanning tree's n joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary
        (independent) joints in rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field
        `regressor` then has them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear
        constraints fix parameters at values other than zero; nothing else is checked.
        """
        return TorqueFilter(self.cutoff, control_period).start(model, q, v)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Filtered) -> tuple[Column, Filtered]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the torque filters' internal state
        after a control period. The estimate takes a step for the tracking error (trapezium rule), then an implicit one
        for the prediction error.

        `estimate` (k,) and `memory`, the torque filters' internal state, are those before the control period that
        `period` describes. Nothing is checked here.
        """
        moved = estimate - self.applied(period.gradient(period.integral))
        rows, torque, after = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory)
        loaded = [self.applied(row) for row in rows]
        firm = Column(1.0 / (weight * period.period) for weight in each(self.prediction_weight, model.mechanism.dof))
        force = solve_symmetric(_products(rows, loaded, firm), residual(rows, moved, torque))
        return moved - period.dt_ratio * combined(loaded, force), after


def residual(rows: list[Column], estimate: Column, torque: Column) -> Column:
    """The prediction error W estimate - torque (r,) of r joints, in N m (N for a prismatic joint): predicted less
    filtered torques. `rows` are the r rows (k,) of the filtered torque regressor W, in N m (N) per unit of each of k
    parameters, `estimate` (k,) is in SI units, `torque` (r,) are the filtered torques in N m (N). Raises `ValueError`
    for columns of other lengths."""
    return Column(row @ estimate for row in rows) - torque


def _products(rows: list[Column], loaded: list[Column], firm: Column) -> list[list[Scalar]]:
    """W Gamma W' + (R T_c)^-1 (r, r), each entry of the symmetric matrix once."""
    r = len(rows)
    lower = [[rows[i] @ loaded[j] for j in range(i + 1)] for i in range(r)]
    for i in range(r):
        lower[i][i] = lower[i][i] + firm[i]
    return [[lower[max(i, j)][min(i, j)] for j in range(r)] for i in range(r)]
