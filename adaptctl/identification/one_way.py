"""Joints that move one way alone, where dry friction and an offset are one constant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptctl.description.drive import DriveParameter
from adaptctl.identification.fit import LogEvidence

# Share of its peak speed above which a joint moves, and share of rows of the rarer way, below which it has one way.
MOVES, BOTH_WAYS = 0.1, 0.01


def one_way_joints(evidence: LogEvidence) -> list[str]:
    """Names of the joints that move one way alone, each by its own drive."""
    velocity = evidence.rows[evidence.band].velocity
    least = MOVES * np.abs(velocity).max(axis=0)
    ways = np.stack([(velocity > least).sum(axis=0), (velocity < -least).sum(axis=0)])
    one = ways.min(axis=0) < BOTH_WAYS * ways.sum(axis=0)
    joints = zip(evidence.mechanism.primary_joints, one, strict=True)
    return [joint.name for joint, own in joints if own and not joint.drive.turns_with]


def one_way_offsets(evidence: LogEvidence) -> tuple[str, ...]:
    """Names of the offsets of joints that move one way alone, which friction takes."""
    return tuple(f"{name}.{DriveParameter.OFFSET.value}" for name in one_way_joints(evidence))


def one_way_words(evidence: LogEvidence) -> Iterator[str]:
    """Sentence on joints that move one way alone."""
    if names := one_way_joints(evidence):
        yield (
            f"{', '.join(names)}: the rows that are fitted have one way of motion, in which friction and an offset are "
            "one constant; it is taken for friction, and is wrong the other way if it is not; log motions both ways"
        )
