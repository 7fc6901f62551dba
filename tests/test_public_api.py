"""What `import adaptctl` offers, and that it costs nothing."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from importlib.metadata import version

import pytest

import adaptctl

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


@pytest.mark.parametrize("name", adaptctl.__all__)
def test_every_public_name_is_the_one_of_its_home(name: str) -> None:
    found = getattr(adaptctl, name)
    if name == "__version__":
        assert found == version("adaptctl")
    else:
        assert found is getattr(import_module(adaptctl._HOME_OF[name]), name)
        assert found.__doc__


def test_public_names_are_listed_once_in_order_and_by_dir() -> None:
    assert sorted(adaptctl.__all__) == adaptctl.__all__ == sorted(set(adaptctl.__all__))
    assert set(adaptctl.__all__) <= set(dir(adaptctl))
    assert set(adaptctl._HOME_OF) | {"__version__"} == set(adaptctl.__all__)


def test_other_names_do_not_exist() -> None:
    with pytest.raises(AttributeError, match="no attribute 'laod'"):
        adaptctl.laod  # noqa: B018


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
