"""Loops that cannot be: each refused by a message that names the element and says what would be right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from random_loops import two_arms
from random_trees import random_inertia

from adaptctl.description import (
    Closure,
    ClosureKind,
    Condition,
    Coupling,
    Description,
    Joint,
    JointKind,
    Link,
    Loops,
    Pose,
)
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loops.assembly import _RANK, _rank
from adaptctl.errors import InputError, LoopError, NotFoundError

STILL = Pose.identity()
CLOSED = {"crank": 1.0, "coupler": -0.9, "rocker": 1.1}


def ahead(length: float) -> Pose:
    return Pose(np.eye(3), np.array([length, 0.0, 0.0]))


def linkage(
    primary: tuple[str, ...] = ("crank",),
    lengths: tuple[float, float, float, float] = (0.3, 0.6, 0.4, 0.7),
    reference: dict[str, float] | None = None,
    more: tuple[Closure, ...] = (),
    gears: tuple[Coupling, ...] = (),
    loose: bool = False,
) -> Mechanism:
    """A four-bar of lengths crank, coupler, rocker, ground; `loose` adds a link on the coupler that nothing holds."""
    a, b, c, d = lengths
    rng = np.random.default_rng(0)
    links = [
        Link("crank", -1, Joint("crank"), STILL, STILL, random_inertia(rng)),
        Link("coupler", 0, Joint("coupler"), ahead(a), STILL, random_inertia(rng)),
        Link("rocker", -1, Joint("rocker"), ahead(d), STILL, random_inertia(rng)),
    ]
    if loose:
        links.insert(2, Link("arm", 1, Joint("arm"), ahead(b), STILL, random_inertia(rng)))
    pin = Closure("pin", "coupler", "rocker", ahead(b), ahead(c))
    loops = Loops(primary, (pin, *more), gears, CLOSED if reference is None else reference)
    return Mechanism(Description("four-bar", tuple(links), loops=loops))


def test_the_linkage_itself_is_fine() -> None:
    mechanism = linkage()
    assert mechanism.dof == 1
    assert mechanism.continuation is not None
    assert linkage(("crank", "arm"), loose=True).continuation is not None


def refused(mechanism: Mechanism, message: str) -> None:
    """By every way in: the reference, the equations, a torque."""
    for ask in (
        lambda: mechanism.continuation,
        lambda: mechanism.equations,
        lambda: mechanism.inverse_dynamics(*np.zeros((3, mechanism.dof))),
    ):
        with pytest.raises(LoopError, match="^four-bar: " + message):
            ask()


def test_a_loop_too_short_to_close() -> None:
    short = linkage(lengths=(0.1, 0.1, 0.1, 0.7))
    refused(short, r"closure 'pin' cannot close at the reference configuration: 0\.\d+ \(m or rad\) remains; check len")


def test_a_loop_that_closes_elsewhere_says_where() -> None:
    """Lengths that close, but not with the crank where the reference has it."""
    stuck = linkage(lengths=(0.6, 0.3, 0.4, 0.7), reference={"crank": 2.5, "coupler": -1.0, "rocker": 1.0})
    refused(stuck, r"closure 'pin' cannot close .*; it closes at \{'crank': \d\.\d+\}")


def test_too_many_primary_joints() -> None:
    refused(
        linkage(("crank", "rocker")),
        "2 joints are primary, but the loops have only 1 degrees of freedom: crank, rocker depend on "
        "each other; remove 1 of them",
    )
    refused(
        linkage(("crank", "rocker", "arm"), loose=True),
        "3 joints are primary, but the loops have only 2 degrees of freedom: crank, rocker depend on "
        "each other; remove 1 of them",
    )


def test_too_few_primary_joints() -> None:
    refused(
        linkage(("crank",), loose=True),
        "the primary joints do not determine arm: 2 joints must be primary, but only 1 are",
    )
    refused(
        linkage(("arm",), loose=True),
        "the primary joints do not determine crank, coupler, rocker: 2 joints must be primary, but only 1 are",
    )


def test_the_right_number_of_the_wrong_joints() -> None:
    """Two of the loop's joints, and none for the loose arm."""
    with pytest.raises(LoopError, match=r"^four-bar: .*(crank, rocker|arm)"):
        _ = linkage(("crank", "rocker"), loose=True).continuation


def test_a_closure_that_adds_nothing() -> None:
    again = Closure("again", "rocker", "coupler", ahead(0.4), ahead(0.6))
    refused(linkage(more=(again,)), "closure 'again' is redundant: other constraints imply it; remove it")


@pytest.mark.parametrize("reference", [{}, {"rack": 500.0}])
def test_followers_start_at_their_leaders_however_far(reference: dict[str, float]) -> None:
    """A pinion many turns from where its rack is at zero."""
    links = [
        Link("rack", -1, Joint("rack", JointKind.PRISMATIC), STILL, STILL, random_inertia(np.random.default_rng(0))),
        Link("pinion", -1, Joint("pinion"), STILL, STILL, random_inertia(np.random.default_rng(1))),
    ]
    loops = Loops(("rack",), couplings=(Coupling("teeth", "pinion", "rack", 40.0, 300.0),), reference=reference)
    arm = Mechanism(Description("feed", tuple(links), loops=loops))
    np.testing.assert_allclose(arm.configuration([0.5]), [0.5, 320.0], rtol=1e-15)


def test_a_coupling_that_adds_nothing() -> None:
    """A parallelogram's opposite sides turn alike by themselves."""
    square = {"crank": 1.0, "coupler": -1.0, "rocker": 1.0}
    gear = (Coupling("belt", "rocker", "crank"),)
    refused(
        linkage(lengths=(0.3, 0.6, 0.3, 0.6), reference=square, gears=gear),
        "coupling 'belt' is redundant: other constraints imply it; remove it",
    )


def test_a_mechanism_that_locks() -> None:
    """A strut from the coupler's middle to the ground leaves nothing to move."""
    mechanism = linkage()
    assert mechanism.continuation is not None
    crank, coupler, _ = mechanism.continuation.reference
    point = 0.3 * np.array([math.cos(crank), math.sin(crank), 0.0])
    point += 0.3 * np.array([math.cos(crank + coupler), math.sin(crank + coupler), 0.0])
    strut = Closure("strut", "coupler", None, ahead(0.3), Pose(np.eye(3), point))
    refused(linkage(more=(strut,)), "the mechanism is locked: 3 constraints fix all 3 joints")


def test_a_mechanism_that_closes_in_one_configuration_only() -> None:
    """Stretched out, the crank and the coupler just reach: nothing can move."""
    taut = linkage(lengths=(0.2, 0.2, 0.3, 0.7), reference={"crank": 0.0, "coupler": 0.0, "rocker": math.pi})
    refused(taut, "the mechanism is locked: its loops close only at the reference")


def test_a_singular_start() -> None:
    """Coupler and rocker in line: the crank alone cannot say which way they fold."""
    reach = 0.9
    angle = math.acos((0.5**2 + 0.7**2 - reach**2) / (2 * 0.5 * 0.7))
    stretched = linkage(lengths=(0.5, 0.6, 0.3, 0.7), reference={"crank": angle, "coupler": -1.2, "rocker": 2.2})
    singular = "the reference configuration is singular: of 2 constraints .* only 1 there; give another reference"
    refused(stretched, singular)
    flat = linkage(
        lengths=(0.3, 0.6, 0.3, 0.6), reference={"crank": 0.0, "coupler": 0.0, "rocker": 0.0}
    )  # a parallelogram laid flat, where it may become an antiparallelogram
    refused(flat, singular)


def test_three_legs_that_meet_in_a_point_are_singular() -> None:
    """A platform on three sliding legs turns freely, to first order, where their lines meet."""
    rng, links, closures, reference = np.random.default_rng(1), [], [], {}
    for i, x in enumerate((0.0, 2.1, 4.2)):
        foot = np.array([math.cos(x), math.sin(x), 0.0])
        reference |= {f"swing{i}": x + math.pi, f"slide{i}": 0.7}
        links.append(Link(f"foot{i}", -1, Joint(f"swing{i}"), Pose(np.eye(3), foot), STILL, random_inertia(rng)))
        slide = Joint(f"slide{i}", JointKind.PRISMATIC, np.array([1.0, 0.0, 0.0]))
        links.append(Link(f"leg{i}", len(links) - 1, slide, STILL, STILL, random_inertia(rng)))
        if i == 0:
            links.append(Link("platform", 1, Joint("tilt"), STILL, Pose(np.eye(3), -0.3 * foot), random_inertia(rng)))
            reference["tilt"] = -math.pi
        else:
            closures.append(Closure(f"corner{i}", f"leg{i}", "platform", STILL, Pose(np.eye(3), 0.3 * foot)))
    loops = Loops(("slide0", "slide1", "slide2"), tuple(closures), (), reference)
    with pytest.raises(LoopError, match=r"platform: the reference configuration is singular: of 4 .* only 3 there"):
        _ = Mechanism(Description("platform", tuple(links), loops=loops)).continuation


def test_names_that_do_not_exist() -> None:
    four_bar = linkage().description
    loops = four_bar.loops
    assert loops is not None
    for wrong, message in (
        ({"primary": ("motor",)}, "primary: unknown joint 'motor'; joints: coupler, crank, rocker"),
        ({"closures": (Closure("x", "rod", None),)}, "x: unknown link 'rod'; links: coupler, crank, rocker"),
        ({"couplings": (Coupling("x", "rod", "crank"),)}, "x: unknown joint 'rod'; joints: coupler, crank"),
        ({"reference": {"rod": 1.0}}, "reference: unknown joint 'rod'; joints: coupler, crank, rocker"),
    ):
        with pytest.raises(NotFoundError, match=message):
            replace(four_bar, loops=replace(loops, **wrong))


def test_a_follower_of_a_follower_follows_the_first_leader() -> None:
    chain = (Coupling("z", "d", "c", -1.0, 0.5), Coupling("x", "b", "a", 2.0, 0.3), Coupling("y", "c", "b", 0.25))
    resolved = Loops(("a",), couplings=chain).couplings
    assert [(c.name, c.follower, c.leader, c.ratio) for c in resolved] == [
        ("z", "d", "a", -0.5),
        ("x", "b", "a", 2.0),
        ("y", "c", "a", 0.5),
    ]
    assert [c.offset for c in resolved] == pytest.approx([0.5 - 0.25 * 0.3, 0.3, 0.25 * 0.3])


def test_what_loops_cannot_say() -> None:
    for make, message in (
        (lambda: Loops(()), "loops: primary: expected at least one joint"),
        (lambda: Loops(("a", "a")), "loops: primary joint 'a' is given more than once"),
        (lambda: Closure("x", "a", "a"), r"closure 'x': expected two different links, got a twice"),
        (lambda: Closure("x", None, None), r"closure 'x': expected two different links, got the ground twice"),
        (lambda: Coupling("x", "a", "a"), "coupling 'x': joint 'a' cannot follow itself"),
        (
            lambda: Coupling("x", "a", "b", 0.0),
            "coupling 'x': expected a finite ratio other than zero and a finite off",
        ),
        (lambda: Coupling("x", "a", "b", math.nan), "coupling 'x': expected a finite ratio other than zero"),
        (lambda: Coupling("x", "a", "b", 1.0, math.inf), "and a finite offset, got 1.0 and inf"),
        (lambda: Loops(("b",), couplings=(Coupling("x", "b", "a"),)), "joint 'b' is a follower and cannot be primary"),
        (
            lambda: Loops(("a",), couplings=(Coupling("x", "b", "c"), Coupling("y", "c", "b"))),
            "coupling 'x': joint 'b' follows 'c', but its leaders follow in a ring",
        ),
        (
            lambda: Loops(("a",), couplings=(Coupling("x", "b", "a"), Coupling("y", "b", "a"))),
            "loops: follower 'b' is given more than once",
        ),
        (lambda: Condition("x", {}), "condition 'x': expected finite weights of at least one joint"),
        (lambda: Condition("x", {"a": 1.0}, 2.0, 1.0), "condition 'x': expected lower < upper, got 2.0 and 1.0"),
        (
            lambda: Loops(("a",), conditions=(Condition("x", {"b": 1.0}),)),
            "condition 'x': joint 'b' is not primary",
        ),
        (lambda: Loops(("a", "b")), "loops: expected at least one closure or coupling; give loops=None for a tree"),
        (
            lambda: Loops(("a",), conditions=(Condition("x", {"a": 1.0}),)),
            "loops: expected at least one closure or coupling; give loops=None for a tree",
        ),
    ):
        with pytest.raises(InputError, match=message):
            make()


def test_kinds_of_closure_bind_what_they_say() -> None:
    """Two frames share an origin, an axis besides, or everything: 3, 5, 6 constraints for free enough arms."""
    for kind, rows in ((ClosureKind.POINT, 3), (ClosureKind.AXIS, 5), (ClosureKind.WELD, 6)):
        arms = two_arms(0, kind)
        assert arms.continuation is not None
        assert (arms.dof, kind.rows) == (8 - rows, rows)


def test_a_rank_counts_what_is_above_its_tolerance_and_is_zero_of_nothing() -> None:
    """Singular values over the largest, whatever the unit; exactly the tolerance counts as none."""
    for unit in (1.0, 2.0**-40, 2.0**40):
        assert _rank(unit * np.diag([1.0, 2.0 * _RANK])) == 2
        assert _rank(unit * np.diag([1.0, _RANK])) == _rank(unit * np.diag([1.0, 0.5 * _RANK])) == 1
    assert _rank(np.zeros((2, 3))) == _rank(np.zeros((0, 3))) == 0
