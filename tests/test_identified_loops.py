"""Closed loops from logs: a parallelogram with springs is one thing by its closure and by its couplings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from nightly import nightly
from synthetic_logs import guessed, joint_drives, motion

from adaptctl.description import Coupling
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.identification.columns import JointLog
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.identify import identified

LINK = """
[[links]]
name = "{name}"
joint = "{joint}"
type = "{kind}"
{parent}position = {position}
rpy_deg = {turn}
mass = {mass}
center_of_mass = {center}
inertia_at_center = {{ xx = 0.02, yy = 0.03, zz = 0.025 }}
"""
LINKS = (
    ("crank", "q1", "revolute", "", [0.0, 0.0, 0.0], [90.0, 0.0, 0.0], 2.0, [0.2, 0.01, 0.0]),
    ("rod", "j_rod", "revolute", "crank", [0.4, 0.0, 0.0], [0.0, 0.0, 0.0], 1.5, [0.15, 0.0, 0.0]),
    ("slide", "q2", "prismatic", "rod", [0.1, 0.0, 0.0], [-90.0, 0.0, 0.0], 1.0, [0.05, 0.0, 0.1]),
    ("rocker", "j_rocker", "revolute", "", [0.3, 0.0, 0.0], [90.0, 0.0, 0.0], 1.2, [0.2, 0.0, 0.0]),
)
HEAD = """schema = "adaptctl/mechanism/1"
name = "parallelogram"
gravity = [0.0, 0.0, -9.81]
primary = ["q1", "q2"]
reference = { q1 = 1.4, j_rod = -1.4, q2 = 0.1, j_rocker = 1.4 }
"""
CLOSURE = """
[[closures]]
name = "end"
first = { link = "rod", position = [0.3, 0.0, 0.0] }
second = { link = "rocker", position = [0.4, 0.0, 0.0] }
"""
STIFFNESS, REST = np.array([25.0, 300.0]), np.array([0.2, 0.1])
VISCOUS, COULOMB = np.array([0.4, 6.0]), np.array([0.3, 2.0])
RATIOS = {"q1": [1.0, 0.0], "j_rod": [-1.0, 0.0], "q2": [0.0, 1.0], "j_rocker": [1.0, 0.0]}


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    path: Path = tmp_path_factory.mktemp("robots") / "parallelogram.toml"
    names = ("name", "joint", "kind", "parent", "position", "turn", "mass", "center")
    links = [dict(zip(names, link, strict=True)) for link in LINKS]
    for link in links:
        link["parent"] = f'parent = "{link["parent"]}"\n' if link["parent"] else ""
    texts = [LINK.format(**link) for link in links]
    path.write_text(HEAD + "".join(texts) + CLOSURE)
    return load(path)


def coupled(closed: Mechanism) -> Mechanism:
    """The same tree whose joints follow the crank, without a closure."""
    assert closed.description.loops is not None
    ratios = (("j_rod", -1.0), ("j_rocker", 1.0))
    couplings = tuple(Coupling(f"to {name}", follower=name, leader="q1", ratio=ratio) for name, ratio in ratios)
    loops = replace(closed.description.loops, closures=(), couplings=couplings)
    return Mechanism(replace(closed.description, loops=loops))


def log(truth: Mechanism) -> JointLog:
    """Torques by Pinocchio on the spanning tree, projected by the joints' ratios, with springs, friction and noise."""
    model, rng = truth.to_pinocchio(), np.random.default_rng(0)
    data = model.createData()
    J = np.array([RATIOS[name] for name in list(model.names)[1:]])
    time, p, v, a = motion(2, rng, 20.0, 100.0)
    size = np.array([0.4, 0.1])
    p, v, a = p * size + [1.4, 0.1], v * size, a * size
    states = zip(p, v, a, strict=True)
    torque = np.array([J.T @ pinocchio.rnea(model, data, *(J @ x for x in state)) for state in states])
    torque += STIFFNESS * (p - REST) + VISCOUS * v + COULOMB * v / np.sqrt(v**2 + 1e-4)
    noise = 0.01 * np.sqrt(np.mean(torque**2, axis=0)) * rng.normal(size=torque.shape)
    return JointLog("linkage.csv", time, p, torque + noise)


@nightly
def test_a_closure_and_its_couplings_are_identified_alike(closed: Mechanism) -> None:
    truth = guessed(closed.with_drives(Drive()), np.random.default_rng(3), 0.2)
    own, terms = log(truth), FrictionModel.named("viscous,coulomb,offset,stiffness")
    found = [
        identified(one, joint_drives(one), [own], friction=terms, skip_steps=("limits",), cutoff=10.0, prior_weight=1.0)
        for one in (closed, coupled(closed))
    ]
    first, second = (one.validation.rms_error for one in found)
    assert first == pytest.approx(second, rel=1e-9)
    assert found[0].validation.relative_error < 0.01
    for one in found:
        for joint, stiffness in zip(("q1", "q2"), STIFFNESS, strict=True):
            k = one.names.index(f"{joint}.stiffness")
            assert abs(one.estimate[k] - stiffness) < 3.0 * one.deviations[k]
