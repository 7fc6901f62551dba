"""Torques whose sign turns within a log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.identification.normal_equations import NormalEquations

# Share of a joint's squares left by least squares that a turn must take to be tried, share of its rows before and after
# it, and rounds of the search for its time, each by the joints' deviations of the round before.
MIN_GAIN, MIN_SHARE, ROUNDS = 0.25, 0.05, 3


class TurnedTorque(NamedTuple):
    """Joint, log and time (s) from which on its torque has the other sign, and equations in which it is turned."""

    joint: int
    source: str
    time: float
    equations: NormalEquations


def turned_torques(rows: HypothesisRows, mixings: Sequence[Array]) -> Iterator[TurnedTorque]:
    """Torques that may turn their signs, which matrices (r, r) turn, one for each joint."""
    as_is = rows.least(rows.mixed(np.eye(len(mixings))))[1]
    for source, (j, mixing) in product(rows.sources, enumerate(mixings)):
        here, deviations = rows.of_source(source), as_is
        for _ in range(ROUNDS):
            time, gain = _turn(rows, here & rows.used[:, j], mixing, deviations, j)
            if gain < MIN_GAIN:
                break
            after = (here & (rows.rows.time >= time))[:, None]
            equations = rows.sums(rows.packed, np.where(after, rows.rows.torque @ mixing.T, rows.rows.torque))
            deviations = rows.least(equations)[1]
        else:
            yield TurnedTorque(j, source, time, equations)


def _turn(
    rows: HypothesisRows, here: NDArray[np.bool_], mixing: Array, deviations: Array, j: int
) -> tuple[float, float]:
    """Time (s) from which on a joint's torque is best turned by a matrix, and share of its squares so explained."""
    found = np.flatnonzero(here)
    found = found[np.argsort(rows.rows.time[found], kind="stable")]
    edge = 1 + int(MIN_SHARE * len(found))
    if len(found) <= 2 * edge:
        return np.inf, 0.0
    columns, values = rows.packed.joint(j)
    change = (rows.rows.torque[found] @ (mixing[j] - np.eye(len(mixing))[j]))[:, None] * values[found]
    later = np.cumsum(change[::-1], axis=0)[::-1][edge:-edge]
    explained = rows.explained(columns, np.vstack([np.zeros(len(columns)), later]) / deviations[j] ** 2, deviations)
    k = int(explained[1:].argmax())
    return float(rows.rows.time[found[edge + k]]), float((explained[1 + k] - explained[0]) / len(found))
