"""Positions whose closed configuration is known: nothing is closed anew, and nothing else changes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control import Controller, ReferencePoint, SafetyFilter, Sinusoids, SlotineLi
from adaptctl.control.pytree import leaves, like
from adaptctl.description import Pose
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.equations import ClosedPositions
from adaptctl.envs import TrackingEnv
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column
from adaptctl.simulation import rollout, simulate


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return load("semi_direct_drive")


def longer(arm: Mechanism) -> Mechanism:
    """The same with one bar 1 % longer."""
    tree = arm.description
    links = tuple(
        replace(link, parent_to_joint=Pose(link.parent_to_joint.rotation, 1.01 * link.parent_to_joint.translation))
        if i == 4
        else link
        for i, link in enumerate(tree.links)
    )
    return Mechanism(replace(tree, links=links))


def test_the_known_configuration_is_the_one_that_closing_finds(arm: Mechanism) -> None:
    equations, rng = arm.equations, np.random.default_rng(0)
    middle = np.array([0.0, -1.57, -3.14])
    for p in middle + rng.uniform(-0.3, 0.3, (20, 3)):
        q = equations.nearest_closed(column(arm.configuration(p)))
        positions = Column(q[i] for i in arm.description.primary)
        known = equations.closed(ClosedPositions(positions, q, equations), Column.zeros(5))
        assert known is q
        np.testing.assert_allclose(equations.closed(positions, q).of, q.of, rtol=0.0, atol=1e-14)


def test_a_mechanism_loaded_twice_is_one_geometry(arm: Mechanism) -> None:
    """By value: another object, other inertias and other drives close their loops alike; other bars do not."""
    q = column(arm.configuration([0.1, -1.5, -3.0]))
    positions = ClosedPositions(Column(q[i] for i in arm.description.primary), q, arm.equations)
    again = load("semi_direct_drive")
    rough = again.with_parameters(1.5 * again.inertial_parameters).with_drives(Drive(0.1))
    weightless = Mechanism(replace(arm.description, gravity=np.zeros(3)))
    for same in (again, rough, weightless):
        assert same.equations is not arm.equations
        assert same.equations.closed(positions, q) is q
    for other in (longer(arm), load("semi_direct_drive_parallelogram")):
        assert other.equations.closed(positions, q) is not q


def test_a_controller_of_a_mechanism_loaded_twice_acts_as_on_the_plants_own(arm: Mechanism) -> None:
    reference = Sinusoids(np.array([0.0, -1.57, -3.14]), np.full(3, 0.2), np.full(3, 0.3))
    env = TrackingEnv(arm, reference, duration=0.2)
    shared, loaded = (
        simulate(env, SlotineLi(ReducedModel.full(own), 4.0, np.full(3, 60.0), np.full(50, 0.1)), seed=1)
        for own in (arm, load("semi_direct_drive"))
    )
    np.testing.assert_array_equal(loaded.p, shared.p)
    np.testing.assert_array_equal(loaded.torque, shared.torque)


class Seeing(Controller[tuple[()]]):
    """Asks for no torque, and remembers the positions that it was given."""

    dof = 3

    def __init__(self) -> None:
        self.seen: list[Column] = []

    def initial_state(self, p: Array, v: Array) -> tuple[()]:
        return ()

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: tuple[()]) -> tuple[Column, tuple[()]]:
        self.seen.append(p)
        return Column.zeros(3), ()


def test_guards_pass_the_configuration_on(arm: Mechanism) -> None:
    law, q = Seeing(), column(arm.configuration([0.1, -1.5, -3.0]))
    guarded, nothing = SafetyFilter(law, stop_damping=1.0), Column.zeros(3)
    blank = guarded.initial_state(np.zeros(3), np.zeros(3))
    memory = like(blank, map(column, leaves(blank)))
    reference = ReferencePoint(nothing, nothing, nothing)
    law.seen.clear()
    p = ClosedPositions(Column(q[i] for i in arm.description.primary), q, arm.equations)
    guarded.law(p, nothing, reference, memory)
    (seen,) = law.seen
    assert isinstance(seen, ClosedPositions)
    assert (seen.of, seen.configuration.of) == (p.of, q.of)
    bad = Column((math.nan, *q.of[1:]))
    _, after = guarded.law(ClosedPositions(Column(bad.of[:3]), bad, arm.equations), nothing, reference, memory)
    assert isinstance(law.seen[1], ClosedPositions)
    assert law.seen[1].configuration.of == (0.0, *q.of[1:])
    assert after.flags.stopped[0] == 1.0
    guarded.law(Column(p.of), nothing, reference, memory)
    assert type(law.seen[2]) is Column


def test_guards_that_never_act_leave_a_run_on_loops_as_it_is(arm: Mechanism) -> None:
    reference = Sinusoids(np.array([0.0, -1.57, -3.14]), np.full(3, 0.2), np.full(3, 0.3))
    env, law = TrackingEnv(arm, reference, duration=0.2), SlotineLi(ReducedModel.full(arm), 4.0, np.full(3, 60.0))
    bare, guarded = (simulate(env, own, seed=1) for own in (law, SafetyFilter(law, torque_limits=1e9)))
    np.testing.assert_array_equal(guarded.torque, bare.torque)
    np.testing.assert_array_equal(guarded.p, bare.p)


def test_arithmetic_forgets_the_configuration(arm: Mechanism) -> None:
    q = column(arm.configuration([0.1, -1.5, -3.0]))
    positions = ClosedPositions(Column(q[i] for i in arm.description.primary), q, arm.equations)
    moved = positions + Column((0.1, 0.0, 0.02))
    assert type(moved) is Column
    assert arm.equations.closed(moved, q).of[0] == moved[0]


def test_a_tree_needs_no_configuration() -> None:
    equations = load("puma560_measured").equations
    p = ClosedPositions(Column.zeros(6), Column.zeros(6), equations)
    assert equations.closed(p, Column.zeros(6)) is p


def test_a_controller_of_another_geometry_closes_its_own_loops(arm: Mechanism) -> None:
    """Its bars are 1 % longer: native code and step by step, it acts on the same configuration."""
    rough = longer(arm)
    assert rough.equations.rules
    model = ReducedModel(rough)
    controller = SlotineLi(model, 4.0, np.full(3, 60.0), None, initial=model.fundamental_parameters)
    reference = Sinusoids(np.array([0.0, -1.57, -3.14]), np.full(3, 0.2), np.full(3, 0.3))
    native, stepped = (
        run(TrackingEnv(arm, reference, duration=0.2), controller, seed=1) for run in (simulate, rollout)
    )
    np.testing.assert_allclose(native.torque, stepped.torque, rtol=0.0, atol=1e-9)
    q = rough.configuration(native.p[-1])
    assert np.abs(q - arm.configuration(native.p[-1])).max() > 1e-3
