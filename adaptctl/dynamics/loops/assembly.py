"""Independent loop constraints and their dependent joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description, Pose
from adaptctl.description.loops import Closure, Loops
from adaptctl.dynamics.loops.constraint import Closing, ClosureSide, Follower, Loop, ancestry, common_ancestor
from adaptctl.dynamics.recursion.segment import Segment, placements
from adaptctl.errors import LoopError
from adaptctl.optional_packages import needed
from adaptctl.scalars import Column, Mat, Vec

_RANK = 1e-7
"""Singular values below this fraction of the largest count as zero."""

_REGULAR = 1e-5
_LITTLE = 1e-3
"""rad or m"""


def assembled(description: Description, loops: Loops, links: Sequence[Segment]) -> tuple[Closing, Array]:
    """Independent closure conditions, and the closed reference configuration (n,)."""
    every = _everything(description, loops)
    elements = _element_names(loops, every)
    guess = _guess(description, loops)
    # First with every joint free, so that primary joints that do not fit are named as such.
    nearest = _closed(description.name, every, links, guess, range(len(guess)), elements)
    # A little way on, so that a singular reference is not mistaken for constraints or joints that do not fit.
    generic = _jacobian(every, links, _nearby(description.name, every, links, nearest))
    rank = _rank(generic)
    _validate_no_redundancy(description.name, generic, elements)
    _validate_fit(description, every, generic, rank)
    hint = {description.joint_names[i]: round(float(nearest[i]), 4) for i in every.primary}
    q = _closed(description.name, every, links, guess, every.dependent, elements, f"; it closes at {hint}")
    jacobian = _jacobian(every, links, q)
    _validate_regular(description, every, links, q, rank)
    rows = _independent_rows(jacobian[:, every.dependent], rank)
    return Closing(every.loops, every.followers, rows, every.primary, every.dependent), q


def _guess(description: Description, loops: Loops) -> Array:
    """Reference (n,), zero where not given; followers at their leaders, however far, as steps from there are short."""
    index = {name: i for i, name in enumerate(description.joint_names)}
    guess = np.array([loops.reference.get(name, 0.0) for name in index])
    for c in loops.couplings:
        if c.follower not in loops.reference:
            guess[index[c.follower]] = c.ratio * guess[index[c.leader]] + c.offset
    return guess


def _everything(description: Description, loops: Loops) -> Closing:
    index = {name: i for i, name in enumerate(description.joint_names)}
    closed = tuple(_loop(description, closure) for closure in loops.closures)
    followers = tuple(Follower(index[c.follower], index[c.leader], c.ratio, c.offset) for c in loops.couplings)
    rows = sum(loop.kind.rows for loop in closed) + len(followers)
    primary = description.primary
    dependent = tuple(i for i in range(len(description.links)) if i not in primary)
    return Closing(closed, followers, tuple(range(rows)), primary, dependent)


def _loop(description: Description, closure: Closure) -> Loop:
    names = {link.name: i for i, link in enumerate(description.links)}
    first, second = (GROUND if name is None else names[name] for name in (closure.first, closure.second))
    parting = common_ancestor(description.parents, first, second)

    def side(link: int, frame: Pose) -> ClosureSide:
        above = ancestry(description.parents, link)
        below = above[above.index(parting) + 1 :] if parting in above else above
        return ClosureSide(tuple(below), Mat.of(frame.rotation.tolist()), Vec(*frame.translation.tolist()))

    return Loop(side(first, closure.first_frame), side(second, closure.second_frame), closure.kind)


def _element_names(loops: Loops, every: Closing) -> list[str]:
    pairs = zip(loops.closures, every.loops, strict=True)
    names = [f"closure {closure.name!r}" for closure, loop in pairs for _ in range(loop.kind.rows)]
    return names + [f"coupling {coupling.name!r}" for coupling in loops.couplings]


def _residual(every: Closing, links: Sequence[Segment], q: Array) -> Array:
    column = Column(q.tolist())
    return np.array(every.residual(placements(tuple(links), column), column).of, dtype=np.float64)


def _jacobian(every: Closing, links: Sequence[Segment], q: Array) -> Array:
    columns = every.jacobian(placements(tuple(links), Column(q.tolist())))
    return np.array([column.of for column in columns], dtype=np.float64).T


def _closed(
    name: str,
    every: Closing,
    links: Sequence[Segment],
    guess: Array,
    joints: Sequence[int],
    elements: Sequence[str],
    hint: str = "",
) -> Array:
    q, free = guess.copy(), list(joints)
    for _ in range(100):
        gap = _residual(every, links, q)
        if np.abs(gap).max(initial=0.0) < 1e-13:
            return q
        step = np.linalg.lstsq(_jacobian(every, links, q)[:, free], gap, rcond=1e-10)[0]
        q[free] -= step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
    gap = _residual(every, links, q)
    worst = int(np.abs(gap).argmax())
    if abs(gap[worst]) > 1e-11:
        raise LoopError(
            f"{name}: {elements[worst]} cannot close at the reference configuration: {abs(gap[worst]):.3g} (m or rad) "
            f"remains; check lengths and frames, or give a reference closer to a closed configuration{hint}"
        )
    return q


def _nearby(name: str, every: Closing, links: Sequence[Segment], q: Array) -> Array:
    jacobian = _jacobian(every, links, q)
    free = np.eye(len(q)) - np.linalg.pinv(jacobian, rcond=_RANK) @ jacobian
    way = free @ np.random.default_rng(0).normal(size=len(q))
    size = np.abs(way).max(initial=0.0)
    if size < 1e-9:
        return q
    moved = q + _LITTLE / size * way
    for _ in range(20):
        step = np.linalg.pinv(_jacobian(every, links, moved), rcond=1e-9) @ _residual(every, links, moved)
        moved = moved - step
    if np.abs(moved - q).max() < 1e-2 * _LITTLE:
        raise LoopError(f"{name}: the mechanism is locked: its loops close only at the reference; check lengths")
    return moved


def _rank(matrix: Array) -> int:
    values = np.linalg.svd(matrix, compute_uv=False)
    return int((values > _RANK * values[0]).sum()) if values.size and values[0] > 0.0 else 0


def _validate_no_redundancy(name: str, jacobian: Array, elements: Sequence[str]) -> None:
    before = 0
    for element in dict.fromkeys(elements):
        last = len(elements) - elements[::-1].index(element)
        rank = _rank(jacobian[:last])
        if rank == before:
            raise LoopError(f"{name}: {element} is redundant: other constraints imply it; remove it")
        before = rank


def _validate_fit(description: Description, every: Closing, jacobian: Array, rank: int) -> None:
    free, joints = len(description.links) - rank, description.joint_names
    if free == 0:
        raise LoopError(f"{description.name}: the mechanism is locked: {rank} constraints fix all {len(joints)} joints")
    block = jacobian[:, every.dependent]
    if len(every.primary) > free:
        _blame(description, jacobian[:, every.primary], block, free)
    if _rank(block) < len(every.dependent):
        loose = np.linalg.svd(block)[2][_rank(block) :]
        names = [joints[i] for i, share in zip(every.dependent, np.abs(loose).max(0), strict=True) if share > 1e-6]
        wanted = f"{free} joints must be primary, but only {len(every.primary)} are"
        raise LoopError(
            f"{description.name}: the primary joints do not determine {', '.join(names)}: {wanted}; make "
            f"{'one of these' if len(names) > 1 else 'it'} primary"
        )


def _blame(description: Description, primary: Array, block: Array, free: int) -> NoReturn:
    unbound = np.linalg.svd(block)[0][:, _rank(block) :]
    shares = np.abs(unbound.T @ primary).max(0)
    names = [description.joint_names[i] for i in description.primary]
    bound = [name for name, share in zip(names, shares, strict=True) if share > _RANK]
    raise LoopError(
        f"{description.name}: {len(description.primary)} joints are primary, but the loops have only {free} degrees of "
        f"freedom: {', '.join(bound)} depend on each other; remove {len(description.primary) - free} of them"
    )


def _validate_regular(description: Description, every: Closing, links: Sequence[Segment], q: Array, rank: int) -> None:
    ahead = _nearby(description.name, every, links, q)
    here, nearby = (_rank(_jacobian(every, links, x)) for x in (q, ahead))
    dependent = _dependent_rank(_jacobian(every, links, q)[:, every.dependent])
    if not here == nearby == dependent == rank:
        raise LoopError(
            f"{description.name}: the reference configuration is singular: of {max(rank, nearby)} constraints that are "
            f"independent nearby, the dependent joints can satisfy only {dependent} there; give another reference"
        )


def _dependent_rank(block: Array) -> int:
    values = np.linalg.svd(block / np.maximum(np.linalg.norm(block, axis=0), 1e-300), compute_uv=False)
    return int((values > _REGULAR).sum())


@needed("a mechanism with loops")
def _independent_rows(block: Array, rank: int) -> tuple[int, ...]:
    from scipy.linalg import qr  # loaded only where there are loops

    _, _, order = qr(block.T, mode="economic", pivoting=True)
    return tuple(sorted(int(i) for i in order[:rank]))
