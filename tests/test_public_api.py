"""What `import adaptctl` offers, and that it costs nothing."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import adaptctl
from adaptctl import control, description, design, identifiability
from adaptctl.control import adaptation
from adaptctl.envs import TrackingEnv
from adaptctl.optional_packages import homes
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


def test_every_public_name_is_the_one_of_its_home() -> None:
    found = {(package, name): getattr(import_module(home), name) for package, home, name in OFFERED}
    others = [f"{of.__name__}.{name}" for (of, name), thing in found.items() if getattr(of, name) is not thing]
    assert others == []  # now that the modules are there too
    assert found[adaptctl, "__version__"] == version("adaptctl")
    assert [f"{of.__name__}.{name}" for (of, name), thing in found.items() if not thing.__doc__] == []


def test_no_module_takes_a_public_names_place() -> None:
    places = [(home, f"{package.__name__}.{name}") for package, home, name in OFFERED]
    assert [place for home, place in places if home != place and find_spec(place) is not None] == []


def test_public_names_are_listed_once_in_order_and_by_dir() -> None:
    lists = {package.__name__: package.__all__ for package in LAZY}
    assert lists == {name: sorted(set(names)) for name, names in lists.items()}
    assert {p.__name__: set(p.__all__) - set(dir(p)) for p in LAZY} == {name: set() for name in lists}


def test_other_names_do_not_exist() -> None:
    for package in LAZY:
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


def test_a_folder_of_the_package_is_there_without_an_import_of_its_own() -> None:
    code = "import adaptctl; adaptctl.control.Sinusoids; adaptctl.description.builtin_names()"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_name_of_a_folder_is_told_where_it_is() -> None:
    with pytest.raises(AttributeError, match=r"there is adaptctl\.control\.PDGravity$"):
        adaptctl.PDGravity  # noqa: B018


def test_samples_are_no_reference_and_the_message_says_what_makes_one() -> None:
    arm = adaptctl.load("two_link")
    with pytest.raises(adaptctl.InputError, match=r"a Reference.*Spline\(positions, times\) makes a Reference"):
        TrackingEnv(arm, np.zeros((10, 2)))
    with pytest.raises(adaptctl.InputError, match="expected an EssentialSpace"):
        adaptctl.fundamental_basis(arm)  # type: ignore[arg-type]
