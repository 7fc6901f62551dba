"""The core, where nothing but NumPy, llvmlite, msgspec and threadpoolctl is installed: what runs, and what is named."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from nightly import at_night

ROOT = Path(__file__).parent.parent
CORE = ("numpy", "numpy.libs", "llvmlite", "msgspec", "threadpoolctl.py")

WORK = """
import sys, numpy as np, adaptctl
from adaptctl.simulation import Plant, simulate_many
arm = adaptctl.load("puma560")
model = adaptctl.ReducedModel(arm)
law = adaptctl.SlotineLi(model, 8.0, [90, 150, 70, 20, 16, 18], adaptctl.adaptation_gain(model))
reference = adaptctl.Sinusoids(center=np.zeros(6), amplitude=np.full(6, 0.3), frequency=np.full(6, 0.3))
torque, state = law.step(law.init(np.zeros(6), np.zeros(6)), np.zeros(6), np.zeros(6), reference(0.0))
runs = simulate_many(Plant(arm, 1e-3), law, reference, duration=0.1, batch_size=4, p=np.full((4, 6), 0.05))
assert runs.finite.all() and runs.rms_error.max() < 0.1
print(*sorted({name.partition(".")[0] for name in sys.modules} - sys.stdlib_module_names - {"__main__"}))
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables of a process that finds those packages and this one, and no other."""
    place = tmp_path_factory.mktemp("packages")
    for name in CORE:
        home = Path(str(importlib.util.find_spec(name.partition(".")[0]).origin))  # type: ignore[union-attr]
        site = home.parent if home.name == name else home.parent.parent
        if (site / name).exists():
            (place / name).symlink_to(site / name)
    (place / "adaptctl").symlink_to(ROOT / "adaptctl")
    return os.environ | {"PYTHONPATH": str(place), "ADAPTCTL_CACHE": str(place / "cache")}


def ran(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    """A process of Python without its site packages."""
    command = [sys.executable, "-S", "-W", "ignore", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, cwd="/")


def test_load_basis_tick_and_many_arms_need_four_packages(environment: dict[str, str]) -> None:
    done = ran(environment, "-c", WORK)
    assert done.returncode == 0, done.stderr
    found = {name for name in done.stdout.split() if "cython" not in name}
    assert found == {"adaptctl", "llvmlite", "msgspec", "numpy", "threadpoolctl"}


@pytest.mark.parametrize(
    ("line", "what", "package"),
    [
        ("adaptctl.load('puma560').to_pinocchio()", "Mechanism.to_pinocchio", "pin"),
        at_night(("adaptctl.load('semi_direct_drive').home", "a mechanism with loops", "scipy")),
        ("adaptctl.control.Spline(np.zeros((6, 1)), np.arange(6))(0.5)", "Spline", "scipy"),
        (
            "import adaptctl.simulation; adaptctl.simulation.Rollout.load('run.parquet')",
            "Rollout.load",
            "'adaptctl[report]'",
        ),
    ],
)
def test_what_is_missing_is_named_with_its_cure(
    environment: dict[str, str], line: str, what: str, package: str
) -> None:
    done = ran(environment, "-c", f"import numpy as np, adaptctl, adaptctl.control; {line}")
    assert done.returncode == 1
    said = done.stderr.strip().splitlines()[-1]
    assert said.startswith(f"adaptctl.errors.MissingExtraError: {what} needs ")
    assert said.endswith(f"pip install {package}")


def test_the_command_names_it_in_one_line(environment: dict[str, str]) -> None:
    done = ran(environment, "-m", "adaptctl", "basis", "puma560")
    assert done.returncode == 1
    assert done.stderr.strip() == "adaptctl: the command line needs cyclopts: pip install cyclopts"
