"""The interface of equations: what all families share holds for each, and nobody asks which family one is."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_loops import RECIPES, random_loop
from random_trees import random_tree

import adaptctl
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.motion import Motion
from adaptctl.errors import InputError
from adaptctl.identifiability import Constraints, constrained
from adaptctl.scalars import Column, column

ROOT = Path(adaptctl.__file__).parent


def known(mechanism: Mechanism, value: float) -> Mechanism:
    """The mechanism with one moment of the last link known."""
    return constrained(mechanism, Constraints({mechanism.parameter_names[mechanism.num_energy_parameters - 1]: value}))


TREE = random_tree(3, 4).with_drives(Drive(0.3, 0.2, 0.1))
LOOPS = random_loop(1, RECIPES["planar weld"])[0].with_drives(Drive(0.3, 0.2, 0.1))
MECHANISMS = {
    "tree": TREE,
    "loops": LOOPS,
    "tree, a zero known": known(TREE, 0.0),
    "tree, a value known": known(TREE, 0.2),
    "loops, a value known": known(LOOPS, 0.2),
}


@pytest.fixture(params=MECHANISMS)
def mechanism(request: pytest.FixtureRequest) -> Mechanism:
    return MECHANISMS[request.param]


def states(mechanism: Mechanism) -> list[np.ndarray]:
    """A configuration near home, and velocities, other velocities and accelerations."""
    rng = np.random.default_rng(5)
    p = mechanism.neutral_configuration + 0.01 * rng.normal(size=mechanism.dof)
    return [mechanism.configuration(p), *rng.normal(size=(3, mechanism.dof))]


def numbers(rows: list[Column]) -> np.ndarray:
    return np.array([row.of for row in rows])


def test_sizes_are_the_mechanisms(mechanism: Mechanism) -> None:
    e = mechanism.equations
    assert (e.dof, e.parameters) == (mechanism.dof, len(mechanism.parameter_names))
    assert e.num_joints == len(e.links) == len(mechanism.links)
    motion = e.motion(*map(column, states(mechanism)))
    assert isinstance(e, Equations)
    assert isinstance(motion, Motion)
    assert len(motion.numbers) == len(e.motion_memory.sources)


def test_accelerations_are_those_of_the_shared_definition(mechanism: Mechanism) -> None:
    """Families that share work between bias and mass matrix compute the same."""
    e, (q, v, torque, _) = mechanism.equations, states(mechanism)
    D = Column(mechanism.inertial_parameters.tolist())
    own = e.forward_dynamics(column(q), column(v), column(torque), D)
    shared = Equations.forward_dynamics(e, column(q), column(v), column(torque), D)
    np.testing.assert_allclose(own.of, shared.of, rtol=1e-9, atol=1e-12)


def test_weightless_equations_are_those_without_gravity(mechanism: Mechanism) -> None:
    e, arguments = mechanism.equations, list(map(column, states(mechanism)))
    D, everything = Column(mechanism.inertial_parameters.tolist()), range(e.parameters)
    floating = e.without_gravity()
    whole = Mechanism(replace(mechanism.description, gravity=np.zeros(3)))
    expected = whole.equations.inverse_dynamics(*arguments, Column(whole.inertial_parameters.tolist()))
    np.testing.assert_allclose(floating.inverse_dynamics(*arguments, D).of, expected.of, rtol=1e-12, atol=1e-12)
    still = Column.zeros(e.dof)
    rows = numbers(floating.torque_regressor(arguments[0], still, still, still, everything))
    np.testing.assert_allclose(rows, np.zeros_like(rows), atol=1e-14)
    assert np.abs(numbers(e.torque_regressor(arguments[0], still, still, still, everything))).max() > 0.1


def test_known_torque_is_what_regressors_leave_out(mechanism: Mechanism) -> None:
    q, v, _, a = states(mechanism)
    p = np.tile(q[list(mechanism.description.primary)], (3, 2, 1))
    share = mechanism.constraint_bias_torque(p, v, a)
    assert share.shape == (3, 2, mechanism.dof)
    by_regressor = mechanism.torque_regressor(p, v, a) @ mechanism.inertial_parameters
    np.testing.assert_allclose(by_regressor + share, mechanism.inverse_dynamics(p, v, a), rtol=1e-10, atol=1e-12)
    assert bool(np.abs(share).max()) is mechanism.equations.has_constraint_bias
    with pytest.raises(InputError, match=r"a: expected shape \(\.\.\., "):
        mechanism.constraint_bias_torque(p, v, np.zeros(99))


def test_which_mechanisms_are_plain_trees() -> None:
    assert [name for name, one in MECHANISMS.items() if one.is_plain_tree] == ["tree"]
    assert load("puma560_friction").is_plain_tree


def test_relations_are_given_at_once(mechanism: Mechanism) -> None:
    if mechanism.parameter_names == mechanism.description.parameter_names:
        known(mechanism, 0.1)
        return
    with pytest.raises(InputError, match="is constrained already"):
        known(mechanism, 0.1)


def test_nobody_asks_which_family_equations_are_of() -> None:
    """What differs between families is asked of the equations or the mechanism."""
    families = {"TreeEquations", "LoopEquations", "ConstrainedEquations", "ConstrainedMechanism"}
    asked = [
        f"{path}: {ast.unparse(node)}"
        for path in ROOT.glob("**/*.py")
        if any(family in (text := path.read_text()) for family in families)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "type")
        if families & {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
    ]
    assert asked == []
