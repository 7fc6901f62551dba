"""WebAssembly: modules run on a machine of our own that follows the specification, and do what Python does."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from every_law import LAWS, guarded, law_named, slotine_li
from hypothesis import given, settings
from hypothesis import strategies as st
from wasm_machine import Machine

import adaptctl
from adaptctl.codegen.closed_loop_check import default_reference, record
from adaptctl.codegen.interface import Interface, status_bits
from adaptctl.codegen.wasm_module import WasmModule, WasmPlaces, unsigned
from adaptctl.codegen.wasm_package import wasm_files
from adaptctl.compilation import outlined, trace
from adaptctl.compilation.sine import DOUBLE
from adaptctl.control.pytree import leaves
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, cos, maximum, minimum, sin, sqrt, where


def ready(function: Any, arguments: dict[str, int]) -> tuple[Machine, WasmPlaces]:
    module = WasmModule()
    places = module.export("run", trace(function, arguments))
    return Machine(module.binary()), places


@given(x=st.floats(-DOUBLE.farthest, DOUBLE.farthest))
@settings(max_examples=80, deadline=None)
def test_sines_are_within_two_ulp(x: float) -> None:
    machine, places = ready(lambda x: (sin(x[0]), cos(x[0])), {"x": 1})
    machine.write(places.inputs[0], [x])
    machine.call(machine.exports["run"])
    made = [machine.read(at, 1)[0] for at in places.outputs]
    for value, exact in zip(made, (math.sin(x), math.cos(x)), strict=True):
        assert abs(value - exact) <= 2.0 * math.ulp(exact)


@pytest.mark.parametrize("x", [2.0 * DOUBLE.farthest, -1e300, math.inf, math.nan])
def test_angles_too_far_to_turn_are_nan(x: float) -> None:
    machine, places = ready(lambda x: (sin(x[0]), cos(x[0])), {"x": 1})
    machine.write(places.inputs[0], [x])
    machine.call(machine.exports["run"])
    assert all(math.isnan(machine.read(at, 1)[0]) for at in places.outputs)


@outlined
def share(x: Any, y: Any) -> Any:
    return x / (1.0 + absolute(y))


def everything(x: Column, y: Column) -> tuple[Any, ...]:
    a, b = x[0], y[0]
    inner = share(a, b) + share(b, a) * share(a + b, 2.0)
    chosen = where(a < b, sqrt(absolute(a)), -b) + where(a <= b, minimum(a, b), maximum(a, b))
    return inner, chosen, Column((a - b, 3.0, a * b)), inner * chosen


@given(a=st.floats(-1e3, 1e3), b=st.floats(-1e3, 1e3))
@settings(max_examples=50, deadline=None)
def test_every_operation_and_calls_do_what_floats_do(a: float, b: float) -> None:
    machine, places = ready(everything, {"x": 1, "y": 1})
    machine.write(places.inputs[0], [a])
    machine.write(places.inputs[1], [b])
    machine.call(machine.exports["run"])
    expected = everything(Column((a,)), Column((b,)))
    for at, value in zip(places.outputs, expected, strict=True):
        wanted = list(value) if isinstance(value, Column) else [value]
        assert machine.read(at, len(wanted)) == pytest.approx(wanted, rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("name", ["gradient", "composite", "natural", "tool", "guarded", "computed torque", "loop"])
def test_laws_do_what_python_does(name: str) -> None:
    """At the places that the script is told of."""
    interface = Interface(law_named(name))
    law = interface.controller
    files, _ = wasm_files(interface, "arm", "double")
    facts, machine = facts_of(str(files["arm.js"])), Machine(bytes(files["arm.wasm"]))  # type: ignore[arg-type]
    rows, _ = record(interface, default_reference(interface), ticks=3)
    state = law.init(rows[0].p, np.zeros(law.dof))
    assert [len(values) for values in facts["start"]] == facts["sizes"] == [len(leaf) for leaf in leaves(state)]
    for at, values in zip(facts["gains"], [facts["gain"]] if facts["gain"] else [], strict=True):
        machine.write(8 * at, values)
    for row in rows:
        given = zip(facts["given"], (row.p, row.v, *row.reference), strict=True)
        for at, values in (*given, *zip(facts["memory"], leaves(state), strict=True)):
            machine.write(8 * at, list(values))
        machine.call(machine.exports["law"])
        torque, state = law.step(state, row.p, row.v, row.reference)
        for at, wanted in zip((facts["torque"], *facts["next"]), (torque, *leaves(state)), strict=True):
            scale = max(1.0, float(np.abs(wanted).max(initial=0.0)))
            np.testing.assert_allclose(machine.read(8 * at, len(wanted)), wanted, rtol=0, atol=1e-10 * scale)
    assert (facts["walk"] is not None) == (name == "loop")
    for walked in filter(None, [facts["walk"]]):
        ((p, q), (closed,)), ((asked,), (told,)) = facts["places"]["closed"], facts["places"]["regular"]
        for at, values in ((p, law.neutral_configuration), (q, walked["home"]), (asked, walked["home"])):
            machine.write(8 * at, list(values))
        for what in ("closed", "regular"):
            machine.call(machine.exports[what])
        assert machine.read(8 * closed, len(walked["home"])) == pytest.approx(walked["home"], abs=1e-9)
        assert machine.read(8 * told, 1) == [1.0]


def facts_of(script: str) -> Any:
    """What the script of a package is told of its module."""
    return json.loads(script.split("const facts = ", 1)[1].split(";\n", 1)[0])


def test_a_package_holds_the_module_twice_and_is_the_same_each_time(tmp_path: Path) -> None:
    law = LAWS["guarded"]
    first = adaptctl.export(law, tmp_path / "one", name="arm", language="wasm")
    second = adaptctl.export(law, tmp_path / "two", name="arm", language="wasm")
    assert set(first.files) == {"arm.wasm", "arm.js", "README.md", "manifest.json"}
    for file in first.files:
        assert (first.directory / file).read_bytes() == (second.directory / file).read_bytes()
    binary = (first.directory / "arm.wasm").read_bytes()
    assert first.manifest["wasm_bytes"] == len(binary) < 60_000
    assert set(Machine(binary).exports) == {"law"}
    script = (first.directory / "arm.js").read_text()
    assert "http" not in script
    facts = facts_of(script)
    assert facts["joints"] == law.dof
    assert facts["gain"][: law.dof] == [50.0] * law.dof


def test_the_brake_keeps_to_the_torque_limits(tmp_path: Path) -> None:
    law = guarded(slotine_li(), torque=40.0, stop_damping=[2.0, 3.0, 4.0])
    done = adaptctl.export(law, tmp_path / "out", name="arm", language="wasm")
    facts = facts_of((done.directory / "arm.js").read_text())
    interface = Interface(law)
    flags = [(interface.memory[k].name.removeprefix("flags_"), value) for k, value in facts["flags"]]
    own = status_bits(interface)[-len(interface.flags) :]
    assert flags == [(name, bit.value) for name, bit in zip(interface.flags, own, strict=True)]
    assert facts["limit"] == [40.0] * 3
    assert facts["brake"] == [2.0, 3.0, 4.0]


def test_the_readme_tells_joints_status_and_parameters(tmp_path: Path) -> None:
    law = LAWS["guarded"]
    told = (adaptctl.export(law, tmp_path / "out", name="arm", language="wasm").directory / "README.md").read_text()
    interface = Interface(law)
    assert ", ".join(interface.joints) in told.replace("\n", " ")
    for bit in status_bits(interface):
        assert f"| {bit.value} | {bit.meaning} |" in told
    names = law.inner.model.names
    for name, value in zip(names, law.init(np.zeros(3), np.zeros(3)).inner.estimate, strict=True):
        assert re.search(rf"\| {re.escape(name)} \| {value:.6g} \|", told)


def test_single_precision_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="scalar: WebAssembly supports only double"):
        adaptctl.export(LAWS["guarded"], tmp_path / "out", language="wasm", scalar="float")
    assert not (tmp_path / "out").exists()


@given(n=st.integers(0, 2**40))
def test_leb128_is_read_as_it_was_written(n: int) -> None:
    from wasm_machine import unsigned as read

    assert read(unsigned(n), 0) == (n, len(unsigned(n)))


@pytest.mark.parametrize("n", [-1, -(2**40)])
def test_leb128_of_unsigned_numbers_has_no_negative_ones(n: int) -> None:
    with pytest.raises(InputError, match=f"expected a whole number of at least 0, got {n}"):
        unsigned(n)
