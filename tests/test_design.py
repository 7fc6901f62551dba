"""Where mass may be added: costs against what arms do, counterweights against brute force, simplifications against
ranks."""

from __future__ import annotations

import re

import numpy as np
import pytest
from designs import ARMS, best_on_grid, direct_cost, task
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night, turn_by_turn

import adaptctl
from adaptctl.control import Sinusoids
from adaptctl.description import Description, Joint, Link
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent, pseudo_inertia
from adaptctl.description.pose import Pose
from adaptctl.design import (
    Counterweights,
    DesignStudy,
    DesignTask,
    MountingBounds,
    added_mass,
    box,
    camera,
    cost_map,
    cylinder,
    design_study,
    gripper,
    motor,
    optimal_counterweights,
    point,
    simplifications,
    sphere,
)
from adaptctl.design.bodies import ball_tens, ball_tens_slopes
from adaptctl.design.counterweights import _beyond, _beyond_slopes
from adaptctl.design.mounting_bounds import bounds
from adaptctl.design.simplifications import by_symmetry, operations_saved
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.identifiability import Constraints, Reduction, constrained, essential_space, reduce

OBJECTIVES = ("energy", "torque", "coupling")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_costs_are_what_the_arm_does(arm: str, objective: str) -> None:
    T = task(arm)
    assert T.cost(objective) == pytest.approx(direct_cost(T, objective, T.parameters), rel=1e-9)
    torques = T.mechanism.inverse_dynamics(T.p, T.v, T.a)
    assert T.torques() == pytest.approx(np.sqrt(np.mean(torques**2, axis=0)), rel=1e-9)


@settings(max_examples=12)
@given(
    arm=st.sampled_from(sorted(ARMS)),
    link=st.integers(0, 4),
    mass=st.floats(0.0, 20.0),
    place=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
)
def test_an_added_mass_costs_what_the_arm_with_it_does(
    arm: str, link: int, mass: float, place: tuple[float, ...]
) -> None:
    T = task(arm)
    name = T.mechanism.description.body_names[link]
    found = added_mass(T, name, mass, place)
    for objective, change in (("energy", found.energy_change), ("torque", found.torque_change)):
        before, after = (direct_cost(T, objective, D) for D in (T.parameters, found.parameters))
        assert change == pytest.approx((after - before) / before, abs=1e-9)
    assert found.own_energy == pytest.approx(T.cost("energy", found.essential_change), rel=1e-8, abs=1e-9)
    assert cost_map(T, max(mass, 0.01)).at(name, place) == pytest.approx(
        added_mass(T, name, max(mass, 0.01), place).energy_change, abs=1e-9
    )


def test_only_the_projection_matters() -> None:
    T = task("puma560_measured")
    found = added_mass(T, "link5", gripper(), (0.0, 0.0, 0.1))
    rest = found.parameter_change - found.essential_change
    assert np.abs(rest).max() > 0.1
    for objective in OBJECTIVES[:2]:
        assert T.cost(objective, rest) < 1e-9 * T.cost(objective, found.parameter_change)


def test_mass_on_the_first_axis_costs_nothing() -> None:
    """The PUMA's first link turns about its y axis, which is vertical."""
    T = task("puma560_measured")
    assert added_mass(T, "link1", 5.0, (0.0, 0.3, 0.0)).energy_change == pytest.approx(0.0, abs=1e-12)
    assert added_mass(T, "link1", 5.0, (0.1, 0.3, 0.0)).energy_change > 1e-4


def test_a_body_without_mass_changes_no_parameter() -> None:
    assert added_mass(task("two_link"), "lower", 0.0).base_parameter_changes == ()


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_a_parameter_becomes_essential() -> None:
    """The published PUMA's last link has its centre of mass on its axis: a camera beside it needs what was zero."""
    mechanism = adaptctl.load("puma560")
    T = DesignTask.within_limits(mechanism, 200)
    assert "link6.mc_x" not in T.nonzero_parameters()
    found = added_mass(T, "link6", camera((0.05, 0.0, 0.0)))
    assert "link6.mc_x" in found.newly_identifiable
    assert dict(found.base_parameter_changes)["link6.mc_x"] == pytest.approx(0.2 * 0.05)
    assert added_mass(T, "link6", gripper((0.0, 0.0, 0.1))).newly_identifiable == ()


@pytest.mark.parametrize("arm", ARMS)
def test_components_are_those_of_the_reduction(arm: str) -> None:
    T = task(arm)
    for percent in (0.0, 0.1, 1.0, 10.0):
        kept: Reduction = reduce(T.essential_space, T.mechanism, energy_error=percent)
        assert T.components(percent) == kept.num_components or kept.percent_errors[
            kept.num_components
        ] == pytest.approx(percent, abs=1e-9)


def test_pairs_of_states_have_twice_the_square() -> None:
    T = task("ur5", 50)
    e = T.mechanism.energy(T.p, T.v)
    assert np.mean((e[:, None] - e) ** 2) == pytest.approx(2.0 * T.cost("energy") ** 2, rel=1e-9)


@pytest.mark.parametrize(
    "body", [point(2.0), sphere(2.0), box(2.0, (0.1, 0.2, 0.3)), cylinder(2.0, 0.1, 0.3), gripper(), camera(), motor()]
)
def test_bodies_are_real(body: object) -> None:
    T = task("puma560_measured")
    found = added_mass(T, "link3", body, (0.1, 0.0, 0.2))  # type: ignore[arg-type]
    assert np.linalg.eigvalsh(pseudo_inertia(found.parameter_change[20:30]))[0] > -1e-12
    assert is_physically_consistent(found.parameters[20:30])


def test_solids_are_at_the_origin_unless_placed() -> None:
    for body in (point(2.0), sphere(2.0), box(2.0, (0.1, 0.2, 0.3)), cylinder(2.0, 0.1, 0.3)):
        np.testing.assert_array_equal(np.asarray(body.center), np.zeros(3))


def test_solids_have_their_moments() -> None:
    """A cylinder about x by sums over points, and balls' slopes by differences."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-1.0, 1.0, (200_000, 3)) * np.array([0.3, 0.1, 0.1])
    at = at[np.hypot(at[:, 1], at[:, 2]) < 0.1]
    squares = 5.0 * np.mean(at**2, axis=0)
    body = cylinder(5.0, 0.1, 0.6, axis=(2.0, 0.0, 0.0))
    assert np.diag(body.inertia) == pytest.approx(squares.sum() - squares, rel=1e-2)
    z, step = np.array([1.3, 0.1, -0.2, 0.3]), 1e-6
    slopes = ball_tens_slopes(z[:1], z[None, 1:], 7850.0)[0]
    for i in range(4):
        up, down = z + step * np.eye(4)[i], z - step * np.eye(4)[i]
        change = (ball_tens(up[0], up[1:], 7850.0) - ball_tens(down[0], down[1:], 7850.0)) / (2.0 * step)
        assert slopes[:, i] == pytest.approx(change, abs=1e-8)


@pytest.mark.parametrize(("objective", "arm"), turn_by_turn(OBJECTIVES, ARMS))
def test_counterweights_are_within_one_percent_of_brute_force(arm: str, objective: str) -> None:
    """Every pair of a grid of masses and places on shoulder and elbow, 7^8 designs."""
    T = task(arm)
    within = bounds(T.mechanism, ARMS[arm])
    found = optimal_counterweights(T, within, objective)
    least, best = best_on_grid(T, objective, *within, each=7)
    assert direct_cost(T, objective, best) == pytest.approx(least, rel=1e-6)
    assert found.cost_after <= 1.01 * least
    assert found.cost_after >= 0.9 * least, "the grid is fine enough to tell"
    assert found.cost_after == pytest.approx(direct_cost(T, objective, found.parameters), rel=1e-9)


@pytest.mark.parametrize("arm", mostly_at_night(ARMS, "semi_direct_drive"))
def test_counterweights_make_components_fewer(arm: str) -> None:
    """No design of a grid has fewer."""
    T = task(arm)
    within = bounds(T.mechanism, ARMS[arm][:1])
    found = optimal_counterweights(T, within, "components", percent=1.0)
    first = 10 * T.link_index(within[0].link)
    counts = []
    for mass in np.linspace(0.0, within[0].mass, 6):
        for place in within[0].grid(6):
            D = np.array(T.parameters)
            D[first : first + 10] += ball_tens(mass, place, 7850.0)
            counts.append(T.components(1.0, D))
    assert found.cost_after <= min(counts)
    assert found.cost_after <= found.cost_before


@pytest.mark.parametrize("arm", ARMS)
def test_counterweights_stay_within_bounds_and_leave_links_real(arm: str) -> None:
    T = task(arm)
    within = bounds(T.mechanism, ARMS[arm], mass_ratio=0.1)
    found = optimal_counterweights(T, within)
    own = {places.link: places for places in within}
    for weight in found.weights:
        assert 0.0 < weight.mass <= own[weight.link].mass
        own[weight.link].validate(weight.place)
        added = added_mass(T, weight.link, weight.body).parameter_change
        assert is_physically_consistent(added.reshape(-1, 10)[T.link_index(weight.link)])
    assert found.inconsistent == ()
    assert found.relative_reduction >= 0.0
    assert found.balanced_task.cost("energy") == pytest.approx(found.cost_after)
    assert (
        found.cost_after <= optimal_counterweights(T, bounds(T.mechanism, ARMS[arm], mass_ratio=0.05)).cost_after + 1e-9
    )


def test_a_parallelogram_is_decoupled_by_bodies_and_a_generic_five_bar_is_not() -> None:
    """Section 8 of the replication: six relations, which links can obey, against ten, which they cannot."""
    left = {}
    for name in ("semi_direct_drive_parallelogram", "semi_direct_drive"):
        T = task(name)
        found = optimal_counterweights(T, bounds(T.mechanism, ("link2", "link3", "link4", "link5"), 1.0), "coupling")
        left[name] = 1.0 - found.relative_reduction
        assert found.inconsistent == ()
    assert left["semi_direct_drive_parallelogram"] < 1e-6
    assert left["semi_direct_drive"] > 0.2


@pytest.mark.parametrize("arm", ARMS)
def test_removals_leave_the_rank_of_the_constrained_mechanism(arm: str) -> None:
    T = task(arm)
    links = T.mechanism.description.body_names[-2:]
    found = [r for r in simplifications(T, bounds(T.mechanism, links)) if r.kind == "symmetry"]
    assert found
    for removal in found[::4]:
        relations = Constraints(known=dict.fromkeys(removal.known, 0.0))
        assert essential_space(constrained(T.mechanism, relations)).rank == removal.rank
        D = np.random.default_rng(0).normal(size=len(T.parameters))
        D[[T.essential_space.parameter_names.index(name) for name in removal.known]] = 0.0
        Y = T.mechanism.torque_regressor(T.p[:5], T.v[:5], T.a[:5], range(T.mechanism.num_energy_parameters))
        left = Y[..., list(removal.columns)] @ (removal.regrouping @ D)
        assert left == pytest.approx(Y @ D, rel=1e-9, abs=1e-9)
        assert set(removal.zero) <= set(removal.eliminated)


@pytest.mark.parametrize("arm", ARMS)
def test_balanced_and_relocated_parameters_are_zero(arm: str) -> None:
    T = task(arm)
    found = [r for r in simplifications(T, bounds(T.mechanism, ARMS[arm])) if r.kind != "symmetry"]
    assert {r.kind for r in found} == {"balance", "relocation"}
    for removal in found:
        D, first = np.array(T.parameters), 10 * T.link_index(removal.link)
        own = T.parameters[first : first + 10]
        D[first : first + 10] += ball_tens(removal.mass, removal.place, 7850.0)
        if removal.kind == "relocation":
            D[first : first + 10] -= ball_tens(removal.mass, own[1:4] / own[0])
        assert is_physically_consistent(D[first : first + 10])
        row = T.basis.names.index(removal.eliminated[0])
        scale = np.abs(T.basis.regrouping[row] * T.parameters).max()
        assert abs(T.basis.regrouping[row] @ D) < 1e-9 * scale
        assert removal.rank == T.basis.rank - 1
        x = re.search(r"\((.*), (.*), (.*)\) m$", removal.description)
        assert x is not None
        assert [float(value) for value in x.groups()] == pytest.approx(removal.place, abs=5.01e-4)
        assert removal.equations_after == (f"{removal.eliminated[0]}* = 0",)
        assert removal.equations_before == (T.basis.equations()[row],)


def test_removals_save_operations() -> None:
    T = task("puma560_measured")
    best = simplifications(T, bounds(T.mechanism, ["link6"]))[0]
    assert best.description == "link6 is symmetric along x and y already"
    assert best.eliminated == ("link6.mc_x", "link6.mc_y", "link6.I_xy", "link6.I_xz", "link6.I_yz")
    assert operations_saved(T, best) > 50
    assert by_symmetry(T, ("link1.mc_x",)) is None
    together = simplifications(T, bounds(T.mechanism, T.mechanism.description.body_names))[0]
    assert together.already_symmetric
    assert together.rank < best.rank
    assert together.description == "use all existing symmetries"
    assert operations_saved(T, together) > operations_saved(T, best)


def test_symmetries_are_recommended_before_masses() -> None:
    T = task("semi_direct_drive")
    places = bounds(T.mechanism, ARMS["semi_direct_drive"])
    found = tuple(simplifications(T, places))
    study = DesignStudy(T, point(1.0), places, 1.0, Counterweights(T, "energy", 1.0, (), (), 0), found[::-1])
    kinds = [removal.kind for removal, _ in study.recommended]
    assert kinds[0] == "symmetry" != kinds[-1]
    assert kinds == sorted(kinds, key=lambda kind: kind != "symmetry")
    for symmetry in (True, False):
        each = {removal.eliminated for removal in found if (removal.kind == "symmetry") is symmetry}
        assert sum((kind == "symmetry") is symmetry for kind in kinds) == min(len(each), 6)


def test_a_counterweight_of_a_gram_is_found() -> None:
    gram = MountingBounds("upper", np.array([-0.6, 0.0, 0.0]), np.zeros(3), 1e-3)
    (weight,) = optimal_counterweights(DesignTask.within_limits(adaptctl.load("two_link"), 20), [gram]).weights
    assert weight.mass == pytest.approx(1e-3)


@pytest.mark.parametrize("kept", [None, 0, 2])
def test_slopes_of_the_smallest_residuals_are_their_differences(kept: int | None) -> None:
    residuals, slopes = np.array([3.0, -0.5, 2.0, 1.0]), np.random.default_rng(0).normal(size=(4, 2))
    found = _beyond_slopes(residuals, slopes, kept)
    for k, step in enumerate(1e-6 * np.eye(2)):
        after, before = (_beyond(residuals + slopes @ way, kept) for way in (step, -step))
        np.testing.assert_allclose(found[:, k], (after - before) / 2e-6, atol=1e-8)


def test_a_task_without_energy_is_refused() -> None:
    """An arm whose only joint is vertical, at rest in many positions."""
    link = Link(
        "pillar",
        -1,
        Joint("turn"),
        Pose.identity(),
        Pose.identity(),
        from_center_of_mass(2.0, [0.1, 0, 0.2], np.eye(3)),
    )
    T = DesignTask.within_limits(Mechanism(Description("turntable", (link,))), 10, speed=0.0)
    for call in (
        lambda: added_mass(T, "pillar", 1.0),
        lambda: cost_map(T),
        lambda: design_study(T),
        T.energy_fractions,
        T.nonzero_parameters,
    ):
        with pytest.raises(InputError, match="the energy is equal in all states of the task"):
            call()
    faster = DesignTask.within_limits(T.mechanism, 10, speed=1.0)
    assert added_mass(faster, "pillar", 1.0, (0.5, 0.0, 0.0)).energy_change > 0.0
    np.testing.assert_allclose(faster.energy_fractions(), [1.0])
    with pytest.raises(InputError, match="the energy is equal in all states of the task"):
        faster.energy_fractions(np.zeros(10))


def test_a_task_along_a_reference() -> None:
    arm = adaptctl.load("puma560_measured")
    T = DesignTask.from_reference(arm, Sinusoids([0.0] * 6, [0.4] * 6, [0.1] * 6), 10.0, 300)
    assert T.p.shape == (300, 6)
    assert "10 s" in T.origin
    assert T.cost("energy") == pytest.approx(np.std(arm.energy(T.p, T.v)))


def _wrong() -> dict[str, tuple[object, str]]:
    T = task("puma560_measured")
    arm, within = T.mechanism, bounds(T.mechanism, ["link2"])
    still = np.zeros((10, 6))
    return {
        "link": (lambda: added_mass(T, "link9", 1.0), "no link 'link9' with inertia; links: link1, link2"),
        "mass": (lambda: added_mass(T, "link2", -1.0), "expected a mass of at least 0 kg, got -1"),
        "sphere": (lambda: sphere(-1.0), "mass: expected a number of at least 0 kg and at most 1e+20, got -1"),
        "box": (lambda: box(1.0, (0.1, -0.2, 0.1)), "y: expected a number above 0"),
        "axis": (lambda: cylinder(1.0, 0.1, 0.1, axis=(0.0, 0.0, 0.0)), "axis: expected a number above 0"),
        "nan": (lambda: added_mass(T, "link2", 1.0, (0.0, np.nan, 0.0)), "place: expected finite numbers"),
        "shape": (lambda: added_mass(T, "link2", 1.0, (0.0, 1.0)), "place: expected shape"),
        "outside": (lambda: within[0].validate((9.0, 0.0, 0.0)), "is outside the bounds"),
        "bounds": (lambda: MountingBounds("link2", np.ones(3), np.zeros(3), 1.0), "expected lower <= upper"),
        "heavy": (lambda: MountingBounds("link2", np.zeros(3), np.ones(3), -1.0), "expected a mass of at least 0 kg"),
        "share": (lambda: MountingBounds.for_link(arm, "link2", -0.2), "expected a ratio of at least 0"),
        "places": (lambda: MountingBounds.for_link(arm, "hand"), "no link 'hand'"),
        "none": (lambda: bounds(arm, []), "expected one or more different links, got none"),
        "twice": (lambda: bounds(arm, ["link2", "link2"]), "expected one or more different links"),
        "nothing": (lambda: optimal_counterweights(T, ()), "expected bounds for one or more different links"),
        "objective": (lambda: optimal_counterweights(T, within, "beauty"), "objective: expected one of energy, torque"),
        "density": (lambda: optimal_counterweights(T, within, density=-1.0), "density: expected a positive number"),
        "percent": (
            lambda: optimal_counterweights(T, within, percent=-1.0),
            "percent: expected a finite number",
        ),
        "still": (lambda: DesignTask(arm, still, still, still, "rest"), "task: the states are all equal"),
        "shapes": (lambda: DesignTask(arm, still, still[:5], still, ""), "expected one shape"),
        "samples": (lambda: DesignTask.within_limits(arm, 1), "samples: expected a whole number from 2 to 100000"),
        "speed": (
            lambda: DesignTask.within_limits(arm, 10, speed=-1.0),
            "speed: expected a finite number of at least 0",
        ),
        "map": (lambda: cost_map(T, -1.0), "mass"),
        "symmetry": (lambda: by_symmetry(T, ("link2.q",)), "unknown inertial parameter 'link2.q'"),
    }


@pytest.mark.parametrize("case", sorted(_wrong()))
def test_wrong_input_is_refused_with_what_would_be_right(case: str) -> None:
    call, told = _wrong()[case]
    with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
        call()  # type: ignore[operator]
    assert told in str(caught.value)
    assert isinstance(caught.value, AdaptctlError)


def test_constrained_mechanisms_are_refused() -> None:
    arm = constrained(adaptctl.load("semi_direct_drive"), Constraints(known={"link2.mc_y": 0.0}))
    with pytest.raises(InputError, match="ten parameters per link"):
        DesignTask.within_limits(arm, 10)
