"""What rules choose for arms: references, gains, ranges and learning laws, each by four numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from golden.pictures import told

HERE = Path(__file__).parent
ARMS: Mapping[str, float] = {
    "two_link": 1.0,
    "two_link with a fortieth of its torques": 0.025,
    "puma560_friction with a third of its torques": 1.0 / 3.0,
    "semi_direct_drive_parallelogram": 1.0,
    "cart.toml": 1.0,
}
"""Robots, and the share of their torque limits that they have"""
PERIOD = 2e-3
"""s"""


def rules() -> dict[str, Any]:
    """What is chosen for each arm."""
    return {name: chosen(arm(name)) for name in ARMS}


def arm(name: str) -> Any:
    """A robot with its share of its torque limits."""
    from adaptctl import load

    source = name.split()[0]
    found = load(HERE / "files" / source if "." in source else source)
    links = [
        replace(link, joint=replace(link.joint, limits=replace(link.joint.limits, effort=most)))
        for link in found.description.links
        for most in [ARMS[name] * link.joint.limits.effort]
    ]
    return type(found)(replace(found.description, links=tuple(links)))


def chosen(mechanism: Any) -> dict[str, str]:
    """Numbers of a reference, of gains, and of the law that learns."""
    from adaptctl import ReducedModel
    from adaptctl.tuning.default_gains import DefaultGains, near_reference
    from adaptctl.tuning.learning_rule import learning_by_rule

    rule = DefaultGains.for_mechanism(mechanism, control_period=PERIOD)
    carried, model = rule.carried(), ReducedModel.full(mechanism)
    found = {f"reference.{name}": getattr(rule.reference, name) for name in ("center", "amplitude", "frequency")}
    found |= {"initial_error": rule.initial_error, "ranges": rule.ranges, **rule.found._asdict()}
    found |= {**carried._asdict(), **vars(carried.gains)}
    for shares in ("ranges", "links", "parameters", "mixed"):
        proposal = rule.proposed(4.0, 0.5, 0.5, shares)
        found |= {f"gain.{shares}": proposal.gain, f"achieved.{shares}": rule.achieved(proposal)}
    law = learning_by_rule(model, np.diag(proposal.gain), rule.limits, carried.gains.damping, PERIOD, rule.reference)
    learned = ("prediction_weight", "bound", "torque_step", "cutoff", "recall", "min_speed", "delay")
    found |= {f"learning.{name}": getattr(law, name) for name in learned}
    found["workspace"] = near_reference(mechanism, rule.reference, rule.initial_error).samples
    return {name: told(value) for name, value in found.items() if name not in ("reference", "gains")}
