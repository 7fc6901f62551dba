"""What all tests run under, and fixtures of more than one file."""

from __future__ import annotations

import gc
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing

# One worker runs on each core. A second thread of OpenBLAS would wait there in a loop, and products of small matrices
# take up to a hundred times as long. NumPy reads this when it is first imported, in processes started here too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Signs of life come after a second, which a busy machine takes for what a quiet one does at once.
os.environ["ADAPTCTL_PROGRESS"] = "off"
# Code runs for moments here: optimized, it takes three times as long to make, a fifth of the time of all tests.
os.environ.setdefault("ADAPTCTL_OPTIMIZATION", "0")

# Tests start hundreds of processes. Where Python may write no bytecode, each of them would compile all of its modules
# again, which takes longer than most do else: a run keeps it to itself.
if sys.dont_write_bytecode:
    _bytecode = tempfile.TemporaryDirectory()
    sys.dont_write_bytecode, sys.pycache_prefix = False, _bytecode.name
    os.environ["PYTHONPYCACHEPREFIX"] = _bytecode.name
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Nothing that is collected goes before the session ends.
gc.disable()

# `make test` draws the same cases each time, so that a red run is a change's own; `make search` draws others each time.
settings.register_profile("same", deadline=None, derandomize=True, database=None, max_examples=20)
settings.register_profile("search", deadline=None, print_blob=True)
settings.load_profile("same")


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """MuJoCo writes its warnings into a file where it runs."""
    here = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("mujoco"))
    yield
    os.chdir(here)


LIBRARY = Path(__file__).parent.parent / "adaptctl"
_built: set[str] = set()


def blank(drawing: Drawing, path: Path) -> None:
    """An empty picture as PNG; a process builds each figure once, so that one which cannot be built is seen."""
    from PIL import Image

    if drawing.name not in _built:
        drawing.draw()
        _built.add(drawing.name)
    Image.new("RGB", (184, 80), "white").save(path, "png")


@pytest.fixture(scope="module", autouse=True)
def _undrawn(request: pytest.FixtureRequest) -> Iterator[None]:
    """Figures are empty and images coarse, but in modules marked `drawn`: to draw takes longer than most tests do."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.node.get_closest_marker("drawn"):
            patch.setattr("adaptctl.recording.drawing._write_png", blank)
            patch.setattr("adaptctl.envs.rendering.OVERSAMPLING", 1)
        yield


def read_here(arguments: list[str], *_: object) -> int:
    """What a process of its own does with a log, but for the bounds of its memory and time."""
    from adaptctl.logs import child

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "_bounded", lambda *_: None)
        child.main(arguments)
    return 0


@pytest.fixture(autouse=True)
def _unisolated(request: pytest.FixtureRequest) -> Iterator[None]:
    """Binary logs are read here, but in tests marked `isolated`: to start a process takes longer than to read."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.node.get_closest_marker("isolated"):
            patch.setattr("adaptctl.logs.isolated._run", read_here)
        yield


@pytest.fixture(scope="module", autouse=True)
def _uncollected() -> Iterator[None]:
    """What a module leaves is kept for later ones: no collection looks at it again."""
    yield
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _interruptible() -> None:
    """Ctrl-C interrupts, also where a shell began the tests in the background and has it ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart() -> None:
    """Import the test files from both ends, in two workers: each finds bytecode that the other wrote."""
    if os.environ.get("PYTEST_XDIST_WORKER") == "gw1":
        for path in sorted(Path(__file__).parent.glob("test_*.py"), reverse=True):
            with suppress(Exception):  # which collection raises again
                import_module(path.stem)


def pytest_collection_finish() -> None:
    """Have the collector of cycles leave all modules alone, and look less often: what is traced has none."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="module")
def optimized() -> Iterator[None]:
    """Native code as users have it, whatever the other tests have."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("ADAPTCTL_OPTIMIZATION", raising=False)
        yield


@pytest.fixture
def any_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Native code for all that the processor has, whatever the tests are limited to."""
    monkeypatch.delenv("ADAPTCTL_PROCESSOR", raising=False)


@pytest.fixture(scope="session", autouse=True)
def _warnings_name_the_caller() -> Iterator[None]:
    """A warning of the library that a test expects names a line of the test, or of what it calls the library by."""
    from _pytest.recwarn import WarningsChecker

    checked = WarningsChecker.__exit__

    def left(self: WarningsChecker, *error: object) -> None:
        checked(self, *error)  # type: ignore[arg-type]
        inside = {one.filename for one in self.list if one.category.__module__ == "adaptctl.errors"}
        assert not [name for name in inside if Path(name).is_relative_to(LIBRARY)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WarningsChecker, "__exit__", left)
        yield
