"""Instants at which unknown bodies are taken, from logs none of which is without them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from adaptctl.arrays import Array
from adaptctl.identification.columns import same_place
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION
from adaptctl.identification.least_squares import least_squares, weighted_least_squares
from adaptctl.identification.loaded_equations import SLOW
from adaptctl.identification.payloads import in_log, payload_place
from adaptctl.stages import stage

# A body carried throughout cannot be told from the link that carries it, so that a log with it alone is taken to begin
# without it. The instant is the one by which two robots, of which the second's link has ten parameters of its own,
# leave the least squares: first of this many, then of as many between the neighbours of the best.
INSTANTS = 100


@stage("finding when bodies are taken")
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
    columns = evidence.independent(FitSettings(SIMPLE_FRICTION, 1.0, cutoff, SLOW))
    first = 10 * evidence.mechanism.description.body_names.index(payload_place(payload, evidence.mechanism).link)
    own = [*columns.tolist(), *range(first, first + 10)]
    times = [log.time for log in evidence.logs if same_place(payload.log, log.source)]
    edges = np.linspace(min(time[0] for time in times), max(time[-1] for time in times), INSTANTS + 1)
    weight = 1.0 / weighted_least_squares(evidence.sums(cutoff, SLOW), columns)[1]
    found = 0.0
    for _ in range(2):
        best = int(np.argmax(_explained(*_between(edges, payload, evidence, cutoff, own, weight), len(columns))))
        found = float(edges[best + 1])
        edges = np.unique([edges[0], *np.linspace(edges[best], edges[best + 2], INSTANTS), edges[-1]])
    return found


def _between(
    edges: Array, payload: PayloadEntry, evidence: LogEvidence, cutoff: float, columns: Sequence[int], weight: Array
) -> tuple[Array, Array]:
    """Normal matrices (E, k, k) and moments (E, k) of a payload's log between instants (E + 1,) in s."""
    count, k = len(edges) - 1, len(columns)
    N, m = np.zeros((count, k, k)), np.zeros((count, k))
    for rows, motions, _, peaks in evidence.parts(cutoff):
        here = in_log(payload, rows, motions)
        counted = weight * (rows.used(SLOW * peaks) & here[:, None])
        Y, torque = rows.regressor[..., columns] * counted[..., None], rows.torque * counted
        place = np.clip(np.searchsorted(edges, rows.time, side="right") - 1, 0, count - 1)
        for e in np.unique(place[here]).tolist():
            y, t = Y[place == e].reshape(-1, k), torque[place == e].ravel()
            N[e] += y.T @ y
            m[e] += y.T @ t
    return N, m


def _explained(N: Array, m: Array, shared: int) -> Array:
    """Squares explained by a change of the last columns at each inner edge, from sums between the edges."""
    after, moment = N[::-1].cumsum(axis=0)[::-1], m[::-1].cumsum(axis=0)[::-1]
    found = []
    for k in range(1, len(N)):
        A, b = after[k].copy(), moment[k].copy()
        A[:shared, :shared], b[:shared] = after[0, :shared, :shared], moment[0, :shared]
        found.append(float(b @ least_squares(A, b, np.arange(len(b)))))
    return np.array(found)
