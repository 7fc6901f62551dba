"""Numbers that no robot has are told in one line; those of manufacturers' files are not."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from robot_files import urdf

import adaptctl
from adaptctl.control import MinimumJerk, Sinusoids, SlotineLi, Spline
from adaptctl.control.task_space import TaskSpaceSlotineLi
from adaptctl.description import Description, Joint, JointKind, Limits, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism, load, plausibility
from adaptctl.dynamics.plausibility import _gravity_torques, _range, _spread, warn_of_implausible
from adaptctl.envs import TrackingEnv
from adaptctl.errors import PlausibilityWarning, ReferenceWarning
from adaptctl.identification.contradictions import implausible_links
from adaptctl.simulation import simulate_many
from adaptctl.simulation.reference_limits import warn_of_limits

PLAIN = ["ur5_robot.urdf", "kinova.urdf", "panda.urdf", "xarm7.urdf", "icub.urdf", "pr2.urdf", "b1.urdf"]


def notes(mechanism: Mechanism) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_implausible(mechanism, "my_arm.toml")
    assert all(one.category is PlausibilityWarning for one in caught)
    return [str(one.message) for one in caught]


def rod(mass: float, inertia: float, effort: float = math.inf, length: float = 0.5, **limits: float) -> Mechanism:
    """A rod that hangs from the ceiling at zero and turns about y."""
    bounds = Limits(**{"lower": -math.pi, "upper": math.pi} | limits, effort=effort)
    ten = from_center_of_mass(mass, [0.0, 0.0, -length], inertia * np.diag([1.0, 1.0, 0.1]))
    joint = Joint("hinge", JointKind.REVOLUTE, [0.0, 1.0, 0.0], bounds)
    return Mechanism(Description("rod", (Link("rod", -1, joint, Pose.identity(), Pose.identity(), ten),)))


def test_grams_for_kilograms_are_denser_than_any_material() -> None:
    (told,) = notes(rod(1400.0, 0.012))
    assert told.startswith("my_arm.toml: implausible: link 'rod' has 1400 kg at a radius of gyration of 0.00293 m, ")
    assert "denser than any material" in told
    assert "\n" not in told


def test_an_identified_link_is_told_unless_the_file_has_it_so_already() -> None:
    light, heavy = rod(1.4, 0.012), rod(1400.0, 0.012)
    (told,) = implausible_links(heavy, light)
    assert told.startswith("implausible: link 'rod' has 1400 kg ")
    assert "--prior-weight" in told
    assert not list(implausible_links(heavy, heavy))
    assert not list(implausible_links(light, heavy))


def test_a_ball_of_osmium_is_the_limit() -> None:
    """A ball of radius R has I = 2/5 m R^2; one of 22,500 kg/m^3 can be, one of 22,700 cannot."""
    for density, expected in ((22_500.0, 0), (22_700.0, 1)):
        radius = 0.05
        mass = density * 4.0 / 3.0 * math.pi * radius**3
        ten = from_center_of_mass(mass, [0.0, 0.0, -0.5], 0.4 * mass * radius**2 * np.eye(3))
        link = rod(1.0, 0.1).links[0]
        ball = Link("ball", -1, link.joint, link.parent_to_joint, link.joint_to_link, ten)
        assert len(notes(Mechanism(Description("ball", (ball,))))) == expected


def test_an_inertia_in_other_units_is_beyond_the_reach() -> None:
    (told,) = notes(rod(1.0, 12_000.0))
    assert "link 'rod' has 1 kg at a radius of gyration of 110 m, beyond the robot's reach" in told


@pytest.mark.parametrize(("length", "radius", "told"), [(0.5, 1.9, 0), (0.5, 2.1, 1), (3.0, 5.9, 0), (3.0, 6.1, 1)])
def test_parts_are_as_large_as_twice_the_reach_of_a_metre_or_more(length: float, radius: float, told: int) -> None:
    assert len(notes(rod(1.0, radius**2, length=length))) == told


def test_mass_points_and_massless_frames_are_none() -> None:
    for radius, told in ((0.0, 0), (0.9e-6, 0), (1.1e-6, 1)):  # a point, to a micrometre
        assert len(notes(rod(1.0, radius**2))) == told
    assert not notes(rod(0.0, 0.0))


@pytest.mark.parametrize(("bad", "more"), [(3, ""), (4, "; and 1 more alike"), (6, "; and 3 more alike")])
def test_three_links_are_named(bad: int, more: str) -> None:
    link = rod(1400.0, 0.012).links[0]
    links = [replace(link, name=f"l{k}", parent=k - 1, joint=replace(link.joint, name=f"j{k}")) for k in range(bad)]
    (told,) = notes(Mechanism(Description("many", tuple(links))))
    assert told.count("denser") == 3
    assert f"denser than any material{more}; expected" in told


@pytest.mark.parametrize(("massless", "told"), [(4, 1), (5, 0)])
def test_a_floating_base_falls_and_takes_no_torque(massless: int, told: int) -> None:
    """One begins with five massless links."""
    last, still = rod(2.0, 0.1, 1.0).links[0], Pose.identity()
    links = [
        Link(f"l{k}", k - 1, Joint(f"j{k}", JointKind.PRISMATIC, np.eye(3)[k % 3]), still, still, massless=True)
        for k in range(massless)
    ]
    assert len(notes(Mechanism(Description("base", (*links, replace(last, parent=massless - 1)))))) == told


@pytest.mark.parametrize(
    ("kind", "lower", "upper", "tried"),
    [
        (JointKind.REVOLUTE, -1.0, 2.0, (-1.0, 2.0)),
        (JointKind.REVOLUTE, -4.0, 4.0, (-4.0, 2.0 * math.pi - 4.0)),
        (JointKind.CONTINUOUS, -math.inf, math.inf, (-math.pi, math.pi)),
        (JointKind.PRISMATIC, -4.0, 4.0, (-4.0, 4.0)),
        (JointKind.PRISMATIC, 0.5, math.inf, (0.5, 2.5)),
        (JointKind.PRISMATIC, -math.inf, 3.0, (1.0, 3.0)),
        (JointKind.PRISMATIC, -math.inf, math.inf, (-1.0, 1.0)),
    ],
)
def test_joints_are_tried_within_a_turn_or_two_metres_of_their_limits(
    kind: JointKind, lower: float, upper: float, tried: tuple[float, float]
) -> None:
    assert _range(Joint("j", kind, limits=Limits(lower, upper))) == pytest.approx(tried)


@pytest.mark.parametrize(("share", "told"), [(1.05, 0), (1.09, 0), (1.12, 1), (3.0, 1)])
def test_gravity_beyond_the_torque_limit_by_a_tenth(share: float, told: int) -> None:
    arm = rod(2.0, 0.1, 2.0 * 9.81 * 0.5 / share)
    assert len(notes(arm)) == told


@pytest.mark.parametrize(("share", "refined"), [(0.45, False), (0.55, True), (1.05, True), (1.15, False)])
def test_postures_are_refined_where_they_decide(share: float, refined: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []
    torques = plausibility._torques
    monkeypatch.setattr(plausibility, "_torques", lambda arm, p: tried.append(len(p)) or torques(arm, p))
    notes(rod(2.0, 0.1, 2.0 * 9.81 * 0.5 / share))
    assert (len(tried) > 1) is refined


def test_only_postures_within_position_limits_count() -> None:
    """Within 0.2 rad of hanging, gravity asks for the sine of it."""
    need = 2.0 * 9.81 * 0.5 * math.sin(0.2)
    assert not notes(rod(2.0, 0.1, need, lower=-0.2, upper=0.2))
    assert notes(rod(2.0, 0.1, need / 1.2, lower=-0.2, upper=0.2))


@pytest.mark.parametrize("joints", [2, 4, 6])
def test_the_worst_posture_of_a_chain_is_found(joints: int) -> None:
    """A chain stretched out sideways asks for the sum of all masses times their distances."""
    ten = from_center_of_mass(1.0, [0.0, 0.0, -0.1], 0.01 * np.eye(3))
    step = Pose(np.eye(3), np.array([0.0, 0.0, -0.2]))

    def chain(effort: float) -> Mechanism:
        links = tuple(
            Link(
                f"l{k}",
                k - 1,
                Joint(f"j{k}", axis=[0.0, 1.0, 0.0], limits=Limits(-2.0, 2.0, effort=effort if k == 0 else math.inf)),
                step if k else Pose.identity(),
                Pose.identity(),
                ten,
            )
            for k in range(joints)
        )
        return Mechanism(Description("chain", links))

    need = 9.81 * sum(0.2 * k + 0.1 for k in range(joints))
    assert notes(chain(need / 1.12))
    assert not notes(chain(need / 1.09))


def test_a_file_is_told_of_once(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0.5 0 0"/><mass value="1400"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="hinge" type="revolute"><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="15" velocity="3"/>'
        '<parent link="base"/><child link="rod"/></joint></robot>'
    )
    with pytest.warns(PlausibilityWarning) as caught:
        load(file)
    assert len(caught) == 1
    assert f"{file}: implausible: link 'rod' has 1400 kg" in str(caught[0].message)
    assert "gravity takes 6867 N m of joint 'hinge', whose limit is 15" in str(caught[0].message)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize("name", PLAIN)
def test_manufacturers_files_get_no_note(name: str) -> None:
    load(urdf(name))


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_robots_that_come_with_the_package_get_no_note() -> None:
    for name in adaptctl.description.builtin_names():
        load(name)


def model_of(arm: Mechanism) -> adaptctl.ReducedModel:
    return adaptctl.ReducedModel(arm)


def told_of(reference: object, arm: Mechanism) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_limits(reference, arm.primary_joints, 4.0)  # type: ignore[arg-type]
    return [str(one.message) for one in caught]


def test_a_reference_beyond_range_or_speed_is_named() -> None:
    arm = rod(1.0, 0.1, velocity=2.0)
    assert not told_of(Sinusoids([0.0], [2.0], [0.1]), arm)
    (told,) = told_of(MinimumJerk([[0.0], [3.5]], [0.0, 4.0]), arm)
    assert told == "reference: hinge goes to 3.5 rad, beyond -3.142 to 3.142"
    for ends in ([[-1.5], [1.5]], [[1.5], [-1.5]]):
        (told,) = told_of(MinimumJerk(ends, [0.0, 2.0]), arm)
        assert told == "reference: hinge moves at 2.812 rad/s, beyond 2"


def test_degrees_are_named() -> None:
    (told,) = told_of(MinimumJerk([[30.0], [90.0]], [0.0, 4.0]), rod(1.0, 0.1))
    assert told.endswith("; expected rad, and these look like degrees")
    for ends in ([[30.0], [400.0]], [[-400.0], [30.0]]):  # beyond the range as degrees too
        assert not any("degrees" in told for told in told_of(MinimumJerk(ends, [0.0, 4.0]), rod(1.0, 0.1)))
    free = rod(1.0, 0.1, lower=-math.inf, upper=math.inf)
    (told,) = told_of(MinimumJerk([[45.0], [90.0]], [0.0, 4.0]), free)
    assert told == "reference: hinge starts at 45 rad; expected rad, and these look like degrees"
    assert not told_of(MinimumJerk([[0.0], [90.0]], [0.0, 4.0]), free), "a wheel turns as far as it is told"


def test_environments_and_ensembles_look() -> None:
    arm = rod(1.0, 0.1)
    far = MinimumJerk([[0.0], [3.5]], [0.0, 4.0])
    with pytest.warns(ReferenceWarning, match="hinge goes to 3.5 rad"):
        TrackingEnv(arm, far, duration=4.0)
    law = SlotineLi(model_of(arm), 2.0, 1.0)
    with pytest.warns(ReferenceWarning, match="hinge goes to 3.5 rad"):
        simulate_many(adaptctl.Plant(arm, 0.001), law, far, batch_size=2, duration=4.0)


def test_a_spline_that_rises_from_rest_starts_at_rest() -> None:
    """Samples that rest and then move: the plain interpolation begins at a speed that nothing asks for."""
    times = np.linspace(0.0, 3.0, 7)
    positions = np.array([[0.0, 0.5], [0.01, 0.5], [0.5, 0.1], [1.0, -0.5], [1.2, -0.8], [1.2, -0.8], [1.2, -0.8]])
    spline = Spline(positions, times)
    np.testing.assert_allclose(spline(times).p, positions, atol=1e-12)
    for end in (0.0, 3.0):
        point = spline(end)
        np.testing.assert_allclose([point.v, point.a], 0.0, atol=1e-9)
    dense = np.linspace(0.0, 3.0, 30001)
    p, v, a = spline(dense)
    np.testing.assert_allclose(np.gradient(p, dense, axis=0)[1:-1], v[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(v, dense, axis=0)[1:-1], a[1:-1], atol=1e-4)
    np.testing.assert_allclose(spline.at(0.7).v, spline(0.7).v, atol=1e-12)


def test_a_spline_of_a_motion_that_moves_at_its_ends_keeps_its_speed() -> None:
    times = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(Spline(np.sin(times)[:, None], times)(0.0).v, 1.0, atol=1e-6)


def test_a_spline_that_overshoots_is_noted() -> None:
    steps = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])[:, None]
    (told,) = told_of(Spline(steps, np.linspace(0.0, 4.0, 6)), rod(1.0, 0.1))
    assert "hinge overshoots its spline's positions by 0." in told
    smooth = Spline(np.sin(np.linspace(0.0, 3.0, 20))[:, None], np.linspace(0.0, 4.0, 20))
    assert not told_of(smooth, rod(1.0, 0.1))


def test_a_reference_in_space_is_not_held_against_joints() -> None:
    """Its coordinates are m, of as many axes as there are joints here."""
    arm = load("semi_direct_drive")
    law = TaskSpaceSlotineLi(model_of(arm), 2.0, 1.0)
    path = MinimumJerk([[0.4, 0.1, 0.3], [0.45, 0.1, 9.0]], [0.0, 4.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate_many(adaptctl.Plant(arm, 0.001), law, path, batch_size=2, duration=4.0)


def test_points_are_multiples_of_powers_of_the_plastic_number_or_the_golden_ratio() -> None:
    golden, plastic = 0.5 * (np.sqrt(5.0) - 1.0), 1.0 / np.roots([1.0, 0.0, -1.0, -1.0])[0].real
    np.testing.assert_allclose(_spread(2, 1), [[golden], [2.0 * golden - 1.0]])
    np.testing.assert_allclose(_spread(2, 2), [[plastic, plastic**2], [2.0 * plastic - 1.0, 2.0 * plastic**2 - 1.0]])


def posed(size: int, torque: Any) -> Any:
    """An arm of joints from 10 to 10.2 whose torques are given by shares (..., size) of their ranges."""
    link = SimpleNamespace(joint=Joint("hinge", limits=Limits(10.0, 10.2)))
    calls: list[Any] = []

    def inverse_dynamics(p: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        calls.append(p)
        return np.repeat(torque((p - 10.0) / 0.2)[..., None], size, axis=-1)

    description = SimpleNamespace(links=[link] * size)
    return SimpleNamespace(description=description, inverse_dynamics=inverse_dynamics, calls=calls)


def test_a_posture_is_refined_to_a_240th_of_each_range() -> None:
    peak, told = np.array([0.2, 0.41, 0.77]), list[float]()

    def torque(shares: np.ndarray) -> np.ndarray:
        found = np.maximum(1.0 - np.abs(shares - peak).sum(axis=-1), 0.0)
        told.append(found.max())
        return found

    assert np.all(_gravity_torques(posed(3, torque), np.ones(3)) >= 1.0 - 3.0 / 240.0)
    assert 0.85 < told[0] < 0.95, "the first postures do not tell"


@pytest.mark.parametrize(("size", "limit", "sweeps"), [(12, 1.0, 4), (13, 1.0, 0), (3, 0.9, 0), (3, 2.01, 0)])
def test_up_to_12_joints_are_swept_one_by_one_where_it_may_decide(size: int, limit: float, sweeps: int) -> None:
    arm = posed(size, lambda shares: np.ones(shares.shape[:-1]))
    _gravity_torques(arm, np.full(size, limit))
    assert len(arm.calls) == 1 + sweeps * size
