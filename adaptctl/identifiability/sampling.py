"""Random states of a mechanism, to tell generic properties from accidents of one configuration."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, checked, whole_number
from adaptctl.description import GROUND
from adaptctl.description.description import STANDARD_GRAVITY
from adaptctl.description.pose import Pose
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind

REGULAR = 0.2
"""Fraction of its reference value that the loops' smallest singular value keeps: nearer to a singularity, dependent
joints race and drown the rest of the spectrum."""

POINTS = 65
"""Points along a line at which conditions are checked."""

MOST_DRAWS = 100
"""Most draws before positions are refused."""
FEWEST = 100
"""Fewest positions in one draw: following a few takes as long."""


MOST = 4096
"""Most states drawn at a time."""


def positions_on_branch(mechanism: Mechanism, positions: Array, generator: np.random.Generator) -> Array:
    """Positions (n, r) of n samples, rad (m for a prismatic joint), of a mechanism's r primary (independent) joints, at
    which its closed loops can be closed, from random `positions` (n, r). Those of joints that move a loop are brought
    onto the assembly branch of the reference configuration; a mechanism without loops keeps all.

    Of the m joints that move a loop, `positions` are offsets from the reference configuration. They go from it along
    the straight line to that offset, clipped to their limits, as far as the mechanism's conditions (bounds on weighted
    sums of its positions) hold and the closure Jacobian's smallest singular value is at least 0.2 of that at the
    reference configuration. They stop at a fraction u^(1/m) of this line, with u uniform in 0..1, drawn for each sample
    with NumPy's `generator`. Joints that move no loop keep their positions. Raises `InputError` for a reference that
    breaks a condition, `LoopError` where loops cannot be closed.
    """
    continuation = mechanism.continuation
    if continuation is None:
        return positions
    looped = np.array(continuation.equations.closing.looped)
    start = continuation.reference[continuation.primary]
    wanted = np.where(looped, _within_limits(mechanism, start + positions), start)
    way = (wanted - start) * _within_conditions(mechanism, start, wanted)[:, None]
    way *= continuation.progress(start + way, REGULAR)[:, None]
    way *= generator.uniform(size=(len(way), 1)) ** (1.0 / max(int(looped.sum()), 1))
    return np.where(looped, start + way, positions)


def reachable_positions(mechanism: Mechanism, samples: int, draw: Callable[[int], Array]) -> Array:
    """The first `samples` positions (samples, r), rad (m for a prismatic joint), of a mechanism's r primary
    (independent) joints, out of those that the function `draw` gives, at which its closed loops can be closed. A
    mechanism without loops takes all that are drawn.

    `draw`, called with a number n, gives n random positions (n, r). Those are taken that keep the mechanism's
    conditions (bounds on weighted sums of its positions) and, loops closed, the limits of all the tree's joints, and to
    which a straight line from the reference leads on which the closure Jacobian's smallest singular value is at least
    0.2 of that at the reference configuration. Raises `InputError` when a hundred draws, of at least 100 positions
    each, do not give enough, `LoopError` where loops cannot be closed.
    """
    continuation = mechanism.continuation
    if continuation is None:
        return draw(samples)
    kept = np.empty((0, mechanism.dof))
    batch = max(samples, FEWEST)
    for _ in range(MOST_DRAWS):
        p = draw(batch)
        p = p[mechanism.description.within_conditions(p)]
        p = p[continuation.progress(p, REGULAR) >= 1.0]
        kept = np.concatenate([kept, p[_tree_within_limits(mechanism, continuation.follow(p))]])
        if len(kept) >= samples:
            return kept[:samples]
    raise InputError(
        f"{mechanism.name}: of {MOST_DRAWS * batch} positions within the primary joints' limits only {len(kept)} keep "
        "the conditions and let the loops close; narrow the limits, or add conditions that leave out the rest"
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
    """Shares (m,) of the straight ways along which the mechanism's conditions hold."""
    description = mechanism.description
    if not description.within_conditions(start):
        raise InputError(
            f"{mechanism.name}: the reference configuration, p = {np.round(start, 4).tolist()}, breaks a condition of "
            "the mechanism: give a reference within it"
        )
    shares = np.linspace(0.0, 1.0, POINTS)
    inside = description.within_conditions(start + shares[:, None, None] * (wanted - start))
    return shares[np.logical_and.accumulate(inside).sum(axis=0) - 1]


@dataclass(frozen=True, eq=False)
class States:
    """States of a mechanism's r primary (independent) joints: positions `p` in rad (m for a prismatic joint) and
    velocities `v` in rad/s (m/s), both (samples, r), and their `origin`, how they were made, in words.

    Raises `InputError` for arrays of other shapes and for fewer than two samples, `NonFiniteError` on NaN or infinity.
    """

    p: Array
    v: Array
    origin: str

    def __post_init__(self) -> None:
        if np.ndim(self.p) != 2 or np.shape(self.p) != np.shape(self.v) or len(self.p) < 2:
            raise InputError(
                "states: expected p and v of one shape (samples, r), at least two samples, "
                f"got {np.shape(self.p)} and {np.shape(self.v)}"
            )
        for what in ("p", "v"):
            checked(getattr(self, what), np.shape(self.p)[1], f"states: {what}")

    def __len__(self) -> int:
        return len(self.p)

    def parts(self, most: int) -> Iterator[States]:
        """Iterator over these states in parts, one after another, of `most` states each (2 or more), the last of fewer,
        or of one more rather than leave a single state over. Raises `InputError` for any other `most`."""
        spans = _spans(len(self), whole_number(most, "parts: most", 2, sys.maxsize))
        return (States(self.p[begin:end], self.v[begin:end], self.origin) for begin, end in spans)


def characteristic_length(mechanism: Mechanism) -> float:
    """The characteristic length L (m) of a `mechanism`: the largest distance from a joint to the next, or from a joint
    to its link's frame; 1 m where none is above 1e-9 m. Nothing is raised.

    Far frames count, since inertias are given in them: a frame 0.25 m from its joint adds (0.25 m)^2 times the mass to
    the inertia in it.
    """
    links = mechanism.links
    offsets = [_offset(links[k.parent].joint_to_link, k.parent_to_joint) for k in links if k.parent != GROUND]
    offsets += [k.joint_to_link.translation for k in links]
    longest = float(np.linalg.norm(np.reshape(offsets, (-1, 3)), axis=1).max(initial=0.0))
    return longest if longest > 1e-9 else 1.0


def _offset(first: Pose, second: Pose) -> Array:
    """The origin (3,) of the second frame, which is given in the first, where the first is given."""
    return first.rotation @ second.translation + first.translation


def random_states(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> States:
    """Random states (`samples`, r) of r primary (independent) joints, drawn with NumPy's `generator`: positions uniform
    within +-pi rad (prismatic joints: +-L in m), and normal velocities of mean zero and standard deviation sqrt(g/L) in
    rad/s (times L in m/s).

    L is the largest distance (m) from a joint to the next, or to its link's frame, 1 m where there is none; g the
    mechanism's gravity (m/s^2), the standard one where it has none. Limits are ignored, but for joints that move a
    loop. Raises `InputError` for fewer than two samples, and for a reference configuration that breaks the mechanism's
    conditions (bounds on its positions), `LoopError` where loops cannot be closed.

    The energy is analytic in the state, so that its rank is the same almost everywhere: samples within narrow limits
    would only make the same rank harder to see. Joints that move a loop are kept on the assembly branch of the
    reference configuration, within limits and away from singularity (see `positions_on_branch`): beyond, another branch
    may have another rank.
    """
    validate_kind(mechanism, Mechanism, "random_states", "as load(...) gives one")
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    length, turns = characteristic_length(mechanism), _turns(mechanism)
    p = generator.uniform(-1.0, 1.0, (samples, mechanism.dof)) * np.where(turns, np.pi, length)
    p = positions_on_branch(mechanism, p, generator)
    v = generator.normal(size=p.shape) * characteristic_rate(mechanism) * np.where(turns, 1.0, length)
    return States(p, v, f"random states {whereabouts(mechanism)}")


def whereabouts(mechanism: Mechanism) -> str:
    """The region from which a mechanism's random states are drawn, as text: "over the full circle", or, with loops, "on
    the reference's branch" (the assembly branch of its reference configuration). Nothing is raised."""
    return "over the full circle" if mechanism.description.loops is None else "on the reference's branch"


def random_halves(
    mechanism: Mechanism, samples: int, generator: np.random.Generator
) -> tuple[Iterable[States], Iterable[States]]:
    """Two sets of random states of a mechanism, `samples` in each, as iterables of `States`, drawn by `random_states`
    with NumPy's `generator`. They are to be used up one after the other, the first first.

    More than 4096 states in all are drawn as they are used, 4096 at a time, so that the storage does not grow with
    their number. Raises `InputError` unless `samples` is a whole number of at least 2, and, when drawn, for a reference
    configuration that breaks the mechanism's conditions (bounds on its positions).
    """
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    if 2 * samples > MOST:
        return _blocks(mechanism, samples, generator), _blocks(mechanism, samples, generator)
    both = random_states(mechanism, 2 * samples, generator)
    first, second = both.parts(samples)
    return [first], [second]


def _blocks(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> Iterator[States]:
    for begin, end in _spans(samples, MOST):
        yield random_states(mechanism, end - begin, generator)


def _spans(count: int, most: int) -> Iterator[tuple[int, int]]:
    """Ranges of 0..count of at most `most` numbers, or one more, and at least two."""
    ends = [*range(most, count - 1, most), count]
    return zip([0, *ends], ends, strict=False)


def random_accelerations(mechanism: Mechanism, samples: int, generator: np.random.Generator) -> Array:
    """Random accelerations (`samples`, r) of a mechanism's r primary (independent) joints, to go with `random_states`:
    normal, drawn with NumPy's `generator`, of mean zero and standard deviation g/L in rad/s^2 (g in m/s^2 for a
    prismatic joint). L is the mechanism's characteristic length in m, g its gravity in m/s^2, the standard one where it
    has none. Nothing is checked."""
    per_joint = np.where(_turns(mechanism), 1.0, characteristic_length(mechanism))
    return generator.normal(size=(samples, mechanism.dof)) * characteristic_rate(mechanism) ** 2 * per_joint


def states_within_limits(mechanism: Mechanism, samples: int, seed: int = 0) -> States:
    """Random states (`samples`, r) of r primary (independent) joints, uniform within the joints' limits, as Sheu and
    Walker (1991) sampled theirs, drawn by `seed`, the same for the same seed. Positions are in rad (m for a prismatic
    joint), velocities in rad/s (m/s).

    Where a joint has no limit, a range of 2 pi rad (2 L in m) is taken, about the mechanism's home position or from its
    other limit; where its velocity has none, sqrt(g/L) in rad/s (times L in m/s). L is the largest distance (m) from a
    joint to the next, or to its link's frame, 1 m where there is none; g the gravity (m/s^2), the standard one where
    there is none. Of a mechanism with loops, those positions are drawn that it can reach within its conditions (bounds
    on its positions) and all its joints' limits. Raises `InputError` when a hundred draws give too few of these, for
    fewer than two samples, and for a seed that is not a whole number from 0 to 2^32 - 1, `LoopError` where loops cannot
    be closed.
    """
    validate_kind(mechanism, Mechanism, "states_within_limits", "as load(...) gives one")
    samples = whole_number(samples, "samples", 2, sys.maxsize)
    generator = np.random.default_rng(whole_number(seed, "seed", 0, 2**32 - 1))
    length, turns = characteristic_length(mechanism), _turns(mechanism)
    limits = [joint.limits for joint in mechanism.primary_joints]
    reach = np.where(turns, np.pi, length)
    lower, upper = np.array([b.lower for b in limits]), np.array([b.upper for b in limits])
    lower, upper = _range(lower, upper, 2.0 * reach, mechanism.neutral_configuration)
    speed = np.array([b.velocity for b in limits])
    speed = np.where(np.isfinite(speed), speed, characteristic_rate(mechanism) * np.where(turns, 1.0, length))
    draw = partial(_uniform, generator, lower, upper)
    p = reachable_positions(mechanism, samples, draw)
    v = generator.uniform(-speed, speed, p.shape)
    return States(p, v, f"{samples} random states within the joints' limits, seed {seed}")


def _uniform(generator: np.random.Generator, lower: Array, upper: Array, samples: int) -> Array:
    return generator.uniform(lower, upper, (samples, len(lower)))


def _range(lower: Array, upper: Array, width: Array, center: Array) -> tuple[Array, Array]:
    """Bounds with the infinite ones replaced: `width` from the finite one, or about the centre."""
    low, high = np.isfinite(lower), np.isfinite(upper)
    below = np.where(high, upper - width, center - 0.5 * width)
    above = np.where(low, lower + width, center + 0.5 * width)
    return np.where(low, lower, below), np.where(high, upper, above)


def _turns(mechanism: Mechanism) -> Array:
    return np.array([joint.kind.is_revolute for joint in mechanism.primary_joints])


def characteristic_rate(mechanism: Mechanism) -> float:
    """The characteristic rate sqrt(g/L) of a `mechanism`, in 1/s, at which kinetic and potential energy are of similar
    size: g is its gravity in m/s^2, the standard one where it has none, L its characteristic length in m. Nothing is
    raised."""
    gravity = float(np.linalg.norm(mechanism.description.gravity)) or float(np.linalg.norm(STANDARD_GRAVITY))
    return float(np.sqrt(gravity / characteristic_length(mechanism)))
