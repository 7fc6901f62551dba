"""Choice of reference and gains."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, whole_count
from adaptctl.caching import cached_property
from adaptctl.control import Gains, Gradient, GuardedLearning, SlotineLi, mapped_gain
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, VerdictError, validate_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Integrator, Plant
from adaptctl.simulation.effects.effect import Effect
from adaptctl.simulation.effects.plant_effects import listed
from adaptctl.simulation.integrator import MAX_EXPLICIT_SUBSTEPS
from adaptctl.tuning.default_gains import (
    DEFAULT_BANDWIDTH,
    DEFAULT_SAMPLING_RATIO,
    DefaultGains,
    Proposal,
    Shares,
    at_most,
    near_reference,
)
from adaptctl.tuning.feasible_gains import MIN_BANDWIDTH, FeasibleGains, assumed_limits, limitations, yielding_note
from adaptctl.tuning.feasible_reference import TORQUE_SHARE, FeasibleReference
from adaptctl.tuning.learning_rule import MAX_LEARNED, learning_by_rule, slotine_li
from adaptctl.tuning.open_parameters import open_note
from adaptctl.tuning.rotors import rotor_note
from adaptctl.tuning.stated_effects import Held, Rates, gradient_run, held, late_share, plant_with, remedy
from adaptctl.tuning.verification import (
    LINK_ERROR,
    MAX_ERROR,
    MAX_LIMITED_SHARE,
    Trials,
    TrialSetting,
    Verification,
    base_model,
    delay_of,
    holds,
    measures,
    scaled_links,
)

MAX_STATIC_SHARE = 0.95  # of a torque limit at rest, above which a joint can only creep
SEARCH_DURATION = 8.0  # s
SEARCHED_BANDWIDTHS, SEARCHED_SAMPLING_RATIOS, SEARCHED_ADAPTATION_RATIOS = (
    (4.0, 8.0),
    (0.25, 0.5),
    (0.1, 0.2, 0.4, 0.8),
)
SEARCHED_SHARES: tuple[Shares, ...] = ("mixed", "links", "parameters")


@dataclass(frozen=True, eq=False)
class Tuning:
    """
    Reference, gains and integration that `tune` chose.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    control_period : float
        Time in s for which a torque is held.
    reference : Reference
        Trajectory to follow.
    initial_error : ndarray
        Arm's position minus the reference's at time 0, (r,) in rad (m).
    gains : Gains
        Bandwidth (r,) in 1/s and damping (r,) in N m s/rad (N s/m).
    adaptation : ndarray
        Diagonal (P,) of the adaptation gain on all parameters, in their units squared per J.
    substeps : int
        Integration steps in a control period.
    integrator : Integrator
        Integrator of the simulation.
    torque_limits : ndarray
        Torque limits (r,) in N m (N).
    torque_share : ndarray
        Ratio (r,) of the reference's largest torque to its limit.
    sampling_ratio : float
        Greatest T lambda_max(M^-1 K) without a unit at 1,200 positions near the reference (400 above 10 joints) for
        which the gains were not chosen: mass matrix M, corrected for viscous friction as in
        `adaptctl.control.sampling_ratio`, and damping K; stable below 2.
    adaptation_ratio : float
        Greatest T lambda_max(K^-1 Y Gamma Y') without a unit there, regressor Y and gain Gamma, stable below 2.
    limited_by : tuple of str
        Limit of each joint's gains in words, r of them, such as the sampling or the torque.
    verified : tuple of Verification
        Results of simulated runs with these gains, the nominal one first; empty for a mechanism of more than 100 links.
    notes : tuple of str
        Sentences for the user, such as on a load beyond the torque limits.
    effects : tuple of Effect
        Stated effects of the robot, which the verified runs have.

    Examples
    --------
    >>> tuning = adaptctl.tune(arm, control_period=0.004)
    >>> tuning.is_learning, tuning.gains.damping.shape
    (True, (2,))
    >>> tuning.controller(model).control_period
    0.004
    """

    mechanism: Mechanism
    control_period: float
    reference: Reference
    initial_error: Array
    gains: Gains
    adaptation: Array
    substeps: int
    integrator: Integrator
    torque_limits: Array
    torque_share: Array
    sampling_ratio: float
    adaptation_ratio: float
    limited_by: tuple[str, ...]
    verified: tuple[Verification, ...]
    notes: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()

    def __repr__(self) -> str:
        verdict = "learns" if self.is_learning else "does not learn" if self.failed else "not verified"
        return f"<Tuning of {self.mechanism.name!r}: {verdict}>"

    def adaptation_gain_for(self, model: ReducedModel) -> Array:
        """
        Return the adaptation gain for the parameters of a reduced model.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.

        Returns
        -------
        ndarray
            Gain (k, k) in units of the parameters squared per J, with which the k parameters adapt as all P would.

        Raises
        ------
        InputError
            If the model is of another number of parameters.

        Examples
        --------
        >>> adaptctl.tune(arm, control_period=0.004).adaptation_gain_for(model).shape
        (6, 6)
        """
        return mapped_gain(model, self.adaptation)

    @cached_property
    def workspace(self) -> Workspace:
        """Positions near the reference, for which gains are checked."""
        return near_reference(self.mechanism, self.reference, self.initial_error)

    def controller(self, model: ReducedModel, adaptation: bool | str = True, *, anyway: bool = False) -> SlotineLi:
        """
        Return Slotine and Li's controller with these gains.

        Parameters
        ----------
        model : ReducedModel
            Model of the mechanism. The default law needs the friction of the arm in it, as by `with_friction`.
        adaptation : bool or str, default True
            True for the default: "learning", the law of `learning_law`, and above 100 parameters "gradient", which is
            for small processors and theorems. False to switch adaptation off, for a comparison.
        anyway : bool, default False
            True to accept gains that failed in simulation.

        Returns
        -------
        SlotineLi
            Controller with an initial estimate of zero.

        Raises
        ------
        VerdictError
            If the arm does not learn with these gains in the nominal simulation.
        GainError
            If the gains are too large for the control period in the workspace.
        InputError
            If the model is of another number of joints or parameters, or the adaptation has another name.

        Examples
        --------
        >>> tuning = adaptctl.tune(arm)
        >>> tuning.controller(model).adaptation.called, tuning.controller(model, "gradient").adaptation.gain.shape
        ('guarded learning', (6, 6))
        """
        validate_kind(model, ReducedModel, "controller", "as ReducedModel(mechanism) is one")
        if adaptation and not anyway:
            self.validate_learning("anyway=True")
        if adaptation == "gradient" and not anyway:
            self._validate_gradient()
        law, gains = self._adaptation(model, adaptation), self.gains
        given = None, self.control_period, self.workspace, self.torque_limits
        return slotine_li(model, gains.bandwidth, gains.damping, law, *given)

    def _adaptation(self, model: ReducedModel, named: bool | str) -> Gradient | GuardedLearning | None:
        if named is False:
            return None
        gain = self.adaptation_gain_for(model)
        if named == "gradient" or (named is True and len(gain) > MAX_LEARNED):
            return Gradient(gain, delay=self.delay)
        if named is True or named == "learning":
            given = self.torque_limits, self.gains.damping, self.control_period, self.reference
            return learning_by_rule(model, gain, *given, self.delay)
        raise InputError(f"adaptation: expected True, False, 'learning' or 'gradient', got {named!r}")

    @property
    def delay(self) -> int:
        """Control periods of a stated delay, at most 64."""
        return delay_of(self.effects)

    @cached_property
    def _trials(self) -> Trials:
        plant = plant_with(self.mechanism, self.control_period, self.torque_limits, self.effects)
        return Trials(plant, self.reference, self.initial_error)

    def _validate_gradient(self) -> None:
        """Raise `VerdictError` if the gradient does not hold with the stated effects, of which no run has told."""
        if not (self.effects and self._trials.possible):
            return
        run = gradient_run(self._trials, self.gains, self.adaptation)
        if not holds(run):
            raise VerdictError(
                f"{self.mechanism.name}: the gradient fails with these effects ({run}): take the default law, or "
                "the gradient anyway with anyway=True"
            )

    @property
    def is_learning(self) -> bool:
        """True if adaptation reduces the tracking error in the first verification run."""
        return bool(self.verified) and self.verified[0].is_learning

    @property
    def failed(self) -> bool:
        """True if adaptation does not reduce the tracking error in the first verification run."""
        return bool(self.verified) and not self.verified[0].is_learning

    def validate_learning(self, otherwise: str) -> None:
        """
        Raise `VerdictError` if the tuning has failed.

        Parameters
        ----------
        otherwise : str
            How to take the gains all the same, for the message.

        Raises
        ------
        VerdictError
            If the simulated arm does not learn.
        """
        if self.failed:
            raise VerdictError(
                f"{self.mechanism.name}: these gains fail in simulation ({self.verified[0]}): "
                f"{remedy(self._trials, self.gains)}, or use them anyway with {otherwise}"
            )


def tune(
    mechanism: Mechanism,
    *,
    control_period: float = 1e-3,
    reference: Reference | None = None,
    initial_error: ArrayLike | None = None,
    bandwidth: float = DEFAULT_BANDWIDTH,
    sampling_ratio: float = DEFAULT_SAMPLING_RATIO,
    adaptation_ratio: float = 0.5,
    search: int = 0,
    seed: int = 0,
    effects: Iterable[Effect] = (),
    nominal_only: bool = False,
) -> Tuning:
    """
    Choose a reference and gains for a robot and verify them in closed loop.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints. Effort limits bound the torques; without limits the gains come from inertia alone.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    reference : Reference, optional
        Trajectory to follow. Unless given, sinusoids within 60 % of the torque limits are drawn.
    initial_error : array_like, optional
        Arm's position minus the reference's at time 0 in rad (m), one number or (r,). Unless given, 0.1, or less where
        a range or torque limit is small.
    bandwidth : float, default 4.0
        Greatest bandwidth in 1/s. A joint has less if 0.3 of its torque limit corrects the initial error no faster. At
        4 errors decay to 2 % within a second.
    sampling_ratio : float, default 0.5
        Bound without a unit of T lambda_max(M^-1 K) along the reference, control period T, mass matrix M, corrected
        for viscous friction, and damping K. 0.5 is a third of what is allowed, a margin for errors of the model.
    adaptation_ratio : float, default 0.5
        Value without a unit of T lambda_max(K^-1 Y Gamma Y') along the reference, regressor Y and adaptation gain
        Gamma. 0.5 is a quarter of the limit of stability.
    search : int, default 0
        Other settings, of a grid of 48, that are tried on arms with links 30 % lighter or heavier. Zero keeps the
        rules' choice, without their computing time.
    seed : int, default 0
        Seed of all random choices. Fixed, so that a tuning can be repeated.
    effects : iterable of Effect, optional
        What the robot is known to have, such as `ControlDelay(2)`, `Encoder(resolution)` with `FilteredDifferences`,
        or `ElasticJoints`. The verified runs have these, and gains are lowered until they hold; the law is told of a
        delay. Default: torques on time, exact measurements and rigid joints.
    nominal_only : bool, default False
        True to verify by the nominal run alone, which takes a quarter of the time, unless there are effects. By
        default also with a delay and with other links, which tells margins but changes no choice.

    Returns
    -------
    Tuning
        Reference, gains, and the verdict of simulated runs.

    Raises
    ------
    InputError
        If a number is not positive or too large (control_period 0.1, bandwidth 1000, sampling_ratio 1.5,
        adaptation_ratio 1), a joint moves nothing with inertia, or the mass matrix is not positive definite.
    NonFiniteError
        If the reference is not finite.
    SingularityError
        If kinematic loops cannot be closed at the reference's start.

    Notes
    -----
    The rules are in docs/tuning.md. Mechanisms above 100 links are neither searched nor verified.

    Examples
    --------
    >>> adaptctl.tune(arm, control_period=0.004, bandwidth=3.0).gains.bandwidth
    array([3., 3.])
    """
    asked = Rates(at_most("bandwidth", bandwidth, 1e3), *_ratios(sampling_ratio, adaptation_ratio))
    search, effects = whole_count(search, "search"), tuple(listed(effects))
    rule = DefaultGains.for_mechanism(
        mechanism, control_period=control_period, reference=reference, initial_error=initial_error, seed=seed
    )
    asked = asked.lowered(late_share(delay_of(effects)), rule.control_period)
    first, limits = rule.proposed(*asked, "mixed"), rule.limits
    plant = plant_with(mechanism, rule.control_period, limits, effects)
    trials = Trials(plant, rule.reference, rule.initial_error, nominal_only and not effects)
    first = _searched(trials, rule, first, search, seed) if search and trials.possible else first
    model = base_model(mechanism) if trials.possible else None
    found = Held(first, ()) if model is None else held(trials, model, rule, asked, first, seed)
    chosen, verified = found.proposal, found.verified
    carried = chosen.feasible
    return Tuning(
        mechanism,
        rule.control_period,
        rule.reference,
        rule.initial_error,
        carried.gains,
        chosen.gain,
        plant.substeps,
        plant.integrator,
        limits,
        rule.found.asked,
        *rule.achieved(chosen),
        limitations(mechanism, carried),
        verified,
        (*_notes(mechanism, rule.found, carried, plant), *_run_remarks(model, rule), *found.notes),
        effects,
    )


def _ratios(sampling_ratio: float, adaptation_ratio: float) -> tuple[float, float]:
    return at_most("sampling_ratio", sampling_ratio, 1.5), at_most("adaptation_ratio", adaptation_ratio, 1.0)


def _searched(trials: Trials, rule: DefaultGains, first: Proposal, count: int, seed: int) -> Proposal:
    """Best proposal by the worse of two runs with other links, one delayed."""
    tried = [first, *_drawn(rule, count, seed)]
    arms = [scaled_links(trials.plant.mechanism, LINK_ERROR, seed + k) for k in (1, 2)]
    settings = [
        TrialSetting(one.feasible.gains.bandwidth, one.feasible.gains.damping, one.gain, true, late)
        for one in tried
        for true, late in zip(arms, (False, True), strict=True)
    ]
    runs = trials.run(settings, SEARCH_DURATION)
    _, last, largest, limited = measures(runs, np.asarray(trials.plant.torque_limits))
    failed = (largest >= MAX_ERROR) | (limited > MAX_LIMITED_SHARE)
    worse: Array = np.where(failed, np.inf, last).reshape(-1, 2).max(axis=1)
    return tried[int(worse.argmin())]


def _drawn(rule: DefaultGains, count: int, seed: int) -> list[Proposal]:
    """Different proposals by seed."""
    grid = [
        (a, b, c, kind)
        for a in SEARCHED_BANDWIDTHS
        for b in SEARCHED_SAMPLING_RATIOS
        for c in SEARCHED_ADAPTATION_RATIOS
        for kind in SEARCHED_SHARES
    ]
    order = np.random.default_rng(seed).permutation(len(grid))[:count]
    found = []
    for bandwidth, hold, number, kind in (grid[k] for k in order):
        try:
            found.append(rule.proposed(bandwidth, hold, number, cast(Shares, kind)))
        except InputError:  # no gains hold the arm: the first proposal has said so
            continue
    return found


def _notes(mechanism: Mechanism, found: FeasibleReference, carried: FeasibleGains, plant: Plant) -> Iterator[str]:
    for j, joint in enumerate(mechanism.primary_joints):
        if found.static[j] > MAX_STATIC_SHARE:
            yield (
                f"{joint.name}: gravity and friction need {found.static[j]:.0%} of the torque limit: it can only "
                "move slowly"
            )
        elif found.asked[j] > max(TORQUE_SHARE, 0.5 * (1.0 + found.static[j])) + 1e-9:
            yield f"{joint.name}: the reference needs {found.asked[j]:.0%} of the torque limit"
        if found.reduced[j] < 0.5:
            yield (
                f"{joint.name}: amplitude reduced to {100 * found.reduced[j]:.2g} % of its motion limits to respect "
                "the torque limit"
            )
        if (rate := carried.gains.bandwidth[j]) < MIN_BANDWIDTH:
            yield f"{joint.name}: the torque limit allows a bandwidth of only {rate:.2g} 1/s: adaptation takes minutes"
    yield from filter(None, (assumed_limits(mechanism), rotor_note(mechanism), yielding_note(mechanism, carried.gains)))
    if plant.integrator.implicit:
        explicit = f"{MAX_EXPLICIT_SUBSTEPS} explicit steps per period"
        yield f"friction is too stiff for {explicit}: {plant.substeps} implicit steps are used"


def _run_remarks(model: ReducedModel | None, rule: DefaultGains) -> Iterator[str]:
    if model is None:
        yield "too many links to compile: the gains were neither searched nor verified"
        return
    if (k := len(model.columns)) > MAX_LEARNED:
        yield f"learning is the default up to {MAX_LEARNED} parameters; these {k} are adapted by the gradient"
    if note := open_note(model, rule.reference, rule.limits):
        yield note
