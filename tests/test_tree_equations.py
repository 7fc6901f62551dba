"""Accelerations of a tree are found by articulated bodies or by the mass matrix, whichever costs less."""

from __future__ import annotations

import pytest
from random_trees import random_chain, random_tree

from adaptctl.compilation import trace
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
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
