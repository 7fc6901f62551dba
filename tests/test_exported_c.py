"""The test that exported C comes with, built and run: what it does is what Python does."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from c_compiler import build, said
from golden.capture import arms
from nightly import mostly_at_night

import adaptctl
from adaptctl.cli.main import main

LAWS = tuple(arms()["two"])
CALLER = """#include <stdio.h>
{declared}
int main(void) {{
{called}
    return 0;
}}
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What the tests of all laws on an arm of two links print, by the law's name: one program, built at once."""
    folder, laws = tmp_path_factory.mktemp("laws"), arms()["two"]
    names = {law: f"law_{re.sub(r'[^a-z]', '_', law)}" for law in laws}
    for law, name in names.items():
        adaptctl.export(laws[law], folder / name, name=name, without_safety_filter=True, large_stack=True)
        size = json.loads((folder / name / "manifest.json").read_text())["state_bytes"]
        right = f"typedef char size_as_told[sizeof({name}_state) == {size} ? 1 : -1];\n"
        (folder / f"{name}.c").write_text(f'#define main {name}_test\n#include "{name}/test_{name}.c"\n{right}')
    declared = "\n".join(f"int {name}_test(void);" for name in names.values())
    called = "\n".join(f'    printf("{name}\\n"); {name}_test();' for name in names.values())
    (folder / "main.c").write_text(CALLER.format(declared=declared, called=called))
    sources = [source for name in names.values() for source in (f"{name}/{name}.c", f"{name}.c")]
    told = said(build(folder, "main.c", *sources)).split("law_")[1:]
    return dict(zip(names, told, strict=True))


@pytest.mark.parametrize("law", LAWS)
def test_the_exported_test_of_every_law_passes(outcomes: dict[str, str], law: str) -> None:
    _, *failures, last = outcomes[law].splitlines()
    assert failures == []
    assert last.startswith("passed: torques within ")


@pytest.mark.parametrize("law", mostly_at_night(["slotine-li", "slotine-li-learning"], "slotine-li"))
def test_the_exported_test_of_the_puma_passes_when_optimised(tmp_path: Path, law: str) -> None:
    """The default law, of 60 kB, compiles for a minute."""
    assert main(["export", "puma560_measured", "--law", law, "--out", str(tmp_path / "arm"), "--name", "arm"]) == 0
    program = build(tmp_path / "arm", "arm.c", "test_arm.c", flags=("-O2",))
    assert re.fullmatch(r"passed: torques within \S+ of \S+ N m\n", said(program))
