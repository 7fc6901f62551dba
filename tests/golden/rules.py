"""What rules choose for arms: references, gains, ranges and learning laws, each by four numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, replace
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
DESIGNED = ("two_link", "cart.toml")
"""Those that small gains are designed for, which takes longer"""
PERIOD = 2e-3
"""s"""


def rules() -> dict[str, Any]:
    """What is chosen and designed for each arm."""
    return {name: chosen_and_designed(name) for name in ARMS}


def chosen_and_designed(name: str) -> dict[str, str]:
    return chosen(arm(name)) | (designed(arm(name)) if name in DESIGNED else {})


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


def designed(mechanism: Any) -> dict[str, str]:
    """Numbers of designs of feedback with their margins, of a workspace's worst place, and of a motion that excites."""
    from adaptctl import ReducedModel, control
    from adaptctl.control.adaptation.prior_ranges import parameter_sampling_ratios
    from adaptctl.control.gains.sampling_ratio import sampling_ratio

    model, gains = ReducedModel.full(mechanism), control.Gains.from_bandwidth(mechanism, 5.0)
    workspace = control.Workspace.within_limits(mechanism, 20)
    designs = {
        "gains": control.GainDesign.from_gains(mechanism, gains, workspace, control_period=PERIOD),
        "bandwidth": control.GainDesign.from_bandwidth(mechanism, 6.0, 0.7, control_period=PERIOD, delay=1),
        "poles": control.GainDesign.from_poles(mechanism, [-8.0, -12.0], control_period=PERIOD),
        "lqr": control.GainDesign.from_lqr(mechanism, 4096.0, 2.0, control_period=PERIOD),
    }
    names = ("inertia", "least_inertia", "max_pole_magnitude", "max_bandwidth_factor")
    found = {f"{kind}.{name}": getattr(one, name) for kind, one in designs.items() for name in names}
    found |= {f"{kind}.margins": [astuple(x) for x in one.margins] for kind, one in designs.items()}
    found["workspace"] = workspace.samples
    found["ratio"] = sampling_ratio(mechanism, gains.damping, PERIOD, workspace=workspace).value
    found["ratios"] = parameter_sampling_ratios(model, 5.0, PERIOD)
    found["adaptation_gain"] = control.adaptation_gain(model, gains=gains, control_period=PERIOD)
    found["stiffness"] = control.largest_stiffness(gains.damping, PERIOD, 1)
    moving = control.excitation_trajectory(ReducedModel(mechanism), harmonics=2, iterations=1)
    found |= {"exciting.condition": moving.condition, "exciting.random": moving.random_conditions}
    return {f"designed.{name}": told(value) for name, value in found.items()}
