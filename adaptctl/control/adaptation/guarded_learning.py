"""Composite learning with guards of its memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, finite_number, frozen_array, per_joint, whole_number
from adaptctl.control.adaptation import (
    external_torque,
    late_torques,
    payload_test,
    restart,
    steady_weight,
    two_stage_filter,
)
from adaptctl.control.adaptation.doubt import (
    CLEAR,
    UNKNOWN,
    TorqueEquations,
    Watch,
    calm,
    coulomb_friction,
    doubted,
    ended,
    equations,
    named,
    remembered,
    touched,
)
from adaptctl.control.adaptation.external_torque import ExternalTorque, Touch
from adaptctl.control.adaptation.guarded_memory import GuardedMemory, memory_of
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.payload_test import PayloadTest
from adaptctl.control.adaptation.recall import MAX_RECALL, RecallingLeastSquares
from adaptctl.control.adaptation.stored import Stored
from adaptctl.control.adaptation.trial_estimate import held, returning, trial_share
from adaptctl.control.adaptation.two_stage_filter import FilteredTwice
from adaptctl.control.pytree import either
from adaptctl.errors import InputError, validate_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, Tunable, column, each, maximum, minimum, where

GRADIENT_SHARE = 0.6
"""share of P with which tracking errors act: with all of it differences of coarse encoders make light arms diverge,
with less it learns later, and a push finds less that is known"""
SETTLING = 2.0
"""time constants of the filters for which a joint has to move before its equation counts"""
TRANSIENT = 0.5
"""s after which the filters show a changed load alone"""


@dataclass(frozen=True, eq=False)
class GuardedLearning(RecallingLeastSquares[GuardedMemory]):
    r"""
    Composite learning that tells its model's errors from payloads and contacts.

    Parameters
    ----------
    gain : array_like
        Diagonal (k,) of the initial gain Gamma, in units of the parameters squared per J. Times 1 J it is taken as the
        prior covariance.
    prediction_weight : array_like, default 1.0
        Weight R of the torque prediction error in 1/(N m s) (m/(N s)), one number or (r,): 1/(sigma^2 1 s) for torques
        that are known within sigma. `learning_law` chooses it.
    cutoff : float, default 10.0
        Corner frequency in rad/s of the two equal low-pass filters of torques and regressor. At 10 velocity noise of
        0.03 rad/s costs little; 20 learns faster.
    forgetting : float, default 0.2
        Rate in 1/s at which the past fades while joints move. At 0.2 the time constant is 5 s.
    recall : float, default 10.0
        Rate rho in 1/s of convergence to the stored information while a joint moves, a hundredth of it at rest, at most
        0.5 divided by the control period. At 10 it is faster than arms move. It is up to twice as high, within that
        limit, the smaller missed torques are against what the weight states.
    min_speed : array_like, default 0.05
        Speed in rad/s (m/s), one number or (r,), below which a joint's equation is not stored, since friction at rest
        says nothing of the model.
    time_limit : float, default 10.0
        Time in s of an undecided change, after which the trial estimate is taken and the memory cleared.
    bound : float, default infinity
        Distance of the estimate from the initial one, in units of the gain's roots times 1 J^(1/2), beyond which the
        memory starts anew from there. `learning_law` chooses it.
    torque_step : array_like, default infinity
        Most by which an update changes a predicted torque in N m (N), one number or (r,), but for a new start.
        `learning_law` takes half of the torque limits.
    delay : int, default 0
        Control periods, 0 to 64, by which torques arrive late. The prediction then uses those that had arrived.
    external_torque : ExternalTorque, optional
        Observer of external torques, which raises a doubt within some hundredths of a second. Default: none.
    trial : bool, default True
        True to follow missed torques with a trial estimate while it doubts, which keeps the arm on its path. False
        holds the trusted estimate, so that a push is not compensated: an impedance always does.

    Raises
    ------
    InputError
        If a number is out of range or a shape is wrong.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math::

        \dot{\hat\beta}=-P\bigl(\tfrac35 Y^\top s+\rho(Q\hat\beta-z)\bigr),\quad P^{-1}=\Gamma^{-1}+Q,

    where Q and z hold :math:`W^\top RW` and :math:`W^\top RF[\tau]` of the past [1]_, after a quarantine of
    0.3 s. Torques that the estimate does not explain raise a doubt: nothing is stored, a trial estimate follows the
    gradient, and ten parameters of the last link are fitted. If they explain the misses, the load is taken; if the
    misses end, the estimate returns. docs/adaptation.md has the proof.

    References
    ----------
    .. [1] Pan and Yu, IEEE Trans. Automatic Control, 2018.

    Examples
    --------
    >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, learning)
    >>> state = controller.init(p, v).law_state
    >>> learning.decision(state)
    'model'
    """

    tunable = (
        "gain",
        "prediction_weight",
        "cutoff",
        "forgetting",
        "recall",
        "min_speed",
        "time_limit",
        "bound",
        "torque_step",
    )
    needs_double = True

    called: ClassVar[str] = "guarded learning"

    cutoff: float = 10.0
    forgetting: float = 0.2
    recall: float = 10.0
    min_speed: ArrayLike = 0.05
    time_limit: float = 10.0
    bound: float = float("inf")
    torque_step: ArrayLike = float("inf")
    delay: int = 0
    external_torque: ExternalTorque | None = None
    trial: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.external_torque is not None:
            validate_kind(self.external_torque, ExternalTorque, "external_torque", "as ExternalTorque() is one")
        if not isinstance(self.trial, bool):
            raise InputError(f"{self.called}: trial: expected True or False, got {self.trial!r}")
        finite_number(self.recall, f"{self.called}: recall")
        finite_number(self.time_limit, f"{self.called}: time_limit")
        object.__setattr__(self, "torque_step", restart.checked(self.called, self.bound, self.torque_step))
        whole_number(self.delay, f"{self.called}: delay in control periods", 0, MAX_DELAY)
        speeds = np.asarray(self.min_speed, dtype=np.float64)
        if not (np.all(np.isfinite(speeds)) and np.all(speeds >= 0.0)):
            raise InputError(f"{self.called}: min_speed: expected finite speeds of at least 0, got {self.min_speed}")
        object.__setattr__(self, "min_speed", frozen_array(speeds, speeds.shape, f"{self.called}: min_speed"))

    @property
    def tunable_parts(self) -> Mapping[str, Tunable]:
        """Observer by the name "external_torque", if there is one."""
        return {} if self.external_torque is None else {"external_torque": self.external_torque}

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if the law does not fit the model and the control period.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        initial : ndarray
            Initial estimate (k,) in SI units.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If a size is wrong, the cutoff or the recall is too high for the control period, or linear constraints fix
            parameters at values other than zero.
        """
        super().validate(model, initial, control_period)
        for name in ("min_speed", "torque_step"):
            per_joint(getattr(self, name), model.mechanism.dof, f"{self.called}: {name}")
        if self.external_torque is not None:
            self.external_torque.validate(control_period)

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> GuardedMemory:
        """
        Return the initial state, an empty memory and torque filters of zero.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        initial : ndarray
            Initial estimate (k,) in SI units.
        q, v : ndarray
            Positions (..., n) in rad (m) of the n joints of the spanning tree, and velocities (..., r) of the primary
            joints in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        GuardedMemory
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        given = self.cutoff, control_period, self.external_torque, self.delay
        return GuardedMemory.empty(model, initial, (q, v), *given)

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """Squared parameter error over twice what acts of the initial gain, J; over P, as in the proof, it is more."""
        error = estimate - true
        return (0.5 / GRADIENT_SHARE) * (error @ Column(e / g for e, g in zip(error, column(self.gain), strict=True)))

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: GuardedMemory
    ) -> tuple[Column, GuardedMemory]:
        """
        Update the estimate, the memory and the decision by one control period.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : GuardedMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and GuardedMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        period, sent = late_torques.arrived(period, memory.sent)
        memory, watch = memory._replace(sent=sent), memory.watch
        prediction = two_stage_filter.predicted(model, period, memory.filtered, self.cutoff)
        r, scale = len(prediction.rows), self._scale
        speeds, weights = each(self.min_speed, r), each(self.prediction_weight, r)
        sample = equations(prediction, period, watch, scale, weights, (speeds, SETTLING / self.cutoff))
        slope, x = scale * period.gradient(period.integral), Column(a / b for a, b in zip(estimate, scale, strict=True))
        observer = self.external_torque
        fast = None if observer is None else external_torque.predicted(observer, model, period, memory.touch)
        alarmed, stored = watch.alarm[0] > 0.0, memory.stored
        faster = minimum(self.recall, MAX_RECALL / period.period - self.recall)
        rates = self.forgetting, self.recall + faster * calm(watch.noise, weights)
        flow = stored.flow(period, alarmed, reduce(maximum, sample.counts), rates)
        shares = where(alarmed, 0.0, period.dt) * (sample.counts * sample.weights)
        at, beside = (x, GRADIENT_SHARE * slope), [] if fast is None else [scale * row for row in fast.rows]
        stored, step, unsure = stored.stepped(flow, sample.units, sample.torque, shares, at, beside)
        felt = watch.trusted, Column(unsure.of[r:]), weights, watch.alarm[0]
        touch = external_torque.felt(observer, fast, felt, period, list(speeds), memory.touch)
        back = returning(watch.doubt, period.period) if self.trial else held(period.period)
        trial = back * (estimate - watch.trusted)
        if self.trial:
            trial = (trial_share(sample, watch) * self._scale) * slope + trial
        after = estimate - either(watch.alarm[0] > 0.0, trial, self._scale * step)
        unsure = Column(unsure.of[: len(sample.rows)])
        after, found = self._decided(model, after, stored, sample, unsure, period, memory, prediction.after, touch)
        after = restart.stepped(estimate, after, sample.rows, each(self.torque_step, r))
        return restart.bounded(self.bound, self._scale, after, found, watch.decision[0])

    def _decided(
        self, model: ReducedModel, after: Column, stored: Stored, sample: TorqueEquations, unsure: Column,
        period: Period, memory: GuardedMemory, filtered: FilteredTwice, touch: Any,
    ) -> tuple[Column, GuardedMemory]:  # fmt: skip
        """Estimate and state after what the missed torques are taken for."""
        watch, T = memory.watch, period.period
        noise, doubt, age = doubted(sample, unsure, period, watch, coulomb_friction(model, watch.trusted))
        if isinstance(touch, Touch):
            doubt = touched(doubt, external_torque.beyond(touch), age)
        going = where(watch.alarm[0] > TRANSIENT, 1.0, 0.0)
        shares = (going * period.dt) * (sample.counts * sample.weights)
        step = payload_test.JudgedPeriod(T, going, watch.announced[0], sample.weights, watch.trusted, period.damping)
        test = PayloadTest(model, column(self.gain))
        weighed, weight = steady_weight.predicted(model, period, memory.weight, self.cutoff)
        verdict = test.judged(sample.rows, weighed, sample.missed, shares, watch.noise, memory.sums, step)
        end = ended(watch, doubt, verdict.payload, self.time_limit, T)
        still = end.alarm > 0.0
        trusted = watch.trusted + verdict.payload * verdict.change
        after = either(end.cleared > 0.5, trusted, after)
        trusted = either(still, trusted, after)
        # What is remembered of another load, or of what was never explained, is useless.
        stored = stored.cleared(1.0 - maximum(verdict.payload, end.late), where(still, 0.0, 1.0))
        before = watch.decision[0]
        decision = where(still, named(verdict.payload, verdict.contact, before), remembered(before, age))
        young = (1.0 - verdict.payload) * age  # what a short fit leaves open would pass for a push
        states = (young, end.alarm, where(still, watch.announced[0], 0.0), decision)
        doubts = Column(where(still, x, 0.0) for x in doubt)
        watch = Watch(trusted, noise, doubts, sample.moving, *(Column((x,)) for x in states))
        sums = verdict.after.cleared(1.0 - verdict.payload)
        return after, GuardedMemory(stored, filtered, watch, sums, weight, touch, memory.sent, memory.prior)

    def decision(self, memory: GuardedMemory) -> str:
        """
        Return what the law takes the missed torques for.

        Parameters
        ----------
        memory : GuardedMemory
            Internal state of one arm.

        Returns
        -------
        str
            "model" if it learns, "unknown" if it does not know yet, "payload" for 2 s of motion after a changed load,
            "contact" while torques are missed that a constant push explains and a payload does not, "restarted"
            for 2 s of motion after the estimate was beyond its bound.

        Raises
        ------
        ValueError
            If the state is of several arms.

        Examples
        --------
        >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
        >>> learning.decision(adaptctl.SlotineLi(model, 5.0, 4.0, learning).init(p, v).law_state)
        'model'
        """
        return ("model", "unknown", "payload", "contact", "restarted")[int(memory_of(memory).watch.decision.item())]

    def expect_payload(self, memory: GuardedMemory) -> GuardedMemory:
        """
        Announce that the load of the last link changes now, as a gripper does.

        Parameters
        ----------
        memory : GuardedMemory
            Internal state.

        Returns
        -------
        GuardedMemory
            State in which missed torques are taken for a payload without a comparison with a contact.

        Examples
        --------
        >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
        >>> state = adaptctl.SlotineLi(model, 5.0, 4.0, learning).init(p, v).law_state
        >>> learning.decision(learning.expect_payload(state))
        'unknown'
        """
        watch = memory_of(memory).watch
        one, doubt = np.ones_like(watch.alarm), np.full_like(watch.doubt, CLEAR)
        alarm = np.maximum(watch.alarm, 1e-3)
        return memory._replace(watch=watch._replace(announced=one, doubt=doubt, alarm=alarm, decision=UNKNOWN * one))

    def skip_period(self, memory: GuardedMemory) -> GuardedMemory:
        """
        Tell that the last control period was not on time.

        Parameters
        ----------
        memory : GuardedMemory
            Internal state.

        Returns
        -------
        GuardedMemory
            State that stores nothing before the filters, which assume equal periods, have settled again.

        Examples
        --------
        >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
        >>> state = adaptctl.SlotineLi(model, 5.0, 4.0, learning).init(p, v).law_state
        >>> learning.skip_period(state).watch.moving
        array([0., 0.])
        """
        watch = memory_of(memory).watch
        return memory._replace(watch=watch._replace(moving=np.zeros_like(watch.moving)))

    def covariance(self, memory: GuardedMemory) -> Array:
        """
        Return the present adaptation gain.

        Parameters
        ----------
        memory : GuardedMemory
            Internal state of one arm.

        Returns
        -------
        ndarray
            Covariance P (k, k) in units of the parameters squared per J.

        Raises
        ------
        ValueError
            If the state is of several arms.

        Examples
        --------
        >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
        >>> learning.covariance(adaptctl.SlotineLi(model, 5.0, 4.0, learning).init(p, v).law_state).diagonal()
        array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
        """
        return self._covariance(memory_of(memory).stored.remembered)
