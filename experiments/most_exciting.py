"""The motion on which a mechanism's parameters show best."""

from __future__ import annotations

from functools import lru_cache

from adaptctl.control import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

EXCITING = "exciting"
"""Name of the motion in the setting `motion` of experiments."""


@lru_cache(maxsize=4)
def most_exciting(mechanism: Mechanism, seed: int) -> Sinusoids:
    """Most exciting motion of a `mechanism`, `Sinusoids`: a Fourier series of joint positions, rad (m if prismatic), of
    five harmonics of 0.1 Hz, on which the regressor of the base parameters has the least condition number, found by
    `exciting_reference` with `seed`. It keeps within 0.8 of the limits of positions, speeds and torques; the last four
    are cached. Raises `InputError` for a mechanism with kinematic loops, and where torques pass these limits even at
    rest, `RankError` where the number of base parameters cannot be certified."""
    from adaptctl.control import exciting_reference

    if mechanism.description.loops is not None:
        raise InputError(f"motion: {EXCITING} is for arms without loops, and {mechanism.name} has some")
    basis = fundamental_basis(essential_space(mechanism, seed=seed))
    return exciting_reference(ReducedModel(mechanism, basis), seed=seed).reference
