"""Concurrent learning: a bounded stack of samples, learned from again and again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import outlined
from adaptctl.control.adaptation.composite import (
    Filtered,
    TorqueFilter,
    momentum_columns,
    validate_filter,
    validate_predicted,
)
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each, spread, where

LONGEST = 64
"""samples that a stack may have"""


class Stack(NamedTuple):
    """Internal state of concurrent learning between control periods: a stack of N samples, the newest first and zero
    where none is kept yet, and `filtered`, the torque filters' internal state.

    `rows` (N e,) has those e entries of each sample's filtered torque regressor (r, k), k parameters, that are not
    always zero, joint by joint, in N m (N for a prismatic joint) per SI unit of each parameter, one sample after the
    other; `torques` (N r,) each sample's r filtered torques in N m (N); `learned` (1,) is 1 where the last period's
    sample was put on the stack, else 0. Nothing is checked.
    """

    rows: Any
    torques: Any
    learned: Any
    filtered: Filtered

    @property
    def logged_state(self) -> Any:
        """Flag (1,): 1 where the last control period's sample was put on the stack of samples, else 0. It is the field
        `learned`, the part of this internal state that is stored with each sample of a recorded run."""
        return self.learned


@dataclass(frozen=True, eq=False)
class ConcurrentLearning(Descent[Stack]):
    """Concurrent learning of the estimate (k,) of k parameters from a bounded stack of samples j (Chowdhary and Johnson
    2010).

        estimate' = -Gamma (Y' s + sum_j W_j'R (W_j estimate - F[tau]_j))

    s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic joint), tau (r,) the torque in N m (N), Y
    (r, k) the torque regressor, W_j (r, k) that of a sample, behind the filter F = cutoff/(d/dt + cutoff). `gain` is
    Gamma, (k,) its diagonal or (k, k), in units of the parameters squared per J; `weight` is R in 1/(N m s) (m/(N s)),
    one number or (r,), 1 by default; `cutoff` is in rad/s, 20 by default; `samples`, from 1 to 64, 12 by default, is
    how many the stack holds. A prime is the transpose, but on estimate a derivative in time. Raises `InputError` for a
    gain that is not finite, symmetric and positive definite, a weight, cutoff or threshold that is not positive and
    finite (`NonFiniteError` for a weight of NaN), `samples` that are no whole number from 1 to 64, and, with a
    controller, for sizes that do not fit the model, linear constraints on parameters that fix some at values other than
    zero, and a cutoff above 1/T_c, T_c the control period.

    A sample is put on the stack where it tells something new: where its rows differ from those of the sample put there
    last by sum_i R_i d_i'Gamma d_i above `threshold` (1/s, 1 by default), d_i (k,) the difference of row i. It then
    replaces the oldest one, so that what has changed, as with a payload, is forgotten with the samples of before.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: V = s'Ms/2 + error' Gamma^-1 error/2 has the time derivative -s'Ks - sum_j eps_j'R eps_j with eps_j = W_j
    error; where the stack's W_j are of full rank together, under interval excitation, s and the error go to zero
    exponentially, also at rest. Every equation is solved implicitly, one after the other, so that no weight is too
    large for the period.

    Gives up: friction that is no parameter, actuator lag and delay are learned as inertia. The stack is of the recent
    past, not of the best samples, and rates differ as much as the stack is badly conditioned: `CompositeLearning`
    forgets by direction, and has one rate. Costs 4 operations for each entry of the stack.
    """

    tunable = ("gain", "prediction_weight", "cutoff", "novelty_threshold")

    prediction_weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    stack_size: int = 12
    novelty_threshold: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_filter("concurrent learning", self.prediction_weight, self.cutoff)
        if isinstance(self.stack_size, bool) or not isinstance(self.stack_size, int | np.integer):
            raise InputError(f"concurrent learning: samples: expected a whole number, got {self.stack_size!r}")
        if not 1 <= self.stack_size <= LONGEST:
            raise InputError(
                f"concurrent learning: samples: a stack has from 1 to {LONGEST} samples, got {self.stack_size}: "
                f"without "
                "any it is Gradient"
            )
        if not (np.isfinite(self.novelty_threshold) and self.novelty_threshold > 0.0):
            raise InputError(
                f"concurrent learning: threshold: expected a positive number of 1/s, got {self.novelty_threshold}: "
                f"with none, "
                "every period would push an older sample out"
            )

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain for k parameters, one positive weight of prediction errors or
        one for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, and no linear constraint that fixes
        a parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        super().validate(model, initial, control_period)
        validate_predicted("concurrent learning", model, self.prediction_weight, self.cutoff, control_period)

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Stack:
        """The internal state before the first control period, a `Stack`: an empty stack of samples, all zero, and the
        torque filters with zero output, that is, a filtered regressor and filtered torques of zero.

        `initial`, the initial estimate (k,) of k parameters, is not looked at; q (..., n) are the positions of the
        spanning tree's n joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary
        (independent) joints in rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field
        `regressor` then has them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear
        constraints fix parameters at values other than zero; nothing else is checked.
        """
        entries, r = sum(map(len, momentum_columns(model))), model.mechanism.dof
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return Stack(np.zeros(self.stack_size * entries), np.zeros(self.stack_size * r), np.zeros(1), filtered)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Stack) -> tuple[Column, Stack]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the internal state after a control
        period. The period's sample is put on the stack of samples if it differs from the sample put there last by more
        than the law's threshold; then the estimate takes a step for the tracking error (trapezium rule) and an implicit
        one for each equation of the stack.

        `estimate` (k,) and the internal state `memory` are those before the control period that `period` describes.
        That state is, for N samples, those e entries of each one's regressor (r, k) that are not always zero (N e,),
        their filtered torques (N r,) of r joints in N m (N for a prismatic joint), a flag (1,), 1 where the last sample
        was put on the stack, else 0, and the torque filters. Nothing is checked here.
        """
        estimate = estimate - self.applied(period.gradient(period.integral))
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        sample = Column(row[j] for row, places in zip(rows, momentum_columns(model), strict=True) for j in places)
        new = where(self._novelty(model, sample, memory.rows) > self.novelty_threshold, period.dt_ratio, 0.0)
        kept, torques = _pushed(memory.rows, sample, new), _pushed(memory.torques, torque, new)
        for row, measured, weight in self._equations(model, kept, torques):
            estimate = _solved(estimate, self.applied(row), row, Column((measured, weight * period.dt)))
        return estimate, Stack(kept, torques, Column((new,)), filtered)

    def _novelty(self, model: ReducedModel, sample: Column, kept: Column) -> Any:
        """Weighted squared distance between a sample and the newest one kept."""
        apart, total = sample - Column(kept.of[: len(sample)]), 0.0
        for row, weight in _sorted_out(model, apart, each(self.prediction_weight, model.mechanism.dof)):
            total = total + weight * (row @ self.applied(row))
        return total

    def _equations(self, model: ReducedModel, kept: Column, torques: Column) -> Iterator[tuple[Column, Scalar, Scalar]]:
        """Rows (k,), torques and weights of all that is kept."""
        weights, size, r = (
            each(self.prediction_weight, model.mechanism.dof),
            len(kept) // self.stack_size,
            model.mechanism.dof,
        )
        for k in range(self.stack_size):
            measured, block = torques.of[k * r : (k + 1) * r], Column(kept.of[k * size : (k + 1) * size])
            for (row, weight), torque in zip(_sorted_out(model, block, weights), measured, strict=True):
                yield row, torque, weight


def _sorted_out(model: ReducedModel, sample: Column, weights: Column) -> Iterator[tuple[Column, Scalar]]:
    """The rows (k,) of a sample, with their weights."""
    entries = iter(sample)
    for places, weight in zip(momentum_columns(model), weights, strict=True):
        yield spread(Column(next(entries) for _ in places), places, len(model.columns)), weight


def _pushed(stack: Column, sample: Column, new: Any) -> Column:
    """The stack with a sample on top and the oldest one gone, where it is new; else as it was."""
    before = Column((*sample, *stack.of[: len(stack) - len(sample)]))
    return Column(where(new > 0.0, x, y) for x, y in zip(before, stack, strict=True))


def _solve(estimate: Column, loaded: Column, row: Column, equation: Column) -> Column:
    """The estimate after an implicit step for one equation row' x = equation[0] of weight equation[1], `loaded` being
    Gamma times the row."""
    share = equation[1] / (1.0 + equation[1] * (row @ loaded))
    return estimate - (share * (row @ estimate - equation[0])) * loaded


_solved = outlined(_solve)
