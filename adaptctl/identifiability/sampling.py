"""Random states of a mechanism."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, checked, random_seed, whole_number
from adaptctl.description.description import STANDARD_GRAVITY
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind

# Fraction of its reference value that the loops' smallest singular value keeps: nearer to a singularity, dependent
# joints race and drown the rest of the spectrum.
MIN_SINGULAR_VALUE_SHARE = 0.2

# Points along a line at which conditions are checked.
LINE_POINTS = 65

# Most draws before positions are refused.
MAX_DRAWS = 100
# Fewest positions in one draw: following a few takes as long.
MIN_DRAWN_POSITIONS = 100


# Second word of the seed of states that judge what was fitted to those of the first.
OTHERS = 1

# Most states drawn at a time.
MAX_STATES_AT_ONCE = 4096


def positions_on_branch(mechanism: Mechanism, positions: Array, generator: np.random.Generator) -> Array:
    """Return positions (n, r) on the reference's assembly branch, from random offsets (n, r)."""
    continuation = mechanism.continuation
    if continuation is None:
        return positions
    looped = np.array(continuation.equations.closing.looped)
    start = continuation.reference[continuation.primary]
    wanted = np.where(looped, _within_limits(mechanism, start + positions), start)
    way = (wanted - start) * _within_conditions(mechanism, start, wanted)[:, None]
    way *= continuation.progress(start + way, MIN_SINGULAR_VALUE_SHARE)[:, None]
    way *= generator.uniform(size=(len(way), 1)) ** (1.0 / max(int(looped.sum()), 1))
    return np.where(looped, start + way, positions)


def reachable_positions(mechanism: Mechanism, samples: int, draw: Callable[[int], Array]) -> Array:
    """Return the first `samples` positions (samples, r) from `draw` that close all loops."""
    continuation = mechanism.continuation
    if continuation is None:
        return draw(samples)
    kept = np.empty((0, mechanism.dof))
    batch = max(samples, MIN_DRAWN_POSITIONS)
    for _ in range(MAX_DRAWS):
        p = draw(batch)
        p = p[mechanism.description.within_conditions(p)]
        p = p[continuation.progress(p, MIN_SINGULAR_VALUE_SHARE) >= 1.0]
        kept = np.concatenate([kept, p[_tree_within_limits(mechanism, continuation.follow(p))]])
        if len(kept) >= samples:
            return kept[:samples]
    raise InputError(
        f"{mechanism.name}: of {MAX_DRAWS * batch} positions within the limits of the primary joints, only "
        f"{len(kept)} satisfy the conditions and close the loops; narrow the limits, or add conditions"
    )


def _tree_within_limits(mechanism: Mechanism, q: Array) -> NDArray[np.bool_]:
    limits = [link.joint.limits for link in mechanism.links]
    lower, upper = ([getattr(bounds, which) for bounds in limits] for which in ("lower", "upper"))
    inside: NDArray[np.bool_] = np.all((q >= lower) & (q <= upper), axis=-1)
    return inside


def _within_limits(mechanism: Mechanism, p: Array) -> Array:
    limits = [joint.limits for joint in mechanism.primary_joints]
    return np.clip(p, [bounds.lower for bounds in limits], [bounds.upper for bounds in limits])


def _within_conditions(mechanism: Mechanism, start: Array, wanted: Array) -> Array:
    description = mechanism.description
    if not description.within_conditions(start):
        raise InputError(
            f"{mechanism.name}: the reference configuration, p = {np.round(start, 4).tolist()}, violates a condition "
            "of the mechanism; give a reference that satisfies it"
        )
    shares = np.linspace(0.0, 1.0, LINE_POINTS)
    inside = description.within_conditions(start + shares[:, None, None] * (wanted - start))
    return shares[np.logical_and.accumulate(inside).sum(axis=0) - 1]


@dataclass(frozen=True, eq=False)
class States:
    """
    States of a mechanism: positions and velocities of its r primary (independent) joints.

    Parameters
    ----------
    p : numpy.ndarray
        Positions (samples, r) in rad, or m for a prismatic joint.
    v : numpy.ndarray
        Velocities (samples, r) in rad/s or m/s.
    origin : str
        Origin of the states in words, for reports.
    others : callable, optional
        Function that draws a number of other states of the same distribution; None where there are none, as for a
        recorded motion.

    Raises
    ------
    InputError
        If shapes differ or there are fewer than two samples (`NonFiniteError` for NaN and infinity).

    Examples
    --------
    >>> from adaptctl.identifiability import States
    >>> len(States(np.zeros((5, 2)), np.ones((5, 2)), "a test"))
    5
    """

    p: Array
    v: Array
    origin: str
    others: Callable[[int], States] | None = None

    def __post_init__(self) -> None:
        if np.ndim(self.p) != 2 or np.shape(self.p) != np.shape(self.v) or len(self.p) < 2:
            raise InputError(
                "states: expected p and v of one shape (samples, r), at least two samples, "
                f"got {np.shape(self.p)} and {np.shape(self.v)}"
            )
        for what in ("p", "v"):
            checked(getattr(self, what), np.shape(self.p)[1], f"states: {what}")

    def __repr__(self) -> str:
        return f"<States of {self.p.shape[1]} joints: {self.origin}>"

    def __len__(self) -> int:
        return len(self.p)

    def split(self, max_size: int) -> Iterator[States]:
        """
        Split the states into successive parts, for example to limit memory.

        Parameters
        ----------
        max_size : int
            Number of states in each part, at least 2; the last may have fewer, or one more.

        Returns
        -------
        iterator of States
            Parts of at least two states each.

        Raises
        ------
        InputError
            If `max_size` is no whole number of at least 2.

        Examples
        --------
        >>> from adaptctl.identifiability import States
        >>> [len(part) for part in States(np.zeros((5, 2)), np.ones((5, 2)), "a test").split(2)]
        [2, 3]
        """
        spans = _spans(len(self), whole_number(max_size, "split: max_size", 2, sys.maxsize))
        return (States(self.p[begin:end], self.v[begin:end], self.origin) for begin, end in spans)


def characteristic_length(mechanism: Mechanism) -> float:
    """Return the largest distance in m from a joint to the next or to its link's frame."""
    longest = mechanism.description.longest_offset
    return longest if longest > 1e-9 else 1.0


def random_states(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> States:
    """
    Draw random states, uniform over the full circle, for the number of identifiable parameters.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary (independent) joints.
    samples : int
        Number of states, at least 2.
    generator : numpy.random.Generator
        Generator that draws them.

    Returns
    -------
    States
        Positions within +-pi rad (+-L m), and normal velocities of standard deviation sqrt(g/L) rad/s, with the
        characteristic length L and gravity g.

    Raises
    ------
    InputError
        If there are fewer than two samples, or the reference configuration breaks the mechanism's conditions.
    LoopError
        If loops cannot be closed.

    Notes
    -----
    Limits are ignored, as the rank of the energy regressor is the same almost everywhere, and narrow limits only hide
    it. Joints that move a loop stay on the assembly branch of the reference, within limits and away from singularities,
    as other branches may have another rank.

    Examples
    --------
    >>> from adaptctl.identifiability import random_states
    >>> random_states(arm, 10, rng).p.shape
    (10, 2)
    """
    validate_kind(mechanism, Mechanism, "random_states", "as load(...) gives one")
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    length, turns = characteristic_length(mechanism), _turns(mechanism)
    p = generator.uniform(-1.0, 1.0, (samples, mechanism.dof)) * np.where(turns, np.pi, length)
    p = positions_on_branch(mechanism, p, generator)
    v = generator.normal(size=p.shape) * characteristic_rate(mechanism) * np.where(turns, 1.0, length)
    return States(p, v, f"random states {whereabouts(mechanism)}")


def other_random_states(mechanism: Mechanism, seed: int, samples: int) -> States:
    """Return other random states than those that a seed draws."""
    drawn = random_states(mechanism, samples, np.random.default_rng([seed, OTHERS]))
    return States(drawn.p, drawn.v, f"{samples} other {drawn.origin}")


def whereabouts(mechanism: Mechanism) -> str:
    """Return the description of the region of random states."""
    return "over the full circle" if mechanism.description.loops is None else "on the branch of the reference"


def random_halves(
    mechanism: Mechanism, samples: int, generator: np.random.Generator
) -> tuple[Iterable[States], Iterable[States]]:
    """Return two sets of `samples` random states each, drawn in blocks."""
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    if 2 * samples > MAX_STATES_AT_ONCE:
        return _blocks(mechanism, samples, generator), _blocks(mechanism, samples, generator)
    both = random_states(mechanism, 2 * samples, generator)
    first, second = both.split(samples)
    return [first], [second]


def _blocks(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> Iterator[States]:
    for begin, end in _spans(samples, MAX_STATES_AT_ONCE):
        yield random_states(mechanism, end - begin, generator)


def _spans(count: int, most: int) -> Iterator[tuple[int, int]]:
    ends = [*range(most, count - 1, most), count]
    return zip([0, *ends], ends, strict=False)


def random_accelerations(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> Array:
    """Draw normal accelerations (samples, r) of standard deviation g/L."""
    per_joint = np.where(_turns(mechanism), 1.0, characteristic_length(mechanism))
    return generator.normal(size=(samples, mechanism.dof)) * characteristic_rate(mechanism) ** 2 * per_joint


def states_within_limits(mechanism: Mechanism, samples: int, seed: int = 0) -> States:
    """
    Draw random states, uniform within the joints' limits.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary (independent) joints.
    samples : int
        Number of states, at least 2.
    seed : int, default 0
        Seed of the states, from 0 to 2^32 - 1. Fixed, so that a result can be repeated.

    Returns
    -------
    States
        Positions in rad (m if prismatic) and velocities in rad/s (m/s), as Sheu and Walker (1991) sampled theirs.

    Raises
    ------
    InputError
        If there are fewer than two samples, the seed is out of range, or too few positions can be reached.
    LoopError
        If loops cannot be closed.

    Notes
    -----
    Without position limits, a range of 2 pi rad (2 L m) about the neutral configuration, or from the other limit, is
    taken; without a velocity limit, sqrt(g/L) rad/s, with the characteristic length L and gravity g.

    Examples
    --------
    >>> from adaptctl.identifiability import states_within_limits
    >>> states_within_limits(arm, 10).v.shape
    (10, 2)
    """
    validate_kind(mechanism, Mechanism, "states_within_limits", "as load(...) gives one")
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    seed = random_seed(seed, "seed")
    p, v = _within_all_limits(mechanism, samples, np.random.default_rng(seed))
    words = f"{samples} random states within the joint limits, seed {seed}"
    return States(p, v, words, partial(_others_within_limits, mechanism, seed))


def _others_within_limits(mechanism: Mechanism, seed: int, samples: int) -> States:
    p, v = _within_all_limits(mechanism, samples, np.random.default_rng([seed, OTHERS]))
    return States(p, v, f"{samples} other random states within the joint limits")


def _within_all_limits(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Draw positions and velocities (samples, r), uniform within the joints' limits."""
    length, turns = characteristic_length(mechanism), _turns(mechanism)
    limits = [joint.limits for joint in mechanism.primary_joints]
    reach = np.where(turns, np.pi, length)
    lower, upper = np.array([b.lower for b in limits]), np.array([b.upper for b in limits])
    lower, upper = _range(lower, upper, 2.0 * reach, mechanism.neutral_configuration)
    speed = np.array([b.velocity for b in limits])
    speed = np.where(np.isfinite(speed), speed, characteristic_rate(mechanism) * np.where(turns, 1.0, length))
    p = reachable_positions(mechanism, samples, partial(_uniform, generator, lower, upper))
    return p, generator.uniform(-speed, speed, p.shape)


def _uniform(generator: np.random.Generator, lower: Array, upper: Array, samples: int) -> Array:
    return generator.uniform(lower, upper, (samples, len(lower)))


def _range(lower: Array, upper: Array, width: Array, center: Array) -> tuple[Array, Array]:
    low, high = np.isfinite(lower), np.isfinite(upper)
    below = np.where(high, upper - width, center - 0.5 * width)
    above = np.where(low, lower + width, center + 0.5 * width)
    return np.where(low, lower, below), np.where(high, upper, above)


def _turns(mechanism: Mechanism) -> Array:
    return np.array([joint.kind.is_revolute for joint in mechanism.primary_joints])


def characteristic_rate(mechanism: Mechanism) -> float:
    """Return the rate sqrt(g/L) in 1/s of similar kinetic and potential energy."""
    gravity = float(np.linalg.norm(mechanism.description.gravity)) or float(np.linalg.norm(STANDARD_GRAVITY))
    return float(np.sqrt(gravity / characteristic_length(mechanism)))
