"""What `import adaptctl` offers, and that it costs nothing."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import adaptctl
from adaptctl import control, description, design, identifiability
from adaptctl.control import adaptation
from adaptctl.packages import homes
from adaptctl.simulation import effects

LAZY = (adaptctl, description, identifiability, control, adaptation, effects, design)
"""Packages that import what they offer when it is used."""
OFFERED = [
    (package, home, name)
    for package in LAZY
    for name, home in homes(Path(str(package.__file__)).with_suffix(".pyi")).items()
]
HEAVY = ("pinocchio", "gymnasium", "rerun", "matplotlib", "scipy", "numpy", "control", "pyarrow", "llvmlite", "rich")


def test_import_imports_nothing_heavy() -> None:
    script = f"import sys, adaptctl; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_equations_need_no_robot_library() -> None:
    unneeded = ("pinocchio", "gymnasium", "rerun", "matplotlib", "pyarrow")
    script = f"import sys, adaptctl; adaptctl.load; print([name for name in {unneeded!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("package", "home", "name"), OFFERED)
def test_every_public_name_is_the_one_of_its_home(package: ModuleType, home: str, name: str) -> None:
    found = getattr(import_module(home), name)
    assert getattr(package, name) is found  # now that the module is there too
    if name == "__version__":
        assert found == version("adaptctl")
    else:
        assert found.__doc__


@pytest.mark.parametrize(("package", "home", "name"), OFFERED)
def test_no_module_takes_a_public_names_place(package: ModuleType, home: str, name: str) -> None:
    assert home == f"{package.__name__}.{name}" or find_spec(f"{package.__name__}.{name}") is None


@pytest.mark.parametrize("package", LAZY)
def test_public_names_are_listed_once_in_order_and_by_dir(package: ModuleType) -> None:
    assert sorted(package.__all__) == package.__all__ == sorted(set(package.__all__))
    assert set(package.__all__) <= set(dir(package))


@pytest.mark.parametrize("package", LAZY)
def test_other_names_do_not_exist(package: ModuleType) -> None:
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'laod'"):
        package.laod  # noqa: B018


def test_a_star_import_brings_every_name() -> None:
    script = (
        "from adaptctl.control import *; import adaptctl.control; print(set(adaptctl.control.__all__) <= set(dir()))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"


def test_ten_lines_are_enough() -> None:
    mechanism = adaptctl.load("puma560_measured")
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(mechanism))
    model = adaptctl.ReducedModel(mechanism, basis)
    controller = adaptctl.SlotineLi(model, 8.0, 0.02, adaptctl.adaptation_gain(model))
    reference = adaptctl.Sinusoids([0.0] * 6, [0.4] * 6, [0.1] * 6)
    state = controller.init([0.1] * 6, [0.0] * 6)
    torque, state = controller.step(state, [0.1] * 6, [0.0] * 6, reference(0.0))
    assert torque.shape == (6,)
    assert state.estimate.shape == (36,)
