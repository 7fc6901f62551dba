"""Accelerations of a tree are found by articulated bodies or by the mass matrix, whichever costs less."""

from __future__ import annotations

import pytest
from random_trees import random_chain, random_tree

from adaptctl.compilation import trace
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.parameter_layout import ParameterLayout
from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.scalars import Column


def flops(equations: TreeEquations, articulated: bool) -> int:
    """Operations of the accelerations, found in one of the two ways."""
    equations.__dict__["_is_long"] = articulated  # the cached property's own place
    sizes = {"p": equations.dof, "v": equations.dof, "torque": equations.dof, "parameters": equations.parameters}

    def accelerations(p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        return equations.forward_dynamics(p, v, torque, parameters)

    return trace(accelerations, sizes).operations.flops


@pytest.mark.parametrize(
    ("tree", "articulated"),
    [
        (random_chain(0, 2), False),
        (random_chain(0, 10), False),
        (random_chain(0, 12), True),
        (random_chain(0, 12).with_drives(Drive(rotor_inertia=0.1)), True),
        (random_tree(0, 12), False),
    ],
)
def test_the_way_that_is_taken_costs_less(tree: Mechanism, articulated: bool) -> None:
    equations = TreeEquations.of(tree.description)
    assert equations._is_long is articulated
    assert flops(equations, articulated) < flops(equations, not articulated)


def test_links_without_parameters_have_ten_zeros() -> None:
    """And drives come after all tens."""
    layout = ParameterLayout(3, (0, 2), (DriveTerm(((1, 1.0),), DriveParameter.VISCOUS),))
    parameters = Column([float(k) for k in range(21)])
    assert list(layout.tens(parameters)) == [*range(10), *[0.0] * 10, *range(10, 20)]
    assert (layout.size, layout.driven, list(layout.of_drives(parameters))) == (21, 20, [20.0])
    assert layout.sorted_out([3, 15, 20]) == ({3: 3, 15: 25}, {20: 0})
    whole = layout._replace(bodies=(0, 1), links=2)
    assert list(whole.tens(parameters)) == list(range(20))
