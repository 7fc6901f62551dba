"""Sampling rates that change within a log whose times do not say so."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.logs.on_disk import release

# Rows that are compared at a time, with so many before them, and rows of the ways that are compared.
COMPARED, BEFORE, SPANS = 2**17, 2**13, (1, 2, 4)
# Change of the ways at one row over the largest elsewhere, cosine of the ways, least and greatest factor between them,
# share of its logarithm by which that a span further off may differ, and least way of a second joint over the largest,
# from where on the rate changed there.
CLEAR, ALONG, LEAST, MOST, SAME, SECOND = 2.0, 0.97, 1.5, 15.0, 0.3, 0.2


def validate_one_rate(log: JointLog) -> None:
    """Refuse a log in which all joints move further or less far by one factor from some row on, as no arm does."""
    for start in range(0, len(log), COMPARED):
        release()
        first = max(start - BEFORE, 0)
        position = log.position[first : start + COMPARED]
        if found := max(filter(None, (_bend(position, span) for span in SPANS)), default=None):
            _, row, factor = found
            _refuse(log.source, log.time[first + row], factor)


def _refuse(source: str, time: float, factor: float) -> NoReturn:
    raise InputError(
        f"{source}: from {time:.6g} s on, all joints at once move {factor:.2g} times as far from row to row: the "
        "sampling rate changes there, and the times do not say so; give each row its own time, or cut the log there "
        "and give each part with its rate"
    )


def _bend(position: Array, span: int) -> tuple[float, int, float] | None:
    """Change of the ways at a row over the largest elsewhere, the row, and their factor, if that is a rate's."""
    ways = position[span:] - position[:-span]
    size = np.sqrt(np.mean(np.square(ways), axis=0))
    ways = ways / np.where(size > 0.0, size, 1.0)
    change = np.linalg.norm(ways[span:] - ways[:-span], axis=1)
    k = int(change.argmax())
    if not span <= k < len(change) - span:
        return None
    elsewhere = max(change[: k - span].max(initial=0.0), change[k + 2 * span :].max(initial=0.0))
    clear = float(change[k] / max(elsewhere, np.finfo(float).tiny))
    sizes = np.maximum(np.linalg.norm(ways[[k - span, k + 2 * span]], axis=1), np.finfo(float).eps)
    near, far = np.log([_factor(ways[k], ways[k + span]), sizes[1] / sizes[0]])
    lasting = abs(near - far) < SAME * abs(near) and np.log(LEAST) < abs(near) < np.log(MOST)
    return (clear, k + span, float(np.exp(near))) if lasting and clear > CLEAR else None


def _factor(before: Array, after: Array) -> float:
    """Factor by which several joints all move further; 1 if they do not."""
    product, sizes = float(before @ after), np.sort(np.abs(before))
    if sizes[-2:-1].sum() <= SECOND * sizes[-1] or product <= ALONG * np.linalg.norm(before) * np.linalg.norm(after):
        return 1.0
    return product / float(before @ before)
