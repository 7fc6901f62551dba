"""Exported controllers: the C text does what Python does, is the same each time, and is refused where it must be."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from c_evaluation import functions_of
from every_law import ARM, GAIN, LAWS, MODEL, REDUCED, TRUE, law_named, slotine_li
from export_builds import Package
from nightly import at_night, mostly_at_night

import adaptctl
from adaptctl import control
from adaptctl.arrays import Array
from adaptctl.cli.main import main
from adaptctl.codegen.c_function import CNumber
from adaptctl.codegen.c_package import CPackage
from adaptctl.codegen.closed_loop_check import default_reference, record
from adaptctl.codegen.exporting import Exported
from adaptctl.codegen.interface import Interface
from adaptctl.control import AdaptationLaw, ComputedTorque, Controller, ReferencePoint, SafetyFilter, SlotineLi
from adaptctl.control.pytree import leaves
from adaptctl.dynamics.loops.single_precision import validate_single_precision
from adaptctl.errors import FileError, InputError

ALL = [*LAWS, *REDUCED]
LONG = ("forgetting", "composite learning", "drives", "loop composite", "loop tool", "loop computed torque")
"""Laws whose text is as long as another's: the floor's, the loop's"""
FILES = {"a.h", "a.c", "a.hpp", "CMakeLists.txt", "test_a.c", "vectors.h", "example.c", "README.md", "manifest.json"}


def exported(tmp_path: Path, law: Controller[Any], **more: Any) -> Exported:
    return adaptctl.export(law, tmp_path / "out", name="a", **{"without_safety_filter": True, **more})


def lists(fields: Any, values: list[Array]) -> SimpleNamespace:
    return SimpleNamespace(**{field.name: value.tolist() for field, value in zip(fields, values, strict=True)})


def test_every_law_that_is_offered_is_among_those_exported_here() -> None:
    kinds = [getattr(control, name) for name in control.__all__]
    offered = {kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Controller | AdaptationLaw)}
    found: set[type] = set()
    for law in map(law_named, ALL):
        innermost: Any = Interface(law).innermost
        adaptation = getattr(innermost, "adaptation_law", None)
        found |= {type(law), type(innermost), type(adaptation), type(getattr(adaptation, "inner", None))}
    missing = {kind.__name__ for kind in offered - found - {Controller, control.AdaptiveController, AdaptationLaw}}
    assert not missing, f"add an example of {sorted(missing)} to LAWS in tests/every_law.py"


@pytest.mark.parametrize("name", mostly_at_night(ALL, *[name for name in ALL if name not in LONG][::4]))
def test_the_text_of_the_law_does_what_python_does(name: str) -> None:
    interface = Interface(law_named(name))
    rows, _ = record(interface, default_reference(interface), ticks=4)
    validate_alike(interface, [(row.p, row.v, row.reference) for row in rows])


@pytest.mark.parametrize("name", ["guarded", at_night("guarded lift"), "guarded loop"])
def test_a_law_that_is_stopped_has_its_memory_put_back(name: str) -> None:
    interface = Interface(law_named(name))
    rows, _ = record(interface, default_reference(interface), ticks=4)
    ticks = [(row.p, row.v + (100.0 if k == 2 else 0.0), row.reference) for k, row in enumerate(rows)]
    final = validate_alike(interface, ticks)
    assert final.flags.stopped == 1.0
    text = CPackage(interface, "a", "double").functions
    assert re.search(r"memcpy\(&next->estimate\[0\], &memory->estimate\[0\], \d+u \* sizeof\(a_real\)\);", text)
    assert not re.search(r"\? memory->estimate", text)


def validate_alike(interface: Interface, ticks: list[tuple[Array, Array, ReferencePoint]]) -> Any:
    """Require the text of a law to do what Python does with ticks of p, v and reference; Python's state after them."""
    package = CPackage(interface, "a", "double")
    law = functions_of(package.functions, "a")["a_law"]
    written = re.findall(r"^ +((?:next->\w+|torque)\S*) = ", package.functions, re.MULTILINE)
    assert len(written) == len(set(written)), "a result is written once"
    state = interface.controller.init(ticks[0][0], np.zeros(interface.controller.dof))
    gains = lists(interface.all_gains, [field.values for field in interface.all_gains])
    for p, v, point in ticks:
        blank = lists(interface.memory, [np.full_like(field.values, np.nan) for field in interface.memory])
        reference = SimpleNamespace(**{part: getattr(point, part).tolist() for part in "pva"})
        torque = [np.nan] * interface.controller.dof
        law(lists(interface.memory, leaves(state)), gains, p.tolist(), v.tolist(), reference, blank, torque)
        expected, state = interface.controller.step(state, p, v, point)
        pairs = [
            (torque, expected),
            *((getattr(blank, f.name), x) for f, x in zip(interface.memory, leaves(state), strict=True)),
        ]
        for made, wanted in pairs:
            scale = max(1.0, float(np.abs(wanted).max(initial=0.0)))
            np.testing.assert_allclose(made, wanted, rtol=0, atol=1e-10 * scale)
    return state


@pytest.mark.parametrize("name", ["composite", "loop", at_night("loop composite"), at_night("loop tool")])
def test_the_text_of_init_begins_where_python_does(name: str) -> None:
    """The loops are walked to their first position here as the C code walks them."""
    interface = Interface(law_named(name))
    law, package = interface.controller, CPackage(Interface(law_named(name)), "a", "double")
    functions, start = functions_of(package.functions, "a"), package.start
    p = law.neutral_configuration + np.linspace(-0.2, 0.3, law.dof)
    q = p.tolist()
    if start.walk is not None:
        q, home = start.walk.home.tolist(), law.neutral_configuration
        for k in range(1, 9):
            after, regular = [np.nan] * len(q), [np.nan]
            functions["a_closed"]((home + (p - home) * (k / 8)).tolist(), q, after)
            functions["a_regular"](after, regular)
            assert regular == [1.0]
            q = after
        functions["a_regular"]([x + 0.1 for x in q], regular)
        assert regular == [0.0]
    state = leaves(law.init(p, np.zeros(law.dof)))
    computed = [[np.nan] * interface.memory[k].size for k in start.computed]
    if start.more is not None:
        functions["a_started"](q, *computed)
    for k, (field, expected) in enumerate(zip(interface.memory, state, strict=True)):
        made: Any = field.values
        made = q if k in start.configurations else computed[start.computed.index(k)] if k in start.computed else made
        np.testing.assert_allclose(made, expected, rtol=0, atol=1e-10, err_msg=field.name)


@pytest.mark.parametrize("name", ["gradient", "guarded", "computed torque", "guarded loop"])
def test_a_package_is_whole_and_says_what_it_is(name: str, tmp_path: Path) -> None:
    law = law_named(name)
    done = exported(tmp_path, law)
    assert {path.name for path in done.directory.iterdir()} == FILES == set(done.files)
    manifest = json.loads((done.directory / "manifest.json").read_text())
    assert manifest == done.manifest
    for file, digest in manifest["files"].items():
        assert hashlib.sha256((done.directory / file).read_bytes()).hexdigest() == digest
    mechanism: Any = Interface(law).mechanism
    assert manifest["mechanism"] == {"name": mechanism.name, "sha256": mechanism.description.sha256}
    assert law.kernel is not None
    assert manifest["flops"] == law.kernel.operations.flops
    assert manifest["guarded"] is isinstance(law, SafetyFilter)
    assert re.fullmatch("[0-9A-F]{16}", manifest["abi_hash"])
    readme = (done.directory / "README.md").read_text()
    header = (done.directory / "a.h").read_text()
    for joint in mechanism.primary_joints:
        assert joint.name in readme
        assert joint.name in header
    assert ("has no safety limits" in readme) is not isinstance(law, SafetyFilter)
    assert ("`A_TORQUE_LIMITED`, `A_RATE_LIMITED`" in readme) is isinstance(law, SafetyFilter)
    assert re.search("engage a brake, at `A_NOT_FINITE`.*(?<!LIMITED)`\\.", readme)
    assert ("`a_set_estimate` after it" in readme) is (Interface(law).estimate is not None)
    for text in (path.read_text() for path in done.directory.iterdir()):
        assert "{{" not in text
        assert "{%" not in text
        assert text.endswith("\n")


def test_the_code_says_what_numbers_are() -> None:
    law = slotine_li(GAIN)
    package = CPackage(Interface(law), "a", "double")
    source, header = package.filled("controller.c"), package.filled("controller.h")
    assert f"{(0.9 * TRUE[0]).hex()} /* {MODEL.names[0]} */" in source  # the first estimate
    assert f"{GAIN[1].hex()} /* {MODEL.names[1]} */" in source
    for name in MODEL.names:
        assert f" {name}\n" in header
    known = CPackage(Interface(ComputedTorque(ARM, np.full(3, 6.0))), "a", "double").functions
    assert sum(f"/* {name}" in known or f", {name}" in known for name in ARM.parameter_names) > 20


def test_nothing_but_math_and_mem_is_called_and_nothing_is_global(tmp_path: Path) -> None:
    done = exported(tmp_path, LAWS["guarded"])
    source = re.sub(r"/\*.*?\*/", "", (done.directory / "a.c").read_text(), flags=re.DOTALL)
    allowed = {
        "if",
        "for",
        "return",
        "sizeof",
        "fabs",
        "sqrt",
        "rint",
        "memcpy",
        "defined",
        "UINT64_C",
        "__attribute__",
        "optimize",
    }
    assert {name for name in re.findall(r"\b(\w+)\(", source) if not name.startswith("a_")} <= allowed
    outside = [line for line in source.splitlines() if re.match(r"(static|extern|const|double|int)\b", line)]
    functions_and_constants = r"(static (void|int|a_real) a_\w+\(|static const |const a_gains )"
    assert all(re.match(functions_and_constants, line) for line in outside)
    assert all(name.startswith("a_") for name in re.findall(r"^(?:unsigned|void|static \w+) (\w+)\(", source, re.M))


def test_the_same_controller_gives_the_same_bytes(tmp_path: Path) -> None:
    first = adaptctl.export(LAWS["composite"], tmp_path / "one", name="a", without_safety_filter=True)
    again = slotine_li(LAWS["composite"].adaptation)  # type: ignore[attr-defined]
    second = adaptctl.export(again, tmp_path / "two", name="a", without_safety_filter=True)
    assert first.manifest == second.manifest
    for file in first.files:
        assert (first.directory / file).read_bytes() == (second.directory / file).read_bytes()


def test_gains_are_arguments_of_the_code_and_change_nothing_else(tmp_path: Path) -> None:
    one = CPackage(Interface(slotine_li(GAIN)), "a", "double")
    two = CPackage(Interface(slotine_li(2.0 * GAIN)), "a", "double")
    assert one.functions == two.functions
    assert one.hash == two.hash
    assert {field.name for field in one.interface.gains} == {"bandwidth", "damping", "adaptation_gain"}


def test_careless_arithmetic_is_refused_by_the_compilers_that_are_here(tmp_path: Path) -> None:
    done = exported(tmp_path, LAWS["guarded"])
    for macro in ("__FAST_MATH__", "__FINITE_MATH_ONLY__", "__ASSOCIATIVE_MATH__", "FLT_EVAL_METHOD != 0"):
        assert macro in (done.directory / "a.c").read_text()
    assert list(Package(done.directory, "a", 3).accepted()) == []


def test_vectors_are_what_python_made(tmp_path: Path) -> None:
    done = exported(tmp_path, LAWS["guarded"])
    text = (done.directory / "vectors.h").read_text()
    interface = Interface(LAWS["guarded"])
    rows, _ = record(interface, default_reference(interface))
    assert "#define VECTORS 100\n" in text
    numbers = CNumber("double", {})
    for row in rows[::9]:
        assert ", ".join(map(numbers.constant, row.torque.tolist())) + " }, " + f"{row.status}u" in text
    assert {row.status for row in rows} != {0}  # the torque limits were met


def test_single_precision_keeps_what_is_finite_finite() -> None:
    number = CNumber("float", {})
    assert (number.precision, CNumber("double", {}).precision) == ("single", "double")
    assert float.fromhex(number.constant(1e-300).rstrip("f")) > 0.0
    assert float(number.constant(1.7e308).rstrip("f")) == float(np.finfo(np.float32).max)
    assert number.constant(0.1) == f"{float(np.float32(0.1)).hex()}f"
    assert number.constant(-3.0) == "(-3.0f)"
    assert number.constant(np.inf) == "HUGE_VALF"
    assert CNumber("double", {}).constant(0.1) == (0.1).hex()


@pytest.mark.parametrize("name", ["gradient", "guarded", "loop"])
def test_single_precision_has_no_number_of_double(name: str) -> None:
    package = CPackage(Interface(law_named(name)), "a", "float")
    text = re.sub(r"/\*.*?\*/", "", package.filled("controller.c"), flags=re.DOTALL)
    assert not re.findall(r"\d\.\d*(?:e[-+]?\d+)?(?![\w.])|p[-+]\d+(?![\df])", text)
    assert "typedef float a_real;" in package.filled("controller.h")
    assert not re.findall(r"\b(?:fabs|sqrt|rint)\(", text)


def test_rules_of_gains_are_the_laws_own() -> None:
    rules = {rule.field.name: rule for rule in CPackage(Interface(LAWS["guarded"]), "a", "double").rules}
    assert rules["damping"].positive
    assert rules["adaptation_gain"].positive
    assert rules["damping"].most is not None
    most, damping = rules["damping"].most, rules["damping"].field.values
    assert np.all(most >= damping)
    with pytest.raises(InputError, match="too stiff"):
        LAWS["guarded"].inner.tuned({"damping": 1.5 * most})  # type: ignore[attr-defined]
    LAWS["guarded"].inner.tuned({"damping": most})  # type: ignore[attr-defined]
    assert rules["estimate_bounds"].bounds
    assert not rules["stop_damping"].positive
    assert not rules["stop_damping"].signed


# Refusals


@pytest.mark.parametrize(
    "name", ["", "2arm", "my arm", "arm-1", "int", "class", "ärm", "_arm", "a" * 41, "a\n", "a;b", 3, "a/b"]
)
def test_a_name_that_is_no_identifier_is_refused(name: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name: expected a C identifier"):
        adaptctl.export(LAWS["guarded"], tmp_path / "out", name=name)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"without_safety_filter": False}, "SlotineLi has no safety limits; wrap it in `SafetyFilter`"),
        ({"scalar": "half"}, "scalar: expected double or float, got 'half'"),
        ({"language": "rust"}, "language: expected c or wasm, got 'rust'"),
    ],
)
def test_wrong_choices_are_refused(more: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        exported(tmp_path, LAWS["gradient"], **more)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_or_file_that_exists_is_refused(tmp_path: Path) -> None:
    done = exported(tmp_path, LAWS["gradient"])
    before = {path.name: path.read_bytes() for path in done.directory.iterdir()}
    with pytest.raises(FileError, match="already exists"):
        exported(tmp_path, LAWS["gradient"])
    assert before == {path.name: path.read_bytes() for path in done.directory.iterdir()}
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FileError, match="already exists"):
        adaptctl.export(LAWS["guarded"], tmp_path / "file")
    with pytest.raises(FileError, match="file"):
        adaptctl.export(LAWS["guarded"], tmp_path / "file" / "below")


def test_what_is_no_controller_or_steps_otherwise_is_refused(tmp_path: Path) -> None:
    class Stepping(SlotineLi):
        def step(self, *given: Any) -> Any:
            return super().step(*given)

    with pytest.raises(InputError, match="expected a Controller, got int"):
        adaptctl.export(3, tmp_path / "out")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Stepping has a custom step"):
        exported(tmp_path, Stepping(MODEL, 6.0, [3.0, 4.0, 2.0]))  # type: ignore[arg-type]


def test_much_stack_is_refused_unless_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"about 2\d kB of stack, above the limit of 16 kB"):
        exported(tmp_path, LAWS["forgetting"])
    told = exported(tmp_path, LAWS["forgetting"], large_stack=True).manifest["stack_bytes_about"]
    assert told > 16384
    assert told % 8 == 0  # whole numbers of double precision


def test_loops_that_single_precision_cannot_close_are_refused(tmp_path: Path) -> None:
    loop: Any = law_named("loop")
    validate_single_precision(loop.model.mechanism, "scalar")
    far = adaptctl.load(write_scaled(tmp_path, 1e4))
    with pytest.raises(InputError, match=r"stay open by .* use double"):
        adaptctl.export(
            ComputedTorque(far, np.full(3, 8.0)), tmp_path / "out", scalar="float", without_safety_filter=True
        )


def write_scaled(tmp_path: Path, scale: float) -> Path:
    """The semi-direct-drive arm, so many times as large."""
    text = (Path(adaptctl.__file__).parent / "description" / "robots" / "semi_direct_drive.toml").read_text()
    lengths = re.compile(r"\b(position) = (\[.*?\])")
    path = tmp_path / "far.toml"
    path.write_text(lengths.sub(lambda m: f"{m[1]} = {[scale * x for x in json.loads(m[2])]}", text))
    return path


# The command


def test_the_command_writes_a_package_and_prints_its_manifest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = "two_link"
    assert main(["export", robot, "--out", str(tmp_path / "arm"), "--scalar", "float", "--json"]) == 0
    manifest = json.loads(capsys.readouterr().out)
    assert manifest == json.loads((tmp_path / "arm" / "manifest.json").read_text())
    assert manifest["guarded"] is True
    assert manifest["scalar"] == "float"
    assert main(["export", robot, "--out", str(tmp_path / "arm")]) == 2
    assert "already exists" in capsys.readouterr().err
    assert main(["export", robot, "--law", "lqr", "--out", str(tmp_path / "other")]) == 2
    assert "unknown law 'lqr'; laws: slotine-li, " in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_what_a_user_writes_is_exported_too(tmp_path: Path) -> None:
    class Stiff(ComputedTorque):
        def law(self, p: Any, v: Any, reference: ReferencePoint, memory: Any) -> Any:
            torque, after = super().law(p, v, reference, memory)
            return 1.5 * torque, after

    law = Stiff(ARM, np.full(3, 6.0))
    done = exported(tmp_path, law)
    assert done.manifest["law"] == "Stiff"
    assert done.manifest["gains"] == {}  # a class that names none has all its numbers compiled in
