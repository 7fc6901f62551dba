"""Mechanisms with loops that textbooks solve: four bars, slider-cranks, gears, a platform; and where loops lock."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from random_loops import equations, gaps
from random_trees import random_inertia

from adaptctl.compilation import compile_function
from adaptctl.description import Closure, Coupling, Description, Joint, JointKind, Link, Loops, Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import SingularityError


def four_bar(a: float, b: float, c: float, d: float, crank: float = 1.5) -> Mechanism:
    """Crank a, coupler b, rocker c, ground d, open, with the crank's angle at the reference."""
    rng = np.random.default_rng(0)
    at = {name: Pose(np.eye(3), np.array([x, 0.0, 0.0])) for name, x in (("a", a), ("b", b), ("c", c), ("d", d))}
    still = Pose.identity()
    links = (
        Link("crank", -1, Joint("crank"), still, still, random_inertia(rng)),
        Link("coupler", 0, Joint("coupler"), at["a"], still, random_inertia(rng)),
        Link("rocker", -1, Joint("rocker"), at["d"], still, random_inertia(rng)),
    )
    closure = Closure("pin", "coupler", "rocker", at["b"], at["c"])
    reference = {"crank": crank, "coupler": -1.0, "rocker": 1.5}
    return Mechanism(Description("four-bar", links, loops=Loops(("crank",), (closure,), (), reference)))


def test_a_four_bar_is_freudensteins() -> None:
    """Freudenstein (1955): K1 cos psi - K2 cos phi + K3 = cos(phi - psi), over the crank's whole turn."""
    a, b, c, d = 0.2, 0.55, 0.45, 0.6
    phi = np.linspace(1.5 - math.pi, 1.5 + math.pi, 201)[:, None]
    q = four_bar(a, b, c, d).configuration(phi)
    psi = q[:, 2]
    left = d / a * np.cos(psi) - d / c * np.cos(phi[:, 0]) + (a * a - b * b + c * c + d * d) / (2 * a * c)
    np.testing.assert_allclose(left, np.cos(phi[:, 0] - psi), rtol=0, atol=1e-11)
    np.testing.assert_allclose(q[0, 1:] - q[-1, 1:], [2 * math.pi, 0.0], atol=1e-11)


def test_a_slider_crank_is_the_textbooks() -> None:
    """x = r cos phi + sqrt(l^2 - r^2 sin^2 phi), and the slider's mass felt at the crank through dx/dphi."""
    r, length, m = 0.1, 0.35, 3.0
    still, end = Pose.identity(), Pose(np.eye(3), np.array([length, 0.0, 0.0]))
    links = (
        Link("crank", -1, Joint("crank"), still, still),
        Link("rod", 0, Joint("rod"), Pose(np.eye(3), np.array([r, 0.0, 0.0])), still),
        Link("slider", -1, Joint("slide", JointKind.PRISMATIC, np.array([1.0, 0, 0])), still, still, m * np.eye(10)[0]),
    )
    loops = Loops(("crank",), (Closure("pin", "rod", "slider", end),), (), {"slide": r + length})
    engine = Mechanism(Description("engine", links, np.zeros(3), loops=loops))
    phi = np.linspace(-math.pi, math.pi, 101)
    root = np.sqrt(length**2 - (r * np.sin(phi)) ** 2)
    q = engine.configuration(phi[:, None])
    np.testing.assert_allclose(q[:, 2], r * np.cos(phi) + root, rtol=0, atol=1e-13)
    slope = -r * np.sin(phi) - r**2 * np.sin(phi) * np.cos(phi) / root
    np.testing.assert_allclose(engine.mass_matrix(phi[:, None])[:, 0, 0], m * slope**2, rtol=0, atol=1e-12)


def test_gears_reflect_inertia_by_the_square_of_the_ratio() -> None:
    rotor, load_inertia, ratio = 1e-3, 2.0, -50.0
    links = tuple(
        Link(name, -1, Joint(name), Pose.identity(), Pose.identity(), inertia * np.eye(10)[9])
        for name, inertia in (("load", load_inertia), ("rotor", rotor))
    )
    geared = Mechanism(
        Description("drive", links, loops=Loops(("load",), couplings=(Coupling("gear", "rotor", "load", ratio, 0.3),)))
    )
    np.testing.assert_allclose(geared.configuration([[2.0]]), [[2.0, -99.7]], rtol=1e-15)
    assert geared.mass_matrix([0.0])[0, 0] == pytest.approx(load_inertia + ratio**2 * rotor, rel=1e-14)
    np.testing.assert_allclose(geared.energy_regressor([0.0], [1.0])[[9, 19]], [0.5, 0.5 * ratio**2], rtol=1e-14)


def planar_platform() -> Mechanism:
    """Three legs, a turning and a sliding joint each, carry a platform: three primary slides, as in Stewart's."""
    feet = [np.array([math.cos(x), math.sin(x), 0.0]) for x in (0.0, 2.1, 4.2)]
    corners = [0.3 * np.array([math.cos(x + 0.8), math.sin(x + 0.8), 0.0]) for x in (0.0, 2.1, 4.2)]
    rng, still, links, closures, reference = np.random.default_rng(1), Pose.identity(), [], [], {}
    for i, (foot, corner) in enumerate(zip(feet, corners, strict=True)):
        way = corner - foot
        reference |= {f"swing{i}": math.atan2(way[1], way[0]), f"slide{i}": float(np.linalg.norm(way))}
        swing = Link(f"foot{i}", -1, Joint(f"swing{i}"), Pose(np.eye(3), foot), still, random_inertia(rng))
        slide = Joint(f"slide{i}", JointKind.PRISMATIC, np.array([1.0, 0.0, 0.0]))
        links += [swing, Link(f"leg{i}", len(links), slide, still, still, random_inertia(rng))]
        if i == 0:
            links.append(Link("platform", 1, Joint("tilt"), still, Pose(np.eye(3), -corner), random_inertia(rng)))
            reference["tilt"] = -reference["swing0"]
        else:
            closures.append(Closure(f"corner{i}", f"leg{i}", "platform", still, Pose(np.eye(3), corner)))
    loops = Loops(("slide0", "slide1", "slide2"), tuple(closures), (), reference)
    return Mechanism(Description("platform", tuple(links), loops=loops))


def test_a_planar_platform_stands_where_its_legs_put_it() -> None:
    """Legs' lengths of a pose are known in closed form: the loops must find the pose again."""
    platform, rng = planar_platform(), np.random.default_rng(2)
    corners = 0.3 * np.array([[math.cos(x + 0.8), math.sin(x + 0.8)] for x in (0.0, 2.1, 4.2)])
    feet = np.array([[math.cos(x), math.sin(x)] for x in (0.0, 2.1, 4.2)])
    for x, y, angle in rng.uniform(-0.1, 0.1, (10, 3)):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        lengths = np.linalg.norm(corners @ turn.T + (x, y) - feet, axis=1)
        q = platform.configuration(lengths)
        tilt = q[list(platform.description.joint_names).index("tilt")] + q[0]
        assert tilt == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize("name", ["semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_ten_seconds_of_motion_stay_closed(name: str) -> None:
    """Following a configuration tick by tick for 10 s at 1 ms leaves no drift: the loop closes to 1e-12."""
    arm = load(name)
    assert arm.continuation is not None
    e, t = equations(arm), np.arange(0.0, 10.0, 1e-3)
    start = arm.continuation.reference[list(arm.description.primary)]
    sway = np.array([0.9, 0.5, 0.7]) * np.sin(t[:, None] * [1.1, 1.7, 2.3])
    follow = compile_function(lambda p, q: (e.closed(p, q),), {"p": 3, "q": 5})
    q = arm.continuation.reference
    worst = 0.0
    for i, p in enumerate(start + sway):
        (q,) = follow(p, q)
        if i % 100 == 0:
            worst = max(worst, float(np.abs(gaps(arm.description, q)).max()))
    assert worst < 1e-12


def test_near_a_singularity_nothing_is_returned() -> None:
    """A non-Grashof four-bar stops where its coupler and rocker stretch out."""
    stuck = four_bar(0.5, 0.3, 0.4, 0.6, crank=0.8)
    far = math.acos((0.5**2 + 0.6**2 - 0.7**2) / (2 * 0.5 * 0.6))
    assert stuck.configuration([far - 0.2]).shape == (3,)
    for beyond in (-1e-4, 0.0, 1e-4, 0.3):
        with pytest.raises(
            SingularityError, match=r"the loops are near a singularity at p = \[\d\.\d+\]: .* below the limit of 0"
        ):
            stuck.configuration([far + beyond])
    assert stuck.continuation is not None
    assert stuck.continuation.reachable(np.array([[far - 0.2], [far], [far + 0.2]])).tolist() == [True, False, False]


def test_a_mechanism_knows_how_far_it_is_from_locking() -> None:
    """Near a fold the smallest singular value goes as the square root of the distance."""
    stuck = four_bar(0.5, 0.3, 0.4, 0.6, crank=0.8)
    assert stuck.continuation is not None
    far = math.acos((0.5**2 + 0.6**2 - 0.7**2) / (2 * 0.5 * 0.6))
    here = [float(stuck.continuation.regularity(stuck.configuration([far - d]))) for d in (0.16, 0.04)]
    assert here[0] / here[1] == pytest.approx(2.0, rel=0.1)


def test_the_reference_may_be_given_roughly() -> None:
    arm = load("semi_direct_drive")
    assert arm.description.loops is not None
    loops = replace(arm.description.loops, reference={**arm.description.loops.reference, "joint4": 0.8, "joint5": 2.0})
    rough = Mechanism(replace(arm.description, loops=loops))
    assert rough.continuation is not None
    assert arm.continuation is not None
    np.testing.assert_allclose(rough.continuation.reference, arm.continuation.reference, atol=1e-12)
