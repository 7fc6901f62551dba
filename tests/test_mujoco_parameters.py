"""Base parameters of MuJoCo specifications, against MuJoCo's inverse dynamics."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from adaptctl.description.inertia import is_physically_consistent
from adaptctl.errors import InputError, MissingExtraError, NotFoundError
from adaptctl.identification import MujocoBaseParameters

ARM = """<mujoco><worldbody><body name="base" pos="0 0 1"><body name="upper" euler="20 0 0"><joint name="a" axis="0 0 1"
armature="0.05"/><inertial pos="0.1 0 0.02" mass="3" fullinertia="0.03 0.04 0.05 0.002 0.001 0"/>
<body name="lower" pos="0.4 0 0"><joint name="b" axis="0 1 0" pos="0.01 0 0"/>
<inertial pos="0.1 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
<body name="tool" pos="0.3 0 0.1" euler="0 30 40"><inertial pos="0.05 0 0" mass="0.5" diaginertia="0.002 0.001 0.002"/>
</body></body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def base() -> MujocoBaseParameters:
    return MujocoBaseParameters.of(mujoco.MjSpec.from_string(ARM))


def torques(spec: mujoco.MjSpec) -> NDArray[np.float64]:
    """MuJoCo's torques in some states."""
    model, random = spec.compile(), np.random.default_rng(0)
    data, out = mujoco.MjData(model), []
    for _ in range(5):
        data.qpos[:], data.qvel[:], data.qacc[:] = random.normal(size=(3, 2))
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.concatenate(out)


def written(base: MujocoBaseParameters, values: NDArray[np.float64]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ARM)
    base.write(spec, values)
    return spec


def test_what_the_start_writes_moves_as_the_specification(base: MujocoBaseParameters) -> None:
    """With what is fixed to a body, which becomes massless."""
    spec = written(base, base.values)
    np.testing.assert_allclose(torques(spec), torques(mujoco.MjSpec.from_string(ARM)), atol=1e-9)
    assert spec.compile().body("tool").mass == 0.0


def test_torques_are_affine_in_the_values(base: MujocoBaseParameters) -> None:
    """Exactly, although the bodies that have them are not: finite differences of MuJoCo's toolbox need it."""
    step = 0.2 * np.random.default_rng(1).uniform(-1.0, 1.0, len(base.names))
    at = [torques(written(base, base.values + k * step)) for k in (0.0, 1.0, 2.0)]
    assert np.abs(at[1] - at[0]).max() > 0.1
    np.testing.assert_allclose(at[2] - at[1], at[1] - at[0], atol=1e-9)
    nearby = torques(written(base, base.values + 1e-8 * step))
    np.testing.assert_allclose((nearby - at[0]) / 1e-8, at[1] - at[0], atol=1e-4)


def test_each_value_changes_the_torques(base: MujocoBaseParameters) -> None:
    start = torques(written(base, base.values))
    columns = [torques(written(base, base.values + 0.1 * unit)) - start for unit in np.eye(len(base.names))]
    scaled = np.array([column / np.linalg.norm(column) for column in columns])
    assert np.linalg.cond(scaled) < 100.0


@pytest.mark.parametrize("seed", range(4))
def test_values_that_no_body_has_give_bodies_that_mujoco_compiles(base: MujocoBaseParameters, seed: int) -> None:
    values = base.values + np.random.default_rng(seed).uniform(-10.0, 10.0, len(base.names))
    assert all(is_physically_consistent(ten) for ten in base.bodies(values))
    written(base, values).compile()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="lower"', 'name="lower" gravcomp="1"', "body 'lower' has gravity compensation"),
        ('name="tool"', "", "body 'body4' has no name; name it"),
        ("<mujoco>", '<mujoco><option density="1.2"/>', "drag depends on each body's inertia"),
        ("<mujoco>", '<mujoco><compiler inertiafromgeom="true"/>', "compiler: inertiafromgeom replaces what"),
        ('<body name="base" pos="0 0 1">', '<body name="base"><freejoint/><inertial pos="0 0 0" mass="1" '
         'diaginertia="1 1 1"/>', "body 'base' has a floating base"),
    ],
)  # fmt: skip
def test_what_base_parameters_do_not_cover_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MujocoBaseParameters.of(mujoco.MjSpec.from_string(ARM.replace(old, new)))


def test_wrong_arguments_are_named(base: MujocoBaseParameters, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotFoundError, match="uper"):
        MujocoBaseParameters.of(mujoco.MjSpec.from_string(ARM), "uper")
    with pytest.raises(InputError, match=r"values: expected shape \(..., \d+\), got \(2,\)"):
        base.bodies(np.zeros(2))
    with pytest.raises(InputError, match="reach: expected"):
        base.to_sysid(reach=-1.0)
    monkeypatch.setitem(sys.modules, "mujoco.sysid", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'mujoco\[sysid\]'"):
        base.to_sysid()
