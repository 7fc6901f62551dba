"""Random sinusoidal references."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.tuning.feasible_reference import START_TIME, motion_ranges, random_swing

Trajectory: TypeAlias = Reference | int | str | None
"""Reference, seed of a random one, or 'random' or None for a new one."""

LIMIT_SHARE = 0.8
"""Fraction of a position range and of a velocity limit."""
LOOP_MARGIN = 0.1
"""rad or m, distance from the loops' limits."""
BOX_SAMPLES = 64


def drawn(trajectory: Trajectory, mechanism: Mechanism, rng: np.random.Generator) -> Reference:
    """Reference for a trajectory."""
    return all_drawn([trajectory], mechanism, lambda _: rng)[0]


def all_drawn(
    trajectories: Sequence[Trajectory], mechanism: Mechanism, generator: Callable[[int], np.random.Generator]
) -> list[Reference]:
    """References of many trajectories."""
    sources: dict[Hashable, np.random.Generator] = {}
    keys: list[Hashable] = []
    for k, given in enumerate(trajectories):
        validate_trajectory(given)
        if given is None or (isinstance(given, str) and given == "random"):
            keys.append(("new", k))
            sources["new", k] = generator(k)
        elif isinstance(given, int | np.integer):
            keys.append(int(given))
            sources[int(given)] = np.random.default_rng(int(given))
        else:
            keys.append(None)
    random = dict(zip(sources, many_random_sinusoids(mechanism, sources.values()), strict=True))
    return [given if callable(given) else random[key] for given, key in zip(trajectories, keys, strict=True)]


def validate_trajectory(given: object, what: str = "trajectory") -> None:
    """Raise `InputError` unless `given` is a `Trajectory`."""
    is_seed = isinstance(given, int | np.integer) and not isinstance(given, bool) and given >= 0
    is_word = given is None or (isinstance(given, str) and given == "random")
    if not (is_seed or is_word or callable(given)):
        samples = "; Spline(positions, times) makes a Reference" if isinstance(given, list | tuple | np.ndarray) else ""
        raise InputError(f"{what}: expected a Reference, a seed of at least 0, or 'random', got {given!r:.80}{samples}")


def random_sinusoids(mechanism: Mechanism, rng: np.random.Generator) -> Sinusoids:
    """
    Draw random sinusoids within a mechanism's limits.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with r joints.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    Sinusoids
        One sinusoid for each joint of 0.1 to 0.25 Hz and up to 0.5 rad (m if prismatic), faded in over 2 s.

    Raises
    ------
    InputError
        If the mechanism's loops admit none.

    Notes
    -----
    They use 80 % of position ranges and velocity limits. Joints without limits move within 1 rad (m) of zero, with one
    limit within 2 rad (m) of it. With loops, center and amplitudes are reduced until 64 sampled positions are possible.

    Examples
    --------
    >>> from adaptctl.envs import random_sinusoids
    >>> random_sinusoids(arm, rng).center.shape
    (2,)
    """
    return many_random_sinusoids(mechanism, [rng])[0]


def many_random_sinusoids(mechanism: Mechanism, rngs: Iterable[np.random.Generator]) -> list[Sinusoids]:
    """Random references, one per generator."""
    references = [_within_limits(mechanism, rng) for rng in rngs]
    return references if mechanism.continuation is None else _where_loops_allow(mechanism, references)


def _within_limits(mechanism: Mechanism, rng: np.random.Generator) -> Sinusoids:
    lower, upper = motion_ranges(mechanism)
    middle, reach = 0.5 * (lower + upper), 0.5 * LIMIT_SHARE * (upper - lower)
    frequency, amplitude = random_swing(mechanism, reach, LIMIT_SHARE, rng)
    center = middle + (reach - amplitude) * rng.uniform(-1.0, 1.0, mechanism.dof)
    return Sinusoids(center, amplitude, frequency, start_time=START_TIME)


def _where_loops_allow(mechanism: Mechanism, references: list[Sinusoids]) -> list[Sinusoids]:
    home, found = mechanism.neutral_configuration, dict[int, Sinusoids]()
    box = np.random.default_rng(0).uniform(-1.0, 1.0, (BOX_SAMPLES, mechanism.dof))
    box[: BOX_SAMPLES // 2] = np.sign(box[: BOX_SAMPLES // 2])
    for share in LIMIT_SHARE ** np.arange(30):
        left = [k for k in range(len(references)) if k not in found]
        if not left:
            break
        centers = np.array([home + share * (references[k].center - home) for k in left])
        amplitudes = np.array([share * references[k].amplitude[0] for k in left])
        allowed = _reached(mechanism, centers[:, None] + (amplitudes[:, None] + LOOP_MARGIN) * box)
        for i in np.flatnonzero(allowed).tolist():
            frequency = references[left[i]].frequency[0]
            found[left[i]] = Sinusoids(centers[i], amplitudes[i], frequency, start_time=START_TIME)
    if len(found) < len(references):
        raise InputError(
            f"{mechanism.name}: no feasible reference: the loops allow almost no motion about the reference "
            "configuration"
        )
    return [found[k] for k in range(len(references))]


def _reached(mechanism: Mechanism, p: Array) -> NDArray[np.bool_]:
    """Mask (k,) of boxes of positions (k, b, r) that can be reached."""
    inside: NDArray[np.bool_] = np.asarray(mechanism.description.within_conditions(p).all(axis=1))
    if mechanism.continuation is not None and inside.any():
        reachable = mechanism.continuation.reachable(p[inside].reshape(-1, p.shape[-1]))
        inside[inside] = reachable.reshape(-1, p.shape[1]).all(axis=1)
    return inside
