"""Names that examples in docstrings share, and the collection of these examples."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from _pytest.doctest import DoctestModule, DoctestTextfile

PACKAGE = Path(__file__).parent / "adaptctl"
NOT_IMPORTABLE = {PACKAGE / "envs" / "sb3.py"}  # it needs stable-baselines3, which is not in requirements.lock


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """The examples of a module of the package, without those of tests and of docs' scripts."""
    if file_path.suffix != ".py" or PACKAGE not in file_path.parents or file_path in NOT_IMPORTABLE:
        return None
    if parent.config.option.doctestmodules:
        return None
    return DoctestModule.from_parent(parent, path=file_path)


@cache
def _shared() -> dict[str, Any]:
    """A planar arm of two links and what is made of it, once per process."""
    import numpy as np  # not above: it reads what tests/conftest.py sets

    import adaptctl
    from adaptctl.envs import TrackingEnv
    from adaptctl.simulation import Plant

    arm = adaptctl.load("two_link")
    space = adaptctl.essential_space(arm)
    basis = adaptctl.fundamental_basis(space)
    model = adaptctl.ReducedModel(arm, basis)
    reference = adaptctl.Sinusoids(center=[0.3, 0.5], amplitude=[0.4, 0.3], frequency=[0.5, 0.8])
    law = adaptctl.SlotineLi(model, bandwidth=5.0, damping=[6.0, 2.0], adaptation=np.full(len(basis.names), 0.1))
    env = TrackingEnv(arm, reference, duration=0.2)
    return {
        **{"np": np, "adaptctl": adaptctl, "arm": arm, "space": space, "basis": basis, "model": model},
        **{"period": 1e-3, "reference": reference, "law": law, "plant": Plant(arm, 1e-3)},
        **{"env": env, "run": adaptctl.rollout(env, law, seed=0)},
    }


@pytest.fixture(autouse=True)
def _elsewhere(request: pytest.FixtureRequest) -> None:
    """Pages run in an empty folder, as their readers do."""
    if isinstance(request.node.parent, DoctestTextfile):
        request.getfixturevalue("monkeypatch").chdir(request.getfixturevalue("tmp_path"))


@pytest.fixture(autouse=True)
def _names(request: pytest.FixtureRequest, doctest_namespace: dict[str, Any], tmp_path_factory: Any) -> None:
    """What examples need not import; arrays and generators are new for each."""
    if isinstance(request.node.parent, DoctestModule):
        import numpy as np

        own = {"p": np.array([0.3, 0.5]), "v": np.array([0.2, -0.1]), "rng": np.random.default_rng(0)}
        doctest_namespace.update(_shared() | own | {"tmp": tmp_path_factory.mktemp("example")})
