"""Messages name arguments in Python, and flags on the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic_logs import known

import adaptctl
from adaptctl.cli.main import main
from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.errors import InputError
from adaptctl.identification.argument_words import arguments_of, in_flags

WORDS = {
    "take it by --trust-log": "take it by trust_log=True",
    "give the rate with --sample-rate HZ": "give the rate with sample_rate=HZ",
    "; or leave out this check by --skip-steps limits": "; or leave out this check by skip_steps=['limits']",
    "if the others did not move: --lock j2 j3": "if the others did not move: adaptctl.load(ROBOT, lock=['j2', 'j3'])",
    "--columns time=NAME, or else": "columns={'time': 'NAME'}, or else",
    "--columns time=t position=q{} --units time=ms 'torque=N m' (or": (
        "columns={'time': 't', 'position': 'q{}'} units={'time': 'ms', 'torque': 'N m'} (or"
    ),
    "with --columns, such as position=q{} ({} is": "with columns, such as {'position': 'q{}'} ({} is",
    "--friction viscous,stiffness has it": "friction='viscous,stiffness' has it",
    "--template FILE writes": "adaptctl identify LOG --robot ROBOT --template FILE writes",
    "a larger --prior-weight keeps them": "a larger prior_weight keeps them",
    "joint-2 moves -- slowly": "joint-2 moves -- slowly",
}


@pytest.mark.parametrize("flags", WORDS)
def test_flags_become_arguments(flags: str) -> None:
    assert arguments_of(flags) == WORDS[flags]
    assert in_flags(arguments_of)(flags) == flags


def test_a_call_is_told_arguments_and_a_command_flags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case, robot, log = known(3), tmp_path / "arm.toml", tmp_path / "log.csv"
    write_mechanism(robot, case.guess.description)
    names = [f"{what}{j}" for what in ("q", "tau") for j in range(3)]
    rows = np.column_stack([case.log.time, case.log.position, case.log.torque])[:2000]
    np.savetxt(log, rows, delimiter=",", header=",".join(["t", *names]), comments="")
    with pytest.raises(InputError, match=r"columns=\{'time': 't', 'position': 'q\{0\}', 'torque': 'tau\{0\}'\}"):
        adaptctl.identify(log, robot)
    assert main(["identify", str(log), "--robot", str(robot), "--out", str(tmp_path / "out")]) == 2
    assert "--columns time=t position=q{0} torque=tau{0} " in capsys.readouterr().err
