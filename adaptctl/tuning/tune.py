"""The choice of reference, gains and integration for a mechanism, from its description alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_number, whole_count
from adaptctl.control.controller import Reference
from adaptctl.control.gains.torque_limits import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, require_kind
from adaptctl.simulation import Plant
from adaptctl.simulation.stiffness import MOST, integration
from adaptctl.tuning.carried_gains import MANY, POSTURES, POSTURES_OF_MANY, CarriedGains
from adaptctl.tuning.initial_error import SLOW, recoverable_error
from adaptctl.tuning.limitations import limitations
from adaptctl.tuning.proposal import Proposals
from adaptctl.tuning.search import searched
from adaptctl.tuning.trial import Trials
from adaptctl.tuning.tuning import Tuning
from adaptctl.tuning.verification import Verification, verifications
from adaptctl.tuning.workable_reference import TORQUE_SHARE, WorkableReference, judged_reference, workable_reference

STATIC, LITTLE = 0.95, 3.0
"""share of a torque limit at rest, and ratio of errors without and with adaptation, that are noted"""


def tune(
    mechanism: Mechanism,
    *,
    period: float = 1e-3,
    reference: Reference | None = None,
    initial_error: ArrayLike | None = None,
    bandwidth: float = 4.0,
    hold: float = 0.5,
    adaptation: float = 0.5,
    search: int = 0,
    seed: int = 0,
) -> Tuning:
    """A `Tuning` of a `mechanism` of r joints: a reference trajectory, gains, and the integrator and its number of
    steps a control period, with which Slotine and Li's law learns its parameters from zero.

    The law is torque = Y estimate - K s, s = v - v_d + Lambda (p - p_d), d estimate/dt = -Gamma Y' s. p and v (r,) are
    positions and velocities, p_d and v_d the reference's, in rad and rad/s (m and m/s if prismatic), Y (r, P) is the
    regressor of the P inertial and friction parameters and Y' its transpose; Lambda (1/s) and K (N m s/rad, N s/m if
    prismatic) are gains of each joint, Gamma (P, P) is the adaptation gain in the parameters' units squared per J.

    `period` is the control period T (s), 1 ms by default. The `reference`, unless given, is drawn by `seed` within 60 %
    of the torque limits; the `initial_error` (rad or m, one number or (r,)), position less the reference's at time 0,
    unless given, is 0.1 rad or m, and less where a range or a torque limit is small. Lambda is `bandwidth` (1/s), or
    less for a joint whose initial error 0.3 of its torque limit brings back no faster. K is the largest, joint by
    joint, with T lambda_max((M + T B)^-1 K) of at most `hold` (no unit) at random positions near the reference, within
    torque limits: lambda_max is the largest eigenvalue, M the mass matrix and B the viscous friction. Gamma, a
    diagonal, is half in proportion to the squares of the parameters' prior ranges (greatest plausible errors) and half
    the same, but scaled link by link to an equal effect on torques, with T lambda_max(K^-1 Y Gamma Y') of `adaptation`
    (no unit).

    `search` is the number of other settings of bandwidth, `hold`, `adaptation` and proportions of Gamma that are tried,
    of a grid of 48, zero, the default, for none. Each is run on links whose ten inertial parameters are 30 % up or
    down, with torques in time and a period late; the setting is taken whose tracking error (RMS over all joints and the
    last 2 s, of the worse run) is least. The gains found are verified in closed loop. Mechanisms of more than 100
    links, for which no native code is made, are neither searched nor verified.

    Raises `InputError` for settings that are out of range (above 0 and at most: `period` 0.1, `bandwidth` 1000, `hold`
    1.5, `adaptation` 1; `search` and `seed` whole numbers of at least 0; `initial_error` finite and of r joints), for
    joints that move nothing that has inertia, and where M is not positive definite; for a given `reference`,
    `NonFiniteError` where its points are not finite and `SingularityError` where kinematic loops cannot be closed at
    its first one.
    """
    require_kind(mechanism, Mechanism, "tune", "as load(...) gives one")
    period, bandwidth = _positive("period", period, 0.1), _positive("bandwidth", bandwidth, 1e3)
    hold, adaptation = _positive("hold", hold, 1.5), _positive("adaptation", adaptation, 1.0)
    search, seed = whole_count(search, "search"), whole_count(seed, "seed")
    given = None if initial_error is None else _given_error(mechanism, initial_error)
    limits = finite_torque_limits(mechanism)
    if reference is None:
        found = workable_reference(mechanism, limits, seed)
    else:
        found = judged_reference(mechanism, limits, reference)
    off = given if given is not None else recoverable_error(mechanism, limits, found.reference)
    proposals = Proposals.along(mechanism, limits, found.reference, off, period, _postures(mechanism), seed)
    first = proposals.proposed(bandwidth, hold, adaptation, "mixed")
    plant = _plant(mechanism, period, tuple(limits.tolist()))
    trials = Trials(plant, found.reference, off)
    chosen = searched(trials, proposals, first, search, seed) if search and trials.possible else first
    carried, gain = chosen.carried, chosen.gain
    verified = verifications(trials, carried.gains, gain, seed) if trials.possible else ()
    return Tuning(
        mechanism,
        period,
        found.reference,
        off,
        carried.gains,
        gain,
        plant.substeps,
        plant.integrator,
        limits,
        found.asked,
        chosen.hold,
        chosen.adaptation,
        limitations(mechanism, carried),
        verified,
        (*_notes(mechanism, found, carried, plant), *_run_remarks(verified, trials.possible)),
    )


@lru_cache(maxsize=8)
def _plant(mechanism: Mechanism, period: float, limits: tuple[float, ...]) -> Plant:
    """The plant of trials, kept, and the code of its trials with it."""
    return Plant(mechanism, period, *integration(mechanism, (), period), np.array(limits))


def _positive(name: str, value: float, most: float) -> float:
    what = f"{name}: expected a number above 0 and at most {most:g}"
    if (number := positive_number(value, what)) > most:
        raise InputError(f"{what}, got {value!r}")
    return number


def _given_error(mechanism: Mechanism, given: ArrayLike) -> Array:
    error = per_joint(given, mechanism.dof, "initial_error")
    if not np.all(np.isfinite(error)):
        raise InputError(f"initial_error: expected finite numbers, got {error.tolist()}")
    return error


def _postures(mechanism: Mechanism) -> int:
    return POSTURES if mechanism.dof <= MANY else POSTURES_OF_MANY


def _notes(mechanism: Mechanism, found: WorkableReference, carried: CarriedGains, plant: Plant) -> Iterator[str]:
    """Sentences on a mechanism that is hard to tune: a joint that can only creep, a slow bandwidth, impossible
    parameters."""
    for j, joint in enumerate(mechanism.primary_joints):
        if found.static[j] > STATIC:
            yield f"{joint.name}: gravity and friction ask {found.static[j]:.0%} of its torque limit: it can only creep"
        elif found.asked[j] > max(TORQUE_SHARE, 0.5 * (1.0 + found.static[j])) + 1e-9:
            yield f"{joint.name}: the reference asks {found.asked[j]:.0%} of its torque limit"
        if found.reduced[j] < 0.5:
            yield f"{joint.name}: moved by {found.reduced[j]:.2g} of what its limits allow, for its torque's sake"
        if (rate := carried.gains.bandwidth[j]) < SLOW:
            yield f"{joint.name}: its torque limit allows a bandwidth of {rate:.2g} 1/s: learning takes minutes"
    if wrong := mechanism.description.inconsistent_links:
        yield f"no rigid body has the inertial parameters of {', '.join(wrong)}"
    if plant.integrator.implicit:
        yield f"friction is too stiff for {MOST} explicit steps a period: {plant.substeps} implicit ones are taken"


def _run_remarks(verified: tuple[Verification, ...], possible: bool) -> Iterator[str]:
    """Sentences on the runs that verify a tuning."""
    if not possible:
        yield "too many links to compile: nothing was searched or verified"
    for run in verified[:1]:
        ratio = run.off / run.last if run.last > 0.0 else math.inf
        if ratio < LITTLE:
            yield "adaptation off tracks nearly as well: there is little to learn on this reference"
