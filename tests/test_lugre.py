"""Dynamic friction, against Pinocchio's dynamics and published numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control import PDGravity, Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import LinearlyImplicitEuler, Plant, RungeKutta4, simulate_many
from adaptctl.simulation.effects import Effect, ElasticJoints, Friction, JointEffect, LuGre
from adaptctl.simulation.integrator import integration

SLEDGE = """
<robot name="sledge"><link name="rail"/>
  <link name="block"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="block"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="50" velocity="50"/></joint>
</robot>"""
PENDULUM = SLEDGE.replace("prismatic", "revolute").replace('xyz="1 0 0"', 'xyz="0 1 0"').replace(
    "<inertial>", '<inertial><origin xyz="0 0 -0.1"/>'
).replace('iyy="1"', 'iyy="0.02"')  # fmt: skip
PAPER = LuGre(1.0, 1e5, stribeck=0.5, stribeck_speed=0.001, damping=np.sqrt(1e5), viscous=0.4)
"""of the paper's table I, on its mass of 1 kg"""


def written(folder: Path, text: str) -> Path:
    path = folder / "one.urdf"
    path.write_text(text)
    return path


@pytest.fixture
def sledge(tmp_path: Path) -> Mechanism:
    return load(written(tmp_path, SLEDGE))


def moved(arm: Mechanism, effect: Effect, forces: Array, speed: float = 0.0, substeps: int = 4) -> Array:
    """Positions, velocities and deflections, if any, (n, 3) before each millisecond of a force."""
    plant = Plant(arm, 1e-3, substeps, LinearlyImplicitEuler(), effects=[effect])
    state, rows = plant.init([0.0], [speed]), []
    for force in forces:
        rows.append((state.p[0], state.v[0], *state.drives))
        state = plant.step(state, [force])
    return np.array(rows)


def test_bristles_bend_as_in_the_paper_before_the_block_breaks_away(sledge: Mechanism) -> None:
    """Slowly to 1.425 N and back: x = (g/k) log(1/(1 - F/g)) with g = 1.5 N, and 0.0142 of 0.045 mm are lost on the way
    back to no force, as the bristles have crept; above 1.5 N the block slides."""
    ramp = 1.425 * np.linspace(0.0, 1.0, 10_000)
    there_and_back = moved(sledge, PAPER, np.concatenate((ramp, ramp[::-1])))[:, 0]
    bent = 1.5e-5 * np.log(1.0 / (1.0 - 0.95))
    assert there_and_back.max() == pytest.approx(bent, rel=0.02)
    returned = bent - 1.5e-5 * np.log(1.0 + 0.95)  # the same curve, begun at F/g = 0.95 the other way
    assert there_and_back[-1] == pytest.approx(returned, rel=0.02)
    beyond = moved(sledge, PAPER, np.linspace(0.0, 1.6, 10_000))[:, 0]
    assert beyond[9300] < 1e-4  # 1.488 N
    assert beyond[-1] > 1e-2


@pytest.mark.parametrize("speed", [-0.5, -2e-3, 5e-4, 1e-3, 0.1])
def test_steady_sliding_takes_the_curve_of_stribeck(sledge: Mechanism, speed: float) -> None:
    held = (1.0 + 0.5 * np.exp(-((speed / 1e-3) ** 2))) * np.sign(speed) + 0.4 * speed
    free = np.zeros(1)
    assert PAPER.torque(np.array([speed]), free)[0] == pytest.approx(held, rel=1e-12)
    heavy = sledge.with_parameters(1e9 * sledge.inertial_parameters)  # a mass whose speed friction does not change
    bent = moved(heavy, PAPER, np.zeros(2000), speed)[-1, 2]
    taken = PAPER.resistance(np.array([bent]), np.array([speed]), free, 1e-9)
    assert taken[0][0] + taken[1][0] * speed == pytest.approx(held, rel=1e-6)


def bristles(v: float, z: float, torque: float) -> tuple[float, float]:
    """Friction and bending of 1e4 N m/rad."""
    bending = v - 1e4 * abs(v) / (1.0 + 0.5 * np.exp(-((v / 0.05) ** 2))) * z
    return 1e4 * z + 5.0 * bending + 0.2 * v, bending


def rising_with_the_load(v: float, z: float, torque: float) -> tuple[float, float]:
    return 0.2 * v + (0.1 + 0.4 * abs(torque)) * v / np.hypot(v, 0.01), 0.0


@pytest.mark.parametrize(
    ("effect", "law"),
    [
        (LuGre(1.0, 1e4, stribeck=0.5, damping=5.0, viscous=0.2), bristles),
        (Friction(0.2, 0.1, load=0.4), rising_with_the_load),
    ],
    ids=["LuGre", "load"],
)
def test_a_pendulum_moves_as_by_the_dynamics_of_pinocchio(tmp_path: Path, effect: JointEffect, law: Any) -> None:
    pin, integrate = pytest.importorskip("pinocchio"), pytest.importorskip("scipy.integrate")
    path = written(tmp_path, PENDULUM)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    levels = (3.0, -4.0, 1.2, 0.0)

    def rates(t: float, x: Array, torque: float) -> list[float]:
        q, v, z = x
        friction, bending = law(v, z, torque)
        return [v, pin.aba(model, data, np.array([q]), np.array([v]), np.array([torque - friction]))[0], bending]

    x, exact, times = np.zeros(3), [], 1e-3 * np.arange(251)
    for level in levels:
        found = integrate.solve_ivp(rates, (0.0, 0.25), x, "Radau", times, args=(level,), rtol=1e-8, atol=1e-11).y
        exact, x = [*exact, *found[:, :-1].T], found[:, -1]
    torques = np.repeat(levels, 250)
    positions = (moved(load(path), effect, torques, substeps=n)[:, 0] for n in (4, 16))
    errors = [np.abs(p - np.array(exact)[:, 0]).max() for p in positions]
    assert np.ptp(exact, axis=0)[0] > 1.0
    assert errors[0] < 2e-3
    assert errors[1] < 0.5 * errors[0]


def test_an_arm_with_springs_and_bristles_is_held(tmp_path: Path) -> None:
    """Both states side by side: it stays where its friction holds it, against gravity."""
    arm = load(written(tmp_path, PENDULUM))
    effects = [ElasticJoints(1e4, 1.0, 0.05), LuGre(2.0, 1e4)]
    plant = Plant(arm, 1e-3, 4, LinearlyImplicitEuler(), effects=effects)
    assert plant.sizes["drives"] == 3
    state = plant.init([0.5], [0.0])
    for _ in range(1000):
        state = plant.step(state, [0.0])
    weight = 9.81 * 0.1 * np.sin(0.5)
    assert state.drives[0] * 1e4 == pytest.approx(-weight, rel=1e-3)
    assert 5e-5 < 0.5 - state.p[0] < 3e-4


def test_many_arms_are_one_by_one(tmp_path: Path) -> None:
    arm = load(written(tmp_path, PENDULUM))
    plant = Plant(arm, 1e-3, 4, LinearlyImplicitEuler(), effects=[LuGre(0.5, 1e4), Friction(viscous=0.1)])
    reference = Sinusoids([0.0], [[0.3]], [[0.5]], start_time=0.5)
    law = PDGravity.from_model(ReducedModel.full(arm), [20.0], [2.0])
    together = simulate_many(plant, law, reference, duration=0.5, p=np.array([[0.0], [0.1]]))
    alone = simulate_many(plant, law, reference, duration=0.5, p=np.array([[0.1]]))
    np.testing.assert_array_equal(together.p[:, 1], alone.p[:, 0])


def test_sticking_needs_an_implicit_integrator(sledge: Mechanism) -> None:
    assert integration(sledge, [PAPER], 1e-3) == (4, LinearlyImplicitEuler())
    needs = r"joints that stick, as by LuGre, or friction with a load need integrator=LinearlyImplicitEuler\(\)"
    for effect in (PAPER, Friction(load=0.1)):
        with pytest.raises(InputError, match=needs):
            Plant(sledge, 1e-3, effects=[effect])
    with pytest.raises(InputError, match=needs):
        integration(sledge, [PAPER], 1e-3, RungeKutta4())


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ([LuGre(0.0, 1.0)], "LuGre: coulomb: expected positive, finite numbers"),
        ([LuGre(1.0, np.inf)], "LuGre: stiffness: expected positive, finite numbers"),
        ([LuGre(1.0, 1.0, stribeck=-1.0)], "LuGre: stribeck: expected numbers of at least 0"),
        ([LuGre(1.0, 1.0, damping=np.inf)], "LuGre: damping: expected finite numbers"),
        ([LuGre(1.0, 1.0)] * 2, "LuGre is given 2 times, expected once"),
    ],
)
def test_wrong_settings_are_told(sledge: Mechanism, effects: list[Effect], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Plant(sledge, 1e-3, 4, LinearlyImplicitEuler(), effects=effects)
    with pytest.raises(InputError, match="stribeck_speed"):
        LuGre(1.0, 1.0, stribeck_speed=0.0)
