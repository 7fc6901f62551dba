"""What exported C and WebAssembly are made of: names, numbers, memory and places of small functions."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import ARM, LAWS, law_named
from test_live_arm import shown
from wasm_machine import Machine

from adaptctl.codegen import builds, live_arm
from adaptctl.codegen.builds import Build
from adaptctl.codegen.c_function import CNumber, CStatements, Kind, _side_by_side, most_alive
from adaptctl.codegen.c_package import title
from adaptctl.codegen.c_program import CProgram
from adaptctl.codegen.exporting import Exported, _name
from adaptctl.codegen.interface import Field, Interface
from adaptctl.codegen.live_arm import LiveArm, _heaviest, _load
from adaptctl.codegen.wasm_module import WasmModule
from adaptctl.codegen.wasm_package import _words
from adaptctl.compilation import outlined, trace
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.llvm import Piece
from adaptctl.control import ComputedTorque, Sinusoids
from adaptctl.dynamics import load
from adaptctl.scalars import where
from adaptctl.simulation import Plant

LIGHT = ComputedTorque(load("two_link"), np.full(2, 6.0))


@pytest.mark.parametrize(
    ("texts", "shared"),
    [
        ([f"v[{k}]" for k in range(2, 6)], "&v[2]"),
        ([f"next->p[{k}]" for k in range(5)], "&next->p[0]"),
        (["v[2]", "v[3]", "v[4]"], None),
        (["v[2]", "v[3]", "v[4]", "w[5]"], None),
        (["v[2]", "v[3]", "v[5]", "v[6]"], None),
        (["v[5]", "v[4]", "v[3]", "v[2]"], None),
        ([*(f"v[{k}]" for k in range(4)), "x1"], None),
    ],
)
def test_four_numbers_or_more_that_follow_each_other_are_not_copied(texts: list[str], shared: str | None) -> None:
    assert _side_by_side(texts) == shared


def test_as_many_numbers_are_alive_as_were_computed_and_are_still_to_be_used() -> None:
    routine = Interface(LIGHT).law
    own = {x.index: k for k, x in enumerate(routine.body) if x.op not in (Op.INPUT, Op.CALL)}
    last = {y.index: k for k, x in enumerate(routine.body) for y in x.operands if isinstance(y, Expression)}
    results = {x.index for x in routine.outputs if isinstance(x, Expression)} - set(last)
    spans = [(made, last.get(x, len(routine.body))) for x, made in own.items() if x in last or x in results]
    most = max(sum(made <= k <= until for made, until in spans) for k in range(len(routine.body)))
    assert most_alive(routine.body, routine.outputs) == most > 10


def statements(function: Any, **given: str) -> CStatements:
    """Statements of a function of numbers, each with its text."""
    routine, texts = trace(function, dict.fromkeys(given, 1)), list(given.values())
    code = CStatements("a", CNumber("double", {}), Piece(routine.body, {}, {}), {}, lambda part, _k: texts[part])
    for x in routine.body:
        code.compute(x, named=False)
    return code


def test_what_is_used_once_and_is_short_is_written_where_it_is_used() -> None:
    long = {"x": "x" * 43, "y": "y" * 44}  # 90 letters with the sign between them, and one more
    assert statements(lambda x, y: x[0] + y[0], **long).lines == []
    (line,) = statements(lambda x, y: x[0] + y[0], **(long | {"x": "x" * 44})).lines
    assert line.startswith("const a_real x")
    (line,) = statements(lambda x, y: (x[0] + y[0]) * (x[0] + y[0]), x="x", y="y").lines
    assert line.endswith(" = x + y;")
    (line,) = statements(lambda x, y: where(x[0] < y[0], 1.0, where(x[0] < y[0], y[0], 2.0)), x="x", y="y").lines
    assert line.startswith("const int ")


def test_arguments_without_use_are_said_to_be_so() -> None:
    routine, program = trace(lambda x, y: (y[0] * y[0], 3.0), {"x": 1, "y": 1}), CProgram("a", CNumber("double", {}))
    text = program.source(routine, program.on_arrays(routine, "a_f", ["x", "y"])).text
    assert "(void)x;" in text
    assert "(void)y;" not in text
    assert "out1[0] = 3.0;" in text
    bare = trace(lambda x: 3.0, {"x": 1})
    assert "out0[0] = 3.0;" in program.source(bare, program.on_arrays(bare, "a_g", ["x"])).text


def stack(function: Any, kind: Kind = "double") -> int:
    """Bytes that a function of two numbers needs, about."""
    routine, program = trace(function, {"x": 2}), CProgram("a", CNumber(kind, {}))
    return program.source(routine, program.on_arrays(routine, "a_f", ["x"])).stack


def test_a_stack_holds_numbers_and_where_to_return_to_of_all_that_are_called_at_once() -> None:
    inner = outlined(lambda a: (a + 1.0) * (a - 1.0))
    outer = outlined(lambda a: inner(2.0 * a))
    sums = [stack(lambda x: x[0] + x[1], kind) for kind in ("double", "float")]  # type: ignore[arg-type]
    assert 0 < sums[1] < sums[0]
    more = [stack(lambda x: (x[0] + x[1]) * (x[0] - x[1]), kind) for kind in ("double", "float")]  # type: ignore[arg-type]
    assert more[0] - sums[0] == 2 * (more[1] - sums[1]) > 0
    calls = [stack(lambda x, part=part: part(x[0])) for part in (inner, outer)]  # type: ignore[misc]
    assert sums[0] + 8 < calls[0] < calls[1] - 8
    assert stack(lambda x: inner(x[0]) + outer(x[1])) - calls[1] < sums[0]  # one of them at a time


def test_a_function_that_is_called_bears_the_name_of_its_part() -> None:
    def squared(a: Any) -> Any:
        return a * a

    routine, program = trace(lambda x: outlined(squared)(x[0]), {"x": 1}), CProgram("a", CNumber("double", {}))
    assert "static void a_squared_0(" in program.source(routine, program.on_arrays(routine, "a_f", ["x"])).text


@pytest.mark.parametrize(
    ("mechanism", "name"),
    [("7-DOF Arm", "arm_7_dof_arm"), ("int", "int_"), ("Ä", "arm_"), ("a" * 50, "a" * 40), ("UR5e", "ur5e")],
)
def test_code_is_named_for_its_mechanism(mechanism: str, name: str) -> None:
    interface: Any = SimpleNamespace(mechanism=SimpleNamespace(name=mechanism))
    assert _name(interface, None) == name
    assert _name(interface, "b" * 40) == "b" * 40


def test_a_name_ends_no_comment_of_the_code() -> None:
    arm = SimpleNamespace(name="a*/b\n\\ü")
    named: Any = SimpleNamespace(innermost=LIGHT, guarded=False, mechanism=arm, control_period=1e-3)
    assert title(named) == "ComputedTorque for a  b  ü, every 0.001 s"


def test_a_number_of_a_field_has_its_place_and_label() -> None:
    field = Field("gain", np.arange(6.0).reshape(2, 3), ("x", "y", "z"))
    assert field.dimensions == "[2][3]"
    assert [field.place(k) for k in (0, 2, 3)] == ["gain[0][0]", "gain[0][2]", "gain[1][0]"]
    assert [field.label(k) for k in range(6)] == ["x", "y", "z"] * 2


@pytest.mark.parametrize(
    ("name", "size", "labels"),
    [
        ("estimate", 3, ("a", "b", "c")),
        ("inner_q", 3, ()),
        ("torque", 2, ("one", "two")),
        ("q", 4, ("1", "2", "3", "4")),
        ("other", 5, ()),
    ],
)
def test_numbers_bear_names_of_as_many_parameters_joints_or_links(
    name: str, size: int, labels: tuple[str, ...]
) -> None:
    links = SimpleNamespace(links=[None] * 4, description=SimpleNamespace(joint_names=("1", "2", "3", "4")))
    arm: Any = SimpleNamespace(model=SimpleNamespace(names=["a", "b", "c"]), joints=("one", "two"), mechanism=links)
    assert Interface._labels(arm, name, size) == labels
    bare: Any = SimpleNamespace(model=None, joints=("one",), mechanism=None)
    assert Interface._labels(bare, name, size) == ()


def test_a_law_without_a_period_of_its_own_is_exported_for_one_of_a_millisecond() -> None:
    assert Interface(LIGHT).control_period == 1e-3
    assert Interface(LAWS["guarded"]).control_period == LAWS["guarded"].control_period  # type: ignore[attr-defined]


def test_constants_that_any_law_has_bear_no_parameters_name() -> None:
    values = np.array([0.5, -1.0, 2.0, -0.25, 0.25, *np.zeros(len(ARM.inertial_parameters) - 5)])
    interface: Any = SimpleNamespace(innermost=SimpleNamespace(parameters=values), mechanism=ARM)
    named = Interface.names_of_constants(interface)
    assert named == {0.25: ", ".join(ARM.parameter_names[3:5])}


def test_a_module_has_pages_of_64_kb_for_all_its_numbers() -> None:
    module = WasmModule()
    places = module.export("last", trace(lambda x: x[8190], {"x": 8191}))
    machine = Machine(module.binary())
    (at,) = places.outputs
    assert 65536 <= at + 8 <= len(machine.memory) == 2 * 65536
    machine.write(places.inputs[0], np.arange(8191.0))
    machine.call(machine.exports["last"])
    assert machine.read(at, 1) == [8190.0]


def test_the_readme_of_a_module_tells_what_its_reference_is_of() -> None:
    assert _words(Interface(LAWS["gradient"]))["reference"] == "3 numbers"
    in_space = Interface(law_named("tool in the world"))
    assert _words(in_space)["reference"] == f"{in_space.controller.reference_size} numbers, which are not of joints"


def test_a_module_of_a_page_is_as_large_as_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    swing = Sinusoids(np.zeros(2), np.full(2, 0.2), np.ones(2))
    live: Any = shown(LIGHT, LIGHT.mechanism, swing)
    assert live.facts["damping"] == [1.0, 1.0]  # a law without one
    monkeypatch.setattr(live_arm, "MAX_MODULE_BYTES", len(live.binary))
    assert isinstance(shown(LIGHT, LIGHT.mechanism, swing), LiveArm)
    monkeypatch.setattr(live_arm, "MAX_MODULE_BYTES", len(live.binary) - 1)
    assert f"need {round(len(live.binary) / 1000)} kB" in str(shown(LIGHT, LIGHT.mechanism, swing))


def test_payloads_of_a_page_are_of_some_weight_and_of_arms_whose_parameters_are_known() -> None:
    links = [SimpleNamespace(inertia=[mass]) for mass in (-0.02, 0.1)]
    light: Any = SimpleNamespace(mechanism=SimpleNamespace(links=links))
    assert _heaviest(light) == 0.1
    links[0].inertia = [1.5]
    assert _heaviest(light) == 0.4
    assert _load(Plant(ARM, 1e-3), np.asarray(ARM.inertial_parameters)[:-1]) == []


def test_a_build_tells_its_first_two_hundred_letters_and_tcc_gets_no_flags_of_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = tmp_path / "tcc"
    script.write_text('#!/bin/sh\necho "$@" > asked\nprintf "%0300d" 7 >&2; exit 1\n')
    script.chmod(0o755)
    monkeypatch.setattr(builds, "COMPILERS", {"tcc": (str(script),)})
    monkeypatch.setattr(builds, "found_compilers", lambda: {"tcc": "1"})
    assert builds.builds(Exported(tmp_path, "arm", (), {})) == (
        Build("tcc", False, f"does not compile: {'0' * 200}", None, None),
    )
    asked = (tmp_path / "asked").read_text().split()
    assert asked[:4] == ["-std=c99", "arm.c", "test_arm.c", "-lm"]
    script.write_text(
        "#!/bin/sh\nfor out; do :; done\nprintf '#!/bin/sh\\nprintf %%0300d 7\\n' > $out; chmod +x $out\n"
    )
    assert builds.builds(Exported(tmp_path, "arm", (), {}))[0] == Build("tcc", True, "0" * 200, None, None)
