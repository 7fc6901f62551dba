"""Base parameters in the order and the frames of other tools, against those tools' own regressors and numbers."""

from __future__ import annotations

import json
import sys

import mujoco
import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

import adaptctl
from adaptctl import FundamentalBasis, Mechanism
from adaptctl.cli.main import main
from adaptctl.errors import InputError, NotFoundError
from adaptctl.identifiability.chosen_columns import chosen_columns


def regressors(model: pinocchio.Model, samples: int) -> NDArray[np.float64]:
    """Pinocchio's torque regressors of random states, one over the other."""
    random, data = np.random.default_rng(1), model.createData()
    states = random.uniform(-1.0, 1.0, (samples, 3, model.nv))
    return np.vstack([pinocchio.computeJointTorqueRegressor(model, data, *state) for state in states])


def test_kept_columns_of_pinocchios_regressor_are_all_of_it() -> None:
    """W = W_c K on new states, of an arm whose joints are Pinocchio's own sample."""
    model = pinocchio.buildSampleModelManipulator()
    arm = Mechanism.from_pinocchio(model)
    links = [link.name for link in arm.links]
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm)).in_order("pinocchio", links)
    W = regressors(model, 40)
    np.testing.assert_allclose(W, W[:, list(basis.columns)] @ basis.regrouping, atol=1e-9 * np.abs(W).max())
    assert np.linalg.matrix_rank(W, tol=1e-9 * np.abs(W).max()) == basis.rank


def test_pi_of_mujoco_gives_its_inverse_dynamics(elsewhere: None) -> None:
    """The numbers as `mujoco.sysid` orders them, taken from the compiled model, with the basis of the command."""
    arm = adaptctl.load("scene")
    own = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    theirs = own.in_order("mujoco")
    model = mujoco.MjModel.from_xml_path(str(adaptctl.description.builtin_file("scene")))
    bodies = [name.removesuffix(".m") for name in theirs.parameter_names if name.endswith(".m")]
    pi = np.concatenate([pi_of(model, body) for body in bodies] + [model.dof_armature[-3:]])
    expected = own.fundamental_parameters(arm.inertial_parameters[: arm.num_energy_parameters])
    found = dict(zip(theirs.names, theirs.fundamental_parameters(pi), strict=True))
    assert found == pytest.approx(dict(zip(own.names, expected, strict=True)), abs=1e-12)


def pi_of(model: mujoco.MjModel, body: str) -> NDArray[np.float64]:
    """Mass, first moment, and I_xx, I_yy, I_zz, I_xy, I_yz, I_xz about the body's origin."""
    i, turn = model.body(body).id, np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[i])
    R, m, c = turn.reshape(3, 3), model.body_mass[i], model.body_ipos[i]
    tensor = R @ np.diag(model.body_inertia[i]) @ R.T + m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([m, *(m * c), *(tensor[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)))])


@pytest.fixture(scope="module")
def basis() -> FundamentalBasis:
    return adaptctl.fundamental_basis(adaptctl.essential_space(adaptctl.load("two_link")))


def test_links_of_another_order_move_with_their_ten(basis: FundamentalBasis) -> None:
    other = basis.in_order("drake", ["lower", "upper"])
    assert other.parameter_names[:3] == ("lower.m", "lower.mc_x", "lower.mc_y")
    assert other.parameter_names[10:16] == (
        "upper.m", "upper.mc_x", "upper.mc_y", "upper.mc_z", "upper.I_xx", "upper.I_yy",
    )  # fmt: skip
    assert sorted(other.names) == sorted(basis.names)
    assert other.equations()[other.names.index("upper.mc_x")] == "upper.mc_x* = upper.mc_x + 0.4 (lower.m + upper.m)"


def test_what_is_unknown_is_named(basis: FundamentalBasis) -> None:
    with pytest.raises(NotFoundError, match="tool: expected one of pinocchio, figaroh, mujoco, drake, got 'casadi'"):
        basis.in_order("casadi")
    with pytest.raises(NotFoundError, match=r"unknown link 'uper' \(did you mean 'upper'\?\); links: upper, lower"):
        basis.in_order("drake", ["uper", "lower"])
    with pytest.raises(InputError, match="links: expected each of upper, lower once, got lower, lower"):
        basis.in_order("drake", ["lower", "lower"])


def test_the_command_takes_frames_at_the_joints(capsys: pytest.CaptureFixture[str]) -> None:
    """Of an arm whose own frames are at the links' far ends: Pinocchio's regressor has its own."""
    assert main(["basis", "puma560_measured", "--for", "pinocchio", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    W, K = regressors(adaptctl.load("puma560_measured").to_pinocchio(), 30), np.array(content["regrouping"])
    np.testing.assert_allclose(W, W[:, content["columns"]] @ K[:, : W.shape[1]], atol=1e-9 * np.abs(W).max())


def test_only_the_usual_order_and_tolerance_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who asks for an order or a tolerance gets what he asked for."""
    space, given = adaptctl.essential_space(adaptctl.load("two_link")), list[float | None]()
    module, chosen = sys.modules["adaptctl.identifiability.fundamental_basis"], chosen_columns
    monkeypatch.setattr(module, "chosen_columns", lambda *asked: given.append(asked[-1]) or chosen(*asked))
    monkeypatch.setattr(module.object_cache, "kept", lambda what, inputs, kind, make: make())
    adaptctl.fundamental_basis(space)
    adaptctl.fundamental_basis(space, adaptctl.Priority(keep=("lower.m",)))
    adaptctl.fundamental_basis(space, tolerance=1e-4)
    assert given == [0.03, None, None]
