"""Base parameters for figaroh and Drake, against those tools' own regressors: `make check-neighbours`.

Both read one URDF. figaroh builds its torque regressor; Drake's inverse dynamics is affine in mass, first moments and
moments, so that its columns are differences of torques. All columns must be combinations of the kept ones, as the basis
has it. Names each tool that is missing, with the command that brings it.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pinocchio

import adaptctl
from adaptctl.arrays import Array
from adaptctl.contest.entries import ContestEntry

URDF = """<robot name="arm"><link name="world"/>{links}</robot>"""
LINK = """<link name="l{i}"><inertial><origin xyz="0.1 0.02 {i}e-2"/><mass value="{i}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{i}" type="revolute"><parent link="{parent}"/><child link="l{i}"/><origin xyz="0.2 0 0.1" rpy="{rpy}"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="50" velocity="3"/></joint>"""
TURNS = ("0 0 0", "1.5707963267948966 0 0", "0 0 0", "0.3 0.2 0.1", "1.5707963267948966 0 0")
TEXT = URDF.format(
    links="".join(LINK.format(i=i, parent=f"l{i - 1}" if i > 1 else "world", rpy=rpy) for i, rpy in enumerate(TURNS, 1))
)
SAMPLES, DOF = 60, len(TURNS)
MOST = 1e-9
"""of the largest entry, that a column may differ"""
PLANTS, SAME = ("adaptctl", "drake"), 1e-5
"""plants of a contest, and relative difference of their runs, whose integrators are not the same"""


def figaroh_regressor(states: Array) -> Array:
    """figaroh's own, whose columns are in Pinocchio's order."""
    from figaroh.tools.regressor import RegressorBuilder, RegressorConfig

    model = pinocchio.buildModelFromXML(TEXT)
    robot = SimpleNamespace(model=model, data=model.createData())
    every = {"act_idxv": list(range(DOF))}
    return np.asarray(RegressorBuilder(robot, RegressorConfig()).build_basic_regressor(*states, every))


def drake_regressor(states: Array) -> Array:
    """Differences of Drake's torques, of bodies with other numbers."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import MultibodyForces, SpatialInertia, UnitInertia

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(TEXT, "urdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()

    def torques(parameters: Array) -> Array:
        for i, ten in enumerate(parameters.reshape(-1, 10), 1):
            m = ten[0]
            inertia = SpatialInertia(m, ten[1:4] / m, UnitInertia(*(ten[4:] / m)), skip_validity_check=True)
            plant.GetBodyByName(f"l{i}").SetSpatialInertiaInBodyFrame(context, inertia)
        found = []
        for p, v, a in states.transpose(1, 0, 2):
            plant.SetPositions(context, p)
            plant.SetVelocities(context, v)
            without = plant.CalcInverseDynamics(context, a, MultibodyForces(plant))
            found.append(without - plant.CalcGravityGeneralizedForces(context))
        return np.concatenate(found)

    some = np.tile([1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], DOF)
    return np.stack([torques(some + unit) - torques(some) for unit in np.eye(len(some))], axis=1)


def main() -> int:
    arm = adaptctl.Mechanism.from_pinocchio(pinocchio.buildModelFromXML(TEXT))
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    states, failed = np.random.default_rng(1).normal(size=(3, SAMPLES, DOF)), 0
    for tool, package, regressor in (
        ("figaroh", "figaroh", figaroh_regressor),
        ("drake", "pydrake", drake_regressor),
    ):
        if find_spec(package) is None:
            print(f"{tool} is missing: .venv-neighbours/bin/pip install {tool}")
            failed = 1
            continue
        W, theirs = regressor(states), basis.in_order(tool)
        size = np.abs(W).max()
        rest = np.abs(W - W[:, list(theirs.columns)] @ theirs.regrouping[:, : W.shape[1]]).max() / size
        rank = np.linalg.matrix_rank(W, tol=MOST * size)
        print(f"{tool}: {W.shape[1]} columns of rank {rank}, basis {theirs.rank}; largest difference {rest:.1e}")
        failed |= int(rest > MOST or rank != theirs.rank)
    if find_spec("pydrake") is not None:
        failed |= not drake_moves_arms_as_we_do()
    return failed


def drake_moves_arms_as_we_do() -> bool:
    """Whether a contest has the same errors and torques on both plants."""
    conditions, apart = ("links-wrong", "late", "payload", "push", "saturation", "low-rate"), 0.0
    for robot in ("two_link", "puma560_geared"):
        of = {plant: ContestEntry("gradient", robot, "", conditions, (1,), 8.0, (), plant).rows() for plant in PLANTS}
        for ours, theirs in zip(*of.values(), strict=True):
            apart = max(apart, *(abs(theirs[name] / ours[name] - 1.0) for name in ("error", "torque")))
    print(f"drake as the plant: errors and torques of {2 * len(conditions)} runs differ by {apart:.1e}")
    return apart < SAME


if __name__ == "__main__":
    sys.exit(main())
