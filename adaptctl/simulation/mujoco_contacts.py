"""Contacts of an arm with itself and with its scene in MuJoCo, along what it is to follow."""

from __future__ import annotations

import warnings
from collections import Counter

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.errors import InputError, ReferenceWarning
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

TIMES, HORIZON = 201, 20.0
"""at how many times references are looked at, and for how long, s"""
NEARER, ATTEMPTS = 0.8, 20
"""by which references are drawn in towards the scene's own posture, and how often"""

Pair = tuple[str, str]
"""Names of two bodies that touch."""


def contacts_at(plant: MuJoCoPlant, positions: Array) -> Counter[Pair]:
    """Counts of the pairs of bodies in contact over n positions (n, r), rad (m if prismatic), of the r joints of a
    MuJoCo `plant`'s arm: for each pair of names, at how many of the positions the two bodies penetrate each other. One
    of a pair is a body of the arm, and the one of lower index in the model stands first. All else is in the model's
    initial state; a body without a name is called "body" and its index. Raises `ValueError` for another number of
    joints."""
    import mujoco

    model, arm = plant.model, plant.arm
    data, places = mujoco.MjData(model), [int(model.jnt_qposadr[j]) for j in arm.joints]  # type: ignore[union-attr]
    found: Counter[Pair] = Counter()
    for p in positions:
        data.qpos[places] = p
        mujoco.mj_forward(model, data)
        deep = [contact.geom for contact in data.contact if contact.dist < 0.0]
        pairs = {tuple(int(model.geom_bodyid[geom]) for geom in geoms) for geoms in deep}  # type: ignore[union-attr]
        found.update({_named(model, *sorted(pair)) for pair in pairs if set(pair) & set(arm.bodies)})
    return found


def contacts_along(plant: MuJoCoPlant, reference: Reference) -> Counter[Pair]:
    """Counts of the pairs of bodies in contact along a `reference` of the r joints of a MuJoCo `plant`'s arm: for each
    pair of names, at how many of TIMES (201) times, evenly from 0 to HORIZON (20) s, the two bodies penetrate each
    other. One of a pair is a body of the arm, and the one of lower index in the model stands first. Raises `ValueError`
    for a reference of another number of joints."""
    return contacts_at(plant, reference(np.linspace(0.0, HORIZON, TIMES)).p)


def warn_of_contacts(plant: MuJoCoPlant, reference: Reference) -> None:
    """Warn (`ReferenceWarning`) where the arm of a MuJoCo `plant`, on the `reference` of its r joints, touches itself
    or the scene at any of 201 times over the first 20 s: the message names the pair of bodies that touches most often.
    Raises `ValueError` for a reference of another number of joints."""
    if not (found := contacts_along(plant, reference)):
        return
    (one, other), count = found.most_common(1)[0]
    more = f", and {len(found) - 1} more pairs of bodies" if len(found) > 1 else ""
    warnings.warn(
        f"{plant.mechanism.name}: on the reference, {one!r} and {other!r} touch at {count} of {TIMES} times{more}, "
        "which pushes the arm off, as the controller's model has no contacts: choose another reference, or exclude the "
        "pair in the scene",
        ReferenceWarning,
        stacklevel=4,
    )


def clear_of_contacts(plant: MuJoCoPlant, drawn: Sinusoids) -> Sinusoids:
    """A reference, sums of sinusoids, on which the arm of a MuJoCo `plant` touches neither itself nor the scene at any
    of 201 times over the first 20 s. It is `drawn` itself or, where the arm touches on that, a copy that stays nearer
    to the arm's posture q_0 in the model's initial state. Trial k, from 1 to 19, has the centre q_0 + 0.8^k (c - q_0),
    c being that of `drawn`, amplitudes 0.8^k times as large, and the same frequencies, phases and start time; the first
    one clear of contacts is returned.

    Raises `InputError` where the arm touches something in the last trial too, `ValueError` for another number of
    joints.
    """
    if not contacts_along(plant, drawn):
        return drawn
    model, arm = plant.model, plant.arm
    home = np.array([model.qpos0[model.jnt_qposadr[j]] for j in arm.joints])  # type: ignore[union-attr]
    for share in (NEARER**k for k in range(1, ATTEMPTS)):
        center = home + share * (drawn.center - home)
        nearer = Sinusoids(center, share * drawn.amplitude, drawn.frequency, drawn.phase, start_time=drawn.start_time)
        if not contacts_along(plant, nearer):
            return nearer
    found = contacts_at(plant, home[None])
    names = " and ".join(repr(name) for name in next(iter(found), ("it", "the scene")))
    raise InputError(
        f"{plant.mechanism.name}: no motion about the scene's own posture is free of contacts: {names} touch there"
    )


def _named(model: object, one: int, other: int) -> Pair:
    names = [model.body(i).name or f"body {i}" for i in (one, other)]  # type: ignore[attr-defined]
    return names[0], names[1]
