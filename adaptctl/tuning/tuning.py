"""Tuning: what was chosen for a mechanism, what limits it, and how it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import Gains, SlotineLi, mapped_gain
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Integrator
from adaptctl.tuning.verification import Verification


@dataclass(frozen=True, eq=False)
class Tuning:
    """Reference, gains and integration that `tune` chose for a `mechanism` of r joints and P inertial and friction
    parameters. Nothing is checked.

    `period` T (s) is how long a torque is held, `reference` the trajectory, `initial_error` (r,), in rad (m if
    prismatic), the arm's position less the reference's at time 0. `gains` are Slotine and Li's bandwidth Lambda, 1/s,
    and damping K, N m s/rad (N s/m), (r,) each; `adaptation` (P,) is the diagonal of the adaptation gain Gamma on all
    parameters, in their units squared per J. A period is simulated in `substeps` steps of the `integrator`.
    `torque_limits` (r,) are in N m (N); `torque_share` (r,) is the largest fraction of them that the reference asks
    for, no unit.

    `hold_number` is the upper bound that K was made for of the damping number T lambda_max((M + T B)^-1 K) at random
    positions near the reference, with the mass matrix M, the viscous friction B and lambda_max the largest eigenvalue;
    K is below it where torque limits are tighter. The hold number of a `HoldNumber` is another: it is found, not asked
    for, counts Lambda too, takes friction into account exactly, and comes from a local search over a set of positions.
    `adaptation_number` is T lambda_max(K^-1 Y Gamma Y'), the greatest over samples of the reference, with the regressor
    Y (r, P) and its transpose Y'. Both have no unit and are stable below 2.

    `limited_by` (r,) are sentences on what limits each joint's gains, `verified` the `Verification` runs with these
    gains, none for a mechanism of more than 100 links, for which no native code is made, and `notes` sentences on what
    else matters, none by default.
    """

    mechanism: Mechanism
    period: float
    """s, for which a torque is held"""
    reference: Reference
    initial_error: Array
    """(r,) rad or m, position less the reference's at time 0"""
    gains: Gains
    """Lambda and K (r,)"""
    adaptation: Array
    """(P,) diagonal of Gamma on all parameters"""
    substeps: int
    integrator: Integrator
    torque_limits: Array
    """(r,) N m or N"""
    torque_share: Array
    """(r,) greatest fraction of the torque limits that the reference asks for"""
    hold_number: float
    """upper bound of T lambda_max((M + T B)^-1 K) near the reference; a held torque is stable below 2"""
    adaptation_number: float
    """T lambda_max(K^-1 Y Gamma Y') along the reference; stable below 2"""
    limited_by: tuple[str, ...]
    """what limits each joint's gains, in words (r,)"""
    verified: tuple[Verification, ...]
    """runs with these gains; none for a mechanism of more than 100 links"""
    notes: tuple[str, ...] = ()
    """what else a person should know"""

    def gain_on(self, model: ReducedModel) -> Array:
        """The adaptation gain Gamma (k, k) on a reduced `model`'s k fundamental (base) parameters, in their units
        squared per J. Adapting these is then the same as adapting all P inertial and friction parameters of the
        mechanism with the tuning's diagonal Gamma (P,). Raises `InputError` for a model of another number of parameters
        P."""
        return mapped_gain(model, self.adaptation)

    @cached_property
    def workspace(self) -> Workspace:
        """Set of joint positions for which the gains are checked, a `Workspace`: 60 positions of the reference, evenly
        spaced in its first 20 s, with a margin about each of them. The margin is the size of the largest of the joints'
        initial errors (rad, m if prismatic). Raises `InputError` where kinematic loops can be closed at none of the
        positions."""
        margin = float(np.max(np.abs(self.initial_error)))
        return Workspace.along(self.mechanism, self.reference(np.linspace(0.0, 20.0, 60)).p, margin)

    def controller(self, model: ReducedModel, adaptation: bool = True) -> SlotineLi:
        """Slotine and Li's controller, a `SlotineLi`, with the tuning's gains, control period and torque limits on a
        reduced `model` of the mechanism. Its initial estimate is zero; it does not adapt where `adaptation` is False.
        Raises `GainError` where the gains are too large for the period at a position in the tuning's `workspace`,
        `InputError` for a model of another number of joints or, with adaptation, of parameters."""
        gain, gains = self.gain_on(model) if adaptation else None, self.gains
        given = None, self.period, self.workspace, self.torque_limits
        return SlotineLi(model, gains.bandwidth, gains.damping, gain, *given)

    @property
    def learns(self) -> bool:
        """True if the arm as described learns with these gains, in the first verifying run of 20 s; False where nothing
        was run. The run must stay near the reference: no joint's tracking error reaches 1 rad (m if prismatic), and in
        at most 5 % of the second half a torque is at its limit. Its RMS tracking error over all joints and the last 2 s
        must be at most a third of that of the first second and of that of the last 2 s with adaptation off."""
        return bool(self.verified) and self.verified[0].learns
