"""Torques whose sign turns within a log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.identification.normal_equations import NormalEquations

# Correlation with the torques of the file's links or of a fit that a turn must add to be tried, share of the rows
# before and after it, and rounds of the search for its time.
MIN_GAIN, MIN_SHARE, ROUNDS = 0.25, 0.05, 3


class TurnedTorque(NamedTuple):
    """Joint, log and time (s) from which on its torque has the other sign, and equations in which it is turned."""

    joint: int
    source: str
    time: float
    equations: NormalEquations


def turned_torques(rows: HypothesisRows, mixings: Sequence[Array]) -> Iterator[TurnedTorque]:
    """Torques that may turn their signs, which matrices (r, r) turn, one for each joint."""
    links, x = rows.evidence.prior.tens.ravel(), np.zeros(rows.packed.shape[1])
    x[: links.size] = links
    # Where friction outweighs the links, a fit tells more, unless the turn is in the middle and leaves it nothing.
    each = [rows.packed.torques(own) for own in (x, rows.least(rows.mixed(np.eye(len(mixings))))[0])]
    for source, (j, mixing) in product(rows.sources, enumerate(mixings)):
        here = rows.of_source(source)
        time, gain = max((_turn(rows, here, told, j) for told in each), key=itemgetter(1))
        if gain > MIN_GAIN:
            yield _fitted(rows, TurnedTorque(j, source, time, rows.mixed(np.eye(len(mixings)))), mixing)


def _fitted(rows: HypothesisRows, turn: TurnedTorque, mixing: Array) -> TurnedTorque:
    """Turn at the time that fits best, by torques that are predicted instead of those of the file's links."""
    here = rows.of_source(turn.source)
    for _ in range(ROUNDS):
        after = (here & (rows.rows.time >= turn.time))[:, None]
        equations = rows.sums(rows.packed, np.where(after, rows.rows.torque @ mixing.T, rows.rows.torque))
        told = rows.packed.torques(rows.least(equations)[0])
        turn = turn._replace(time=_turn(rows, here, told, turn.joint)[0], equations=equations)
    return turn


def _turn(rows: HypothesisRows, here: NDArray[np.bool_], told: Array, j: int) -> tuple[float, float]:
    """Time (s) from which on a joint's torque best agrees with the negative of one told, and correlation so added."""
    found = np.flatnonzero(here & rows.used[:, j])
    found = found[np.argsort(rows.rows.time[found], kind="stable")]
    edge = 1 + int(MIN_SHARE * len(found))
    if len(found) <= 2 * edge:
        return np.inf, 0.0
    torque, other = rows.rows.torque[found, j], told[found, j]
    before = np.cumsum(torque * other)
    turned = np.abs(2.0 * before - before[-1])[edge:-edge]
    k = int(turned.argmax())
    size = max(float(np.linalg.norm(torque) * np.linalg.norm(other)), np.finfo(float).tiny)
    return float(rows.rows.time[found[edge + k + 1]]), float(turned[k] - abs(before[-1])) / size
