"""Logged velocities beside those that positions show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.logs.on_disk import each_column

# Largest relative difference of logged velocities from differentiated positions.
MAX_VELOCITY_DIFFERENCE = 0.1
# rad/s (m/s) of a joint at rest.
REST_SPEED = 1e-3


def compared_velocities(source: str, logs: Sequence[JointLog], speeds: Sequence[Array], mechanism: Mechanism) -> str:
    """Words on logged velocities beside those found from positions; `InputError` where they differ."""
    logged = [log.velocity for log in logs if log.velocity is not None]
    if len(logged) < len(logs):
        return "no logged velocities"
    pairs = zip(whole_columns(logged), whole_columns(speeds), strict=True)
    ratios = np.array([_ratio(*pair) for pair in pairs])
    for joint, ratio in zip(mechanism.primary_joints, ratios.tolist(), strict=True):
        if not abs(ratio - 1.0) <= MAX_VELOCITY_DIFFERENCE:
            _validate_kept_apart(source, logs)
            raise InputError(
                f"{source}: joint {joint.name!r}: logged velocities are {ratio:.4g} times the differentiated "
                f"positions{_explained(ratio)}; give the right units, or omit the velocities"
            )
    return f"logged velocities are {ratios.min():.3f} to {ratios.max():.3f} of differentiated positions"


def _validate_kept_apart(source: str, logs: Sequence[JointLog]) -> None:
    """Refuse logs of which, in all joints, positions stand for velocities, or these for those."""
    position = [log.position for log in logs]
    logged = [log.velocity for log in logs if log.velocity is not None]
    rates = [np.gradient(own, log.time, axis=0) for own, log in zip(logged, logs, strict=True)]
    if _are_alike(rates, position):
        raise InputError(
            f"{source}: in all joints, the columns of velocity change as fast as those of position say: they are "
            "exchanged; exchange their names, in the log or by columns"
        )
    if _are_alike(logged, position):
        raise InputError(
            f"{source}: in all joints, the columns of position and velocity have the same values: positions are given "
            "as velocities, or these as positions; give each its own, or omit the velocities if positions are right"
        )


def _are_alike(logged: Sequence[Array], found: Sequence[Array]) -> bool:
    """True if each column of some parts is that of others."""
    pairs = zip(whole_columns(logged), whole_columns(found), strict=True)
    return all(abs(_ratio(*pair) - 1.0) <= MAX_VELOCITY_DIFFERENCE for pair in pairs)


def _ratio(logged: Array, found: Array) -> float:
    """Factor of logged velocities over found ones; 1 where both rest."""
    if max(np.abs(found).max(), np.abs(logged).max()) <= REST_SPEED:
        return 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return float((logged * found).sum() / np.square(found).sum())


def whole_columns(parts: Sequence[Array]) -> Iterator[Array]:
    """Columns of parts (n, k) that follow each other, one column after the other."""
    each = zip(*map(each_column, parts), strict=True)
    return (own[0] if len(own) == 1 else np.concatenate(own) for own in each)


def _explained(ratio: float) -> str:
    likely = {
        57.29578: "velocities in deg/s, or positions in rad taken for deg",
        1.0 / 57.29578: "positions in deg taken for rad, or velocities in rad/s taken for deg/s",
        1000.0: "time in s taken for ms",
        0.001: "time in ms taken for s",
        1e6: "time in s taken for us",
        1e-6: "time in us taken for s",
        9.549297: "velocities in rpm",
        1.0 / 9.549297: "velocities in rad/s taken for rpm",
    }
    near = [text for value, text in likely.items() if abs(abs(ratio) / value - 1.0) < MAX_VELOCITY_DIFFERENCE]
    turned = "one of them has the wrong sign" if ratio < 0.0 else ""
    return "".join(f": {text}" for text in (near[:1] or [turned]) if text)
