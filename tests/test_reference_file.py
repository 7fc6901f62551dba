"""References from CSV files: what excite writes comes back, and what is wrong is named by its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptctl
from adaptctl.cli.main import main
from adaptctl.control import Spline
from adaptctl.errors import FileError, InputError, ReferenceWarning

JOINTS = ["shoulder", "elbow"]
HEAD = "time,shoulder,elbow\n"
ROWS = [f"{0.1 * k:.1f},{0.3 * np.sin(k):.6f},{0.2 * np.cos(k):.6f}" for k in range(12)]


def test_an_excitation_trajectory_comes_back(tmp_path: Path) -> None:
    assert main(["excite", "two_link", "--out", str(tmp_path / "motion"), "--iterations", "2", "--duration", "6"]) == 0
    motion = Spline.from_csv(tmp_path / "motion" / "excitation.csv", JOINTS)
    table = np.genfromtxt(tmp_path / "motion" / "excitation.csv", delimiter=",", names=True, deletechars="")
    inside = motion(table["time"][20:-20])
    for k, joint in enumerate(JOINTS):
        np.testing.assert_allclose(inside.p[:, k], table[f"position.{joint}"][20:-20], atol=1e-9)
        np.testing.assert_allclose(inside.v[:, k], table[f"velocity.{joint}"][20:-20], atol=1e-3)
        np.testing.assert_allclose(inside.a[:, k], table[f"acceleration.{joint}"][20:-20], atol=0.05)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("\n".join(ROWS), "no column 'time'"),
        ("time,shoulder,elbo\n" + "\n".join(ROWS), "did you mean 'elbo'"),
        ("time,shoulder,elbow,elbow\n" + "\n".join(ROWS), "two columns 'elbow'"),
        (HEAD + "\n".join([*ROWS[:3], "0.25,nan,0.1", *ROWS[3:]]), "line 5: shoulder: expected a"),
        ("# mine\n" + HEAD + "\n".join([*ROWS[:3], "0.25,0.1", *ROWS[3:]]), "line 6: elbow: expected a"),
        (HEAD + "\n".join([*ROWS, ROWS[-1]]), "line 14: time 1.1 s is not after"),
    ],
)
def test_what_is_wrong_is_named_by_its_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "motion.csv").write_text(text)
    with pytest.raises(FileError, match=words.replace("(", r"\(")):
        Spline.from_csv(tmp_path / "motion.csv", JOINTS)


def test_too_few_rows_and_degrees_are_told(tmp_path: Path) -> None:
    (tmp_path / "few.csv").write_text(HEAD + "\n".join(ROWS[:4]))
    with pytest.raises(InputError, match="at least 6 positions"):
        Spline.from_csv(tmp_path / "few.csv", JOINTS)
    degrees = [f"{k},{30 + k},{-60 - k}" for k in range(12)]
    (tmp_path / "degrees.csv").write_text(HEAD + "\n".join(degrees))
    reference = Spline.from_csv(tmp_path / "degrees.csv", JOINTS)
    with pytest.warns(ReferenceWarning, match="look like degrees"):
        adaptctl.envs.TrackingEnv(adaptctl.load("two_link"), reference, duration=1.0)
