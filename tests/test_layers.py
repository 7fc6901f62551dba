"""The house is kept: imports run one way, nothing heavy is imported in passing, no file grows without end."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from runpy import run_path

import adaptctl
from adaptctl.optional_packages import homes

ROOT = Path(adaptctl.__file__).parent
HOME = Path(__file__).parent.parent
ORDER = (
    "version",
    "renamed",
    "errors",
    "optional_packages",
    "caching",
    "content_words",
    "files",
    "folders",
    "arrays",
    "markup",
    "stages",
    "scalars",
    "compilation",
    "description",
    "dynamics",
    "identifiability",
    "control",
    "simulation",
    "recording",
    "logs",
    "identification",
    "tuning",
    "design",
    "codegen",
    "hardware",
    "envs",
    "experiments",
    "sweeps",
    "contest",
    "cli",
    "__main__",
)
"""A folder uses only those before it."""
LONGEST = 400
"""Lines of a file, without those of its docstrings."""
ABOUT = {
    "pinocchio": {"description.readers.pinocchio_model"},
    "matplotlib": {"envs.rendering", "experiments.replication"},
    "rerun": {"recording"},
    "pyarrow": {
        "recording.run_table",
        "recording.finished_trace",
        "recording.lerobot_set",
        "sweeps.folder",
        "sweeps.report",
    },
    "gymnasium": {"envs"},
    "rich": set(),
    "control": set(),
}
"""Heavy packages, and the modules or folders that are about them; elsewhere they are imported when used."""


def modules() -> dict[str, Path]:
    """Every module below the package by its name without ``adaptctl.``; two of the folders are links."""
    found = {}
    for layer in ORDER:
        place = ROOT / layer
        for path in sorted(place.glob("**/*.py")) if place.is_dir() else [place.with_suffix(".py")]:
            parts = (layer, *path.relative_to(place).with_suffix("").parts) if place.is_dir() else (layer,)
            found[".".join(part for part in parts if part != "__init__")] = path
    return found


MODULES = modules()


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file, read once for all rules."""
    return ast.parse(path.read_text())


LOOKED_AT = (ast.Import, ast.ImportFrom, ast.Expr, ast.Call, ast.Assert, ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def nodes(path: Path) -> list[ast.AST]:
    """What any rule looks at in a file, found once for all of them."""
    return [node for node in ast.walk(parsed(path)) if isinstance(node, LOOKED_AT)]


def imported(some: Iterable[ast.AST]) -> Iterator[str]:
    """Absolute names of what is imported by some nodes."""
    for node in some:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def at_import(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements that run when a module is imported, those for type checkers left out."""
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node
        if isinstance(node, ast.ClassDef):
            yield from at_import(node.body)


def test_everything_is_found() -> None:
    folders = {path.stem for path in ROOT.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert folders - {"__init__", "__pycache__"} == set(ORDER) == {name.partition(".")[0] for name in MODULES}
    assert len(MODULES) > 60


def test_imports_run_one_way() -> None:
    places = {f"adaptctl.{layer}": place for place, layer in enumerate(ORDER)}
    assert [
        f"{module} imports {name}"
        for module, path in MODULES.items()
        for name in imported(nodes(path))
        if places.get(".".join(name.split(".")[:2]), 0) > ORDER.index(module.partition(".")[0])
    ] == []


def test_no_modules_import_each_other() -> None:
    """Late imports and those for type checkers counted; a package's own names stand for the modules they are in."""
    graph = {module: set(needed(module)) - {module} for module in MODULES}
    while ends := [m for m in graph if not graph[m] & set(graph) or not any(m in others for others in graph.values())]:
        for module in ends:
            del graph[module]
    assert not graph, f"circles, and what is between them: {', '.join(sorted(graph))}"


def needed(module: str) -> Iterator[str]:
    """The modules of this package that a module imports, without ``adaptctl.``."""
    for name in imported(nodes(MODULES[module])):
        package, _, own = name.removeprefix("adaptctl.").rpartition(".")
        if name.startswith("adaptctl.") and f"{package}.{own}".lstrip(".") in MODULES:
            yield f"{package}.{own}".lstrip(".")
        elif package in MODULES and MODULES[package].stem != "__init__":
            yield package
        elif package in MODULES:
            yield home_of(package, own)


def home_of(package: str, name: str) -> str:
    """The module that a package's name is imported from."""
    stub = MODULES[package].with_suffix(".pyi")
    if stub.exists():
        whole = homes(stub)[name].removeprefix("adaptctl.")
        return whole if MODULES[whole].stem != "__init__" else home_of(whole, name)
    for node in parsed(MODULES[package]).body:
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            whole = str(node.module).removeprefix("adaptctl.")
            return whole if MODULES[whole].stem != "__init__" else home_of(whole, name)
    return package


def is_about(module: str, package: str) -> bool:
    """True unless the package is heavy and the module is not about it."""
    homes = ABOUT.get(package)
    return homes is None or any(module == home or module.startswith(f"{home}.") for home in homes)


def test_nothing_heavy_is_imported_in_passing() -> None:
    assert [
        f"{module} imports {name}"
        for module, path in MODULES.items()
        for node in at_import(parsed(path).body)
        for name in imported([node])
        if not is_about(module, name.partition(".")[0])
    ] == []


def test_slow_parts_of_scipy_are_imported_at_use() -> None:
    """They take longer to load than many a command that never needs them."""
    slow = ("scipy.optimize", "scipy.stats", "scipy.interpolate")
    assert [
        f"{module} imports {name}"
        for module, path in MODULES.items()
        for node in at_import(parsed(path).body)
        for name in imported([node])
        if name.startswith(slow) and not module.startswith("experiments.replication")
    ] == []


def documented(path: Path) -> int:
    """Lines of a module that are docstrings."""
    texts = (node.value for node in nodes(path) if isinstance(node, ast.Expr))
    texts = (text for text in texts if isinstance(text, ast.Constant) and isinstance(text.value, str))
    return sum((text.end_lineno or 0) - text.lineno + 1 for text in texts)


def test_no_file_is_too_long_and_each_says_what_it_is() -> None:
    lines = {module: len(path.read_text().splitlines()) - documented(path) for module, path in MODULES.items()}
    assert [module for module, count in lines.items() if count > LONGEST] == []
    trees = {module: parsed(path) for module, path in MODULES.items()}
    assert [module for module, tree in trees.items() if tree.body and not ast.get_docstring(tree)] == []


def test_nothing_is_pickled_or_evaluated_and_no_assertion_handles_errors() -> None:
    forbidden = {"pickle", "marshal", "shelve", "dill", "cloudpickle"}
    for module, path in MODULES.items():
        assert not forbidden & {name.partition(".")[0] for name in imported(nodes(path))}, module
        for node in nodes(path):
            called = node.func if isinstance(node, ast.Call) else None
            assert not (isinstance(called, ast.Name) and called.id in ("eval", "exec")), module
            assert not isinstance(node, ast.Assert), module


SOURCES = {**MODULES, **{f"benchmarks.{path.stem}": path for path in (ROOT.parent / "benchmarks").glob("*.py")}}


def test_a_class_name_has_one_meaning() -> None:
    places: dict[str, list[str]] = {}
    for module, path in SOURCES.items():
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(module)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_nothing_is_written_twice() -> None:
    """No two functions have the same lines, names of arguments and all, but those of a line or so."""
    bodies: dict[str, list[str]] = {}
    for module, path in SOURCES.items():
        lines = [line.strip() for line in path.read_text().splitlines()]
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                own = lines[body[0].lineno - 1 : body[-1].end_lineno] if body else []
                bodies.setdefault("\n".join(own), []).append(f"{module}.{node.name}")
    assert [where for body, where in bodies.items() if len(where) > 1 and len(body) > 60] == []


def test_the_picture_is_what_imports_say() -> None:
    """`make architecture` draws it anew."""
    made = run_path(str(HOME / "docs" / "extensions" / "architecture.py"))["picture"]()
    assert made == (HOME / "docs" / "images" / "architecture.svg").read_text()
