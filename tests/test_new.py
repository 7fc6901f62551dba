"""`adaptctl new`: a file to begin with, which is the robot it was made from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptctl
from adaptctl.cli.main import main
from adaptctl.description import builtin_file


@pytest.mark.parametrize("suffix", [".toml", ".xml"])
@pytest.mark.parametrize("robot", ["two_link", "puma560_geared"])
def test_a_new_file_has_the_torques_of_its_model(tmp_path: Path, suffix: str, robot: str) -> None:
    file = tmp_path / f"my_arm{suffix}"
    assert main(["new", str(file), "--like", robot]) == 0
    mine, theirs = adaptctl.load(file), adaptctl.load(robot)
    p, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 20, theirs.dof))
    np.testing.assert_allclose(mine.inverse_dynamics(p, v, a), theirs.inverse_dynamics(p, v, a), rtol=1e-9, atol=1e-9)


def test_a_builtin_is_copied_with_its_comments(tmp_path: Path) -> None:
    assert main(["new", str(tmp_path / "my_arm.toml")]) == 0
    assert (tmp_path / "my_arm.toml").read_bytes() == builtin_file("two_link").read_bytes()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["my_arm.urdf"], "ends in .toml or .xml"),
        (["my_arm.toml", "--like", "puma561"], "did you mean"),
        (["there.toml"], "--overwrite"),
        (["my_arm.xml", "--like", "semi_direct_drive"], "loop"),
    ],
)
def test_what_cannot_be_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.toml").write_text("mine")
    assert main(["new", *line]) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there.toml"]
    assert Path("there.toml").read_text() == "mine"
