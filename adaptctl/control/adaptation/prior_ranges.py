"""Adaptation gains from prior ranges of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, positive_number
from adaptctl.control.gains.estimate_hold import parameter_holds
from adaptctl.control.gains.gains import Gains
from adaptctl.control.gains.hold import hold_number
from adaptctl.control.gains.workspace import Workspace
from adaptctl.errors import GainError, NotFoundError, require_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.nearest_name import nearest_name

HOLD_SHARE = 0.2
"""of what the gains leave of the hold number, for each parameter"""
RANGES = {
    "m": "mass",
    **dict.fromkeys(("mc_x", "mc_y", "mc_z"), "first_moment"),
    **dict.fromkeys(("I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz", "rotor_inertia"), "inertia"),
    **dict.fromkeys(("viscous", "square_root"), "viscous"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), "coulomb"),
}
"""The range of each kind of parameter."""


@dataclass(frozen=True)
class PriorRanges:
    """Prior ranges of parameters by kind: the greatest plausible magnitudes of the initial estimate's error, from which
    adaptation gains are made. `mass` is in kg, 5 by default; `first_moment` in kg m, 2; `inertia` in kg m^2, 0.6;
    `viscous` friction in N m s/rad (N s/m for a prismatic joint), 5; and `coulomb` friction in N m (N), 10. Raises
    `InputError` unless all are positive and finite.

    Parameters of different kinds need gains of different size: one gain for a mass in kg and an inertia in kg m^2 would
    learn one of them far too slowly or far too fast.
    """

    mass: float = 5.0
    """kg"""
    first_moment: float = 2.0
    """kg m"""
    inertia: float = 0.6
    """kg m^2"""
    viscous: float = 5.0
    """N m s/rad"""
    coulomb: float = 10.0
    """N m"""

    def __post_init__(self) -> None:
        for kind in ("mass", "first_moment", "inertia", "viscous", "coulomb"):
            positive_number(getattr(self, kind), f"prior range of {kind}: expected a positive number")

    @lru_cache(maxsize=64)  # noqa: B019  # a few numbers each, asked for by every controller of a sweep
    def of(self, names: tuple[str, ...]) -> Array:
        """The prior ranges (k,), in the parameters' SI units and read-only, of the k parameters with the full `names`,
        such as `link1.m`, in their order.

        What follows the last dot counts: `m` has the range `mass`, `mc_...` the range `first_moment`, `viscous` and
        `square_root` the range `viscous`, `coulomb`, `stribeck` and `offset` the range `coulomb`, `I_...` and
        `rotor_inertia` the range `inertia`. Raises `NotFoundError` for another name.
        """
        return frozen(np.array([self._range(name) for name in names]))

    def _range(self, name: str) -> float:
        kind = name.rsplit(".", 1)[-1]
        if kind not in RANGES:
            known = f"one that ends in {', '.join(RANGES)}{nearest_name(kind, RANGES)}"
            raise NotFoundError(f"prior ranges: there is no range of a parameter {name!r}: expected {known}")
        return float(getattr(self, RANGES[kind]))


def adaptation_gain(
    model: ReducedModel,
    ranges: PriorRanges | None = None,
    rate: float = 0.6,
    *,
    gains: Gains | None = None,
    period: float = 1e-3,
    workspace: Workspace | None = None,
) -> Array:
    """The diagonal (k,) of the adaptation gain Gamma for the `model`'s k parameters, in units of the parameters squared
    per J: `rate`, in 1/J, 0.6 by default, times the square of each parameter's prior range. A prior range, its greatest
    plausible error, is taken from `ranges`, `PriorRanges()` where None.

    In the Lyapunov function an error of a whole range then counts 1/(2 rate), 0.83 J by default, for every parameter.

    With the `gains` of a control law, its bandwidth Lambda (1/s) and damping K (N m s/rad, N s/m for a prismatic
    joint), no range is taken greater than 0.2 (2 - h)/u: otherwise a light wrist, whose inertia a prior range lets be
    learned a hundred times too large, would ring. The hold number h = T_c lambda_max(M^-1 (K + M Lambda)) of these
    gains has no unit and is stable below 2, with the largest eigenvalue lambda_max, the mass matrix M and the control
    `period` T_c in s, 1 ms by default; u is what an error of 1 SI unit in the parameter adds to it (`parameter_holds`).
    Both are the greatest over the set of joint positions `workspace`, all that the joints' limits allow where None: h
    by a local search, u over its samples. `period` and `workspace` are not used where `gains` is None, the default.

    Raises `GainError` where h is 2 or more, and `InputError` for a rate that is not positive and finite and, with
    gains, for a period or damping that is not positive and for gains of another number of joints.
    """
    require_kind(model, ReducedModel, "adaptation gain", "as ReducedModel(mechanism, basis) is one")
    known = PriorRanges() if ranges is None else ranges
    require_kind(known, PriorRanges, "adaptation gain: ranges", "as PriorRanges() is one")
    reach = known.of(model.names)
    if gains is not None:
        held = hold_number(model.mechanism, gains.damping, period, gains.bandwidth, workspace=workspace).value
        caused = parameter_holds(model, gains.bandwidth, period, workspace)
        reach = np.minimum(reach, HOLD_SHARE * max(2.0 - held, 0.0) / np.maximum(caused, np.finfo(float).tiny))
    if not np.all(reach > 0.0):
        raise GainError(f"{model.mechanism.name}: a period of {period:g} s does not carry these gains: nothing is left")
    return np.asarray(positive_number(rate, "adaptation gain: rate: expected a positive number") * reach**2)


def mapped_gain(model: ReducedModel, gain: ArrayLike) -> Array:
    """The adaptation gain Gamma_beta = K_r Gamma_D K_r' (k, k) of a model's k fundamental (base) parameters, for a
    diagonal gain Gamma_D, `gain` (P,), on all P parameters; both in units of the parameters squared per J.

    K_r (k, P) is the model's attribute `regrouping`, K_r' its transpose: K_r times all P parameters gives the k
    fundamental ones. With Gamma_beta, adapting the k fundamental parameters is the same controller as adapting all P,
    to round-off. Gamma_beta is symmetric to the last bit. Raises `InputError` unless the gain is P finite numbers.
    """
    full = frozen_array(gain, (model.regrouping.shape[1],), "gain on all parameters")
    mapped = (model.regrouping * full) @ model.regrouping.T
    return np.asarray(0.5 * (mapped + mapped.T))
