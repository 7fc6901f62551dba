"""Instants at which unknown bodies are taken, from logs none of which is without them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.columns import same_place
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION
from adaptctl.identification.least_squares import least_squares, weighted_least_squares
from adaptctl.identification.loaded_equations import SLOW
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.payloads import payload_place

# A body carried throughout cannot be told from the link that carries it, so that a log with it alone is taken to begin
# without it. The instant is the one by which two robots, of which the second's link has ten parameters of its own,
# leave the least squares: first of this many, then of as many between the neighbours of the best.
INSTANTS = 100


def with_instants(evidence: LogEvidence, cutoff: float) -> tuple[Drives, tuple[str, ...]]:
    """Drives whose bodies are taken at instants found, where all logs have an unknown one from the start; in words."""
    drives = evidence.drives
    open_ones = [one for one in drives.payloads if not one.is_known and one.after == -math.inf]
    sources = {motion.log.source for motion in evidence.motions}
    carrying = {source for source in sources if any(same_place(one.log, source) for one in open_ones)}
    if np.isnan(drives.constants).any() or carrying != sources:
        return drives, ()
    found = {id(one): _instant(one, evidence, cutoff) for one in open_ones}
    payloads = tuple(structs.replace(one, after=found.get(id(one), one.after)) for one in drives.payloads)
    words = tuple(
        f"payload in {one.log}: no log is without it, so that it is taken at the instant that explains the log best, "
        f"{found[id(one)]:.2f} s"
        for one in open_ones
    )
    return replace(drives, payloads=payloads), words


def _instant(payload: PayloadEntry, evidence: LogEvidence, cutoff: float) -> float:
    numbers = [motion.number for motion in evidence.motions if same_place(payload.log, motion.log.source)]
    here = np.isin(evidence.rows[cutoff].log, numbers)
    rows, used = evidence.rows[cutoff].chosen(here), evidence.used(cutoff, SLOW)[here]
    columns = evidence.independent(FitSettings(SIMPLE_FRICTION, 1.0, cutoff, SLOW))
    whole = NormalEquations.of(rows, np.zeros(len(rows), dtype=np.int64), 1, used)
    weight = used / weighted_least_squares(whole, columns)[1]
    first = 10 * evidence.mechanism.description.body_names.index(payload_place(payload, evidence.mechanism).link)
    Y = rows.regressor[..., [*columns.tolist(), *range(first, first + 10)]] * weight[..., None]
    torque = rows.torque * weight
    edges = np.linspace(0, len(rows), INSTANTS + 1).astype(np.int64)
    for _ in range(2):
        best = int(np.argmax(_explained(Y, torque, edges, len(columns))))
        inner = edges[best], edges[min(best + 2, len(edges) - 1)]
        place = int(edges[best + 1])
        edges = np.unique([0, *np.linspace(*inner, INSTANTS).astype(np.int64), len(rows)])
    return float(rows.time[place])


def _explained(Y: Array, torque: Array, edges: NDArray[np.int64], shared: int) -> Array:
    """Squares explained by a change of the last columns at each inner edge."""
    parts = [(Y[a:b].reshape(-1, Y.shape[-1]), torque[a:b].ravel()) for a, b in pairwise(edges.tolist())]
    N, m = np.array([y.T @ y for y, _ in parts]), np.array([y.T @ t for y, t in parts])
    after, moment = N[::-1].cumsum(axis=0)[::-1], m[::-1].cumsum(axis=0)[::-1]
    found = []
    for k in range(1, len(parts)):
        A, b = after[k].copy(), moment[k].copy()
        A[:shared, :shared], b[:shared] = after[0, :shared, :shared], moment[0, :shared]
        found.append(float(b @ least_squares(A, b, np.arange(len(b)))))
    return np.array(found)
