"""Packages that are not installed, as after `--no-deps` on a robot: every command works, or names one in a line."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import at_night

import adaptctl

HIDING = """
import os, sys

class Hiding:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in os.environ["HIDDEN"].split():
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hiding())
"""
"""A module that Python imports as it starts."""

RUNNING = """
import contextlib, io, json, sys
from adaptctl.cli.main import main

for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    lines = [line for line in err.getvalue().splitlines() if ": note: " not in line]
    print(json.dumps([" ".join(words), code, lines]), flush=True)
"""

API = """
import numpy as np, adaptctl
from adaptctl.envs import TrackingEnv
from adaptctl.errors import MissingExtraError
arm = adaptctl.load("two_link")
model = adaptctl.ReducedModel(arm)
tuning = adaptctl.tune(arm)
env = TrackingEnv(arm, tuning.reference, duration=0.1)
run = adaptctl.simulate(env, tuning.controller(model), seed=0)
assert np.isfinite(run.p).all()
try:
    adaptctl.export(tuning.controller(model), "nowhere", without_safety_filter=True)
except MissingExtraError as error:
    print(error)
"""

ROBOT = "two_link"
REPORT = "jinja2 matplotlib pyarrow"
NAMED = re.compile(r"adaptctl: [\w. -]+ needs (?P<what>\w+): pip install (?P<how>\S+)")


def commands(folder: Path) -> dict[str, list[str]]:
    """A line of each command that comes to its end, by a short name."""
    run = ["--robot", ROBOT, "--duration", "0.1"]
    log = ["--columns", "position=position{}", "torque=torque{}", "--units", "time=s", "position=rad", "torque=N m"]
    return {
        "basis": ["basis", ROBOT],
        "gains": ["gains", ROBOT],
        "tune": ["tune", ROBOT],
        "design": ["design", ROBOT],
        "design to a folder": ["design", ROBOT, "--out", str(folder / "design")],
        "excite": ["excite", ROBOT, "--out", str(folder / "excite")],
        "export": ["export", ROBOT, "--out", str(folder / "export")],
        "export wasm": ["export", ROBOT, "--language", "wasm", "--out", str(folder / "wasm")],
        "identify": ["identify", str(folder / "log.csv"), *log, "--robot", ROBOT, "--out", str(folder / "identify")],
        "experiment list": ["experiment", "list"],
        "experiment run": ["experiment", "run", "adaptive", *run, "--out", str(folder / "run")],
        "doctor": ["doctor"],
        "install-completion": ["install-completion", "--shell", "bash", "--out", str(folder / "script")],
    }


def test_a_name_that_was_asked_for_is_found_at_once_from_then_on() -> None:
    vars(adaptctl).pop("Sinusoids", None)
    found = adaptctl.Sinusoids
    assert vars(adaptctl)["Sinusoids"] is found


@pytest.fixture(scope="module")
def hiding(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("hiding")
    (place / "sitecustomize.py").write_text(HIDING)
    return place


def python(hiding: Path, hidden: str, *words: str) -> str:
    """What a process prints that does not find some packages."""
    path = os.pathsep.join(filter(None, [str(hiding), os.environ.get("PYTHONPATH", str(Path.cwd()))]))
    known = os.environ | {"PYTHONPATH": path, "HIDDEN": hidden}
    done = subprocess.run([sys.executable, "-W", "ignore", *words], env=known, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def write_log(path: Path) -> None:
    t = np.arange(0.0, 8.0, 0.005)
    p = np.stack([0.5 * np.sin(2.0 * t), 0.4 * np.sin(3.3 * t)], axis=1)
    v, a = np.gradient(p, 0.005, axis=0), np.gradient(np.gradient(p, 0.005, axis=0), 0.005, axis=0)
    torque = adaptctl.load(ROBOT).inverse_dynamics(p, v, a)
    header = "time,position1,position2,torque1,torque2"
    np.savetxt(path, np.c_[t, p, torque], delimiter=",", header=header, comments="")


@pytest.fixture(scope="module")
def said(hiding: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What each command does, by what is hidden."""

    @cache
    def told(hidden: str, names: str = "") -> dict[str, tuple[int, list[str]]]:
        folder = tmp_path_factory.mktemp("out")
        write_log(folder / "log.csv")
        lines = {name: words for name, words in commands(folder).items() if not names or name in names.split(", ")}
        out = python(hiding, hidden, "-c", RUNNING, json.dumps(list(lines.values())))
        found = [json.loads(line) for line in out.splitlines()]
        assert [words for words, *_ in found] == [" ".join(words) for words in lines.values()]
        return {name: (code, err) for name, (_, code, err) in zip(lines, found, strict=True)}

    return told


NAMING = {
    "control pinocchio": {"gains"},
    "gymnasium": {"experiment run"},
    "rerun": {"design to a folder", "identify", "experiment run"},
    "rich": {"basis", "gains", "tune", "design", "design to a folder", "experiment run"},
}
NEEDING = {
    "control pinocchio": "basis, gains, tune, export, experiment list, doctor",
    "gymnasium": "basis, tune, export, experiment list, experiment run, doctor",
    "rerun": "basis, tune, design to a folder, identify, experiment run, doctor",
    "rich": "basis, gains, tune, design, design to a folder, experiment list, experiment run, doctor",
}
"""Packages, and the commands that name one of them, with some quick ones that work without."""


@pytest.mark.parametrize(
    ("hidden", "names"),
    [(REPORT, ""), *map(at_night, [("scipy", ""), *NEEDING.items(), *((hidden, "") for hidden in ("", *NEEDING))])],
)
def test_every_command_works_or_names_a_package(said: Any, hidden: str, names: str) -> None:
    found = said(hidden, names) if names else said(hidden)
    if names:
        assert {name for name, (code, _) in found.items() if code} >= NAMING[hidden]
    for name, (code, lines) in found.items():
        if code == 0:
            assert not [line for line in lines if "interrupted" in line or "Traceback" in line], name
            continue
        assert code == 1, (name, code, lines)
        assert len(lines) == 1, (name, lines)
        found = NAMED.fullmatch(lines[0])
        assert found, (name, lines)
        assert found["what"] in hidden.split(), name
        assert found["how"].strip("'") in (found["what"], "adaptctl[report]", "rerun-sdk", "pin"), name


def test_what_needs_no_report_works_without_its_packages(said: Any) -> None:
    told = said(REPORT)
    done = {name for name, (code, _) in told.items() if code == 0}
    assert done == {"basis", "tune", "design", "experiment list", "doctor"}
    for name in told.keys() - done:
        assert told[name][1][0].endswith(": pip install 'adaptctl[report]'"), name


def test_python_loads_learns_and_simulates_without_them(hiding: Path) -> None:
    assert python(hiding, REPORT, "-c", API) == "adaptctl.export needs jinja2: pip install 'adaptctl[report]'\n"
