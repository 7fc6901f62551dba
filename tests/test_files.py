"""Files: whole or not at all, strict, and with errors that name the file, the element and the remedy."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from bad_files import pipe
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.errors import FileError
from adaptctl.files import (
    MAX_BYTES,
    read_bytes,
    read_json,
    read_text,
    read_toml,
    real_place,
    replacing,
    validate_place,
    write_bytes,
    write_json,
    write_text,
)


class Part(msgspec.Struct, forbid_unknown_fields=True):
    mass: float
    kind: Literal["rod", "plate"] = "rod"


class Whole(msgspec.Struct, forbid_unknown_fields=True):
    parts: list[Part] = []
    extra: Part | None = None
    name: str = ""


def content(folder: Path) -> dict[str, bytes]:
    return {entry.name: entry.read_bytes() for entry in folder.iterdir()}


def test_written_text_and_bytes_come_back(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "θ = 1\n")
    write_bytes(tmp_path / "b.bin", b"\x00\xff")
    assert read_text(tmp_path / "a.txt") == "θ = 1\n"
    assert read_bytes(tmp_path / "b.bin") == b"\x00\xff"
    assert set(content(tmp_path)) == {"a.txt", "b.bin"}


def test_the_place_beside_keeps_the_suffix_and_the_folder(tmp_path: Path) -> None:
    with replacing(tmp_path / "figure.png") as beside:
        assert beside.suffix == ".png"
        assert beside.parent == tmp_path
        beside.write_bytes(b"1")
    assert content(tmp_path) == {"figure.png": b"1"}


def write_half(path: Path, failure: type[BaseException]) -> None:
    with replacing(path) as beside:
        beside.write_text("half")
        raise failure


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, failure: type[BaseException]) -> None:
    write_text(tmp_path / "a.txt", "old")
    with pytest.raises(failure):
        write_half(tmp_path / "a.txt", failure)
    assert content(tmp_path) == {"a.txt": b"old"}


def test_a_file_is_replaced_through_a_symbolic_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "real" / "a.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert content(tmp_path / "real") == {"a.txt": b"new"}


def test_a_link_that_leads_out_of_its_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "theirs.txt").write_text("old")
    (tmp_path / "mine" / "a.txt").symlink_to(tmp_path / "theirs.txt")
    (tmp_path / "mine" / "new.txt").symlink_to(tmp_path / "nowhere.txt")
    for name in ("a.txt", "new.txt"):
        with pytest.raises(FileError, match=rf"{name}: is a link to .*, outside its folder; give that path itself"):
            write_text(tmp_path / "mine" / name, "new")
    assert set(content_names(tmp_path)) == {"mine", "theirs.txt"}
    assert (tmp_path / "theirs.txt").read_text() == "old"


def sockets(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.bind(str(path))


@pytest.mark.parametrize("made", [os.mkfifo, sockets], ids=["pipe", "socket"])
def test_what_is_no_regular_file_is_never_replaced(tmp_path: Path, made: Callable[[Path], None]) -> None:
    made(tmp_path / "a.json")
    before = (tmp_path / "a.json").lstat()
    said = r": is no regular file, but a pipe, a device or the like; choose another"
    with pytest.raises(FileError, match=said):
        write_json(tmp_path / "a.json", {"a": 1})
    with pytest.raises(FileError, match=said):
        validate_place("/dev/null")  # asked alone: whoever may write there must not lose it, if this test fails
    after = (tmp_path / "a.json").lstat()
    assert (before.st_mode, before.st_ino) == (after.st_mode, after.st_ino)
    assert content_names(tmp_path) == ["a.json"]


def test_a_place_may_have_to_be_free(tmp_path: Path) -> None:
    assert validate_place(tmp_path / "a.json", overwrite=False) == tmp_path / "a.json"
    write_json(tmp_path / "a.json", 1)
    with pytest.raises(FileError, match=r"a\.json: exists already; choose another or allow it with --overwrite"):
        validate_place(tmp_path / "a.json", overwrite=False)
    assert validate_place(tmp_path / "a.json") == tmp_path / "a.json"


def test_a_new_file_gets_the_usual_permissions(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "")
    (tmp_path / "b.txt").write_text("")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def test_writing_into_a_missing_folder_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no/a\.txt: the folder .* does not exist; create it"):
        write_text(tmp_path / "no" / "a.txt", "")


def test_writing_over_a_folder_says_so(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(FileError, match=r"/a: cannot be written \(is a directory\)"):
        write_text(tmp_path / "a", "")
    assert set(content_names(tmp_path)) == {"a"}


def content_names(folder: Path) -> list[str]:
    return [entry.name for entry in folder.iterdir()]


def test_a_place_that_takes_no_files_says_so() -> None:
    with pytest.raises(FileError, match=r"/proc/a\.txt: cannot be written"):
        write_text("/proc/a.txt", "")


def test_a_name_that_is_too_long_is_told_wherever_it_is(tmp_path: Path) -> None:
    for place in (Path(500 * "x"), tmp_path / (500 * "x")):
        with pytest.raises(FileError, match=r"cannot be written \(file name too long\)$"):
            real_place(place)


def test_nothing_written_is_an_error(tmp_path: Path) -> None:
    with (
        pytest.raises(FileError, match=r"a\.txt: cannot be written \(no such file"),
        replacing(tmp_path / "a.txt"),
    ):
        pass


def test_errors_about_other_files_pass_through(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="other"), replacing(tmp_path / "a.txt"):
        (tmp_path / "other").read_text()


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"a\.json: cannot be read \(no such file or directory\)"):
        read_json(tmp_path / "a.json", Whole)


def test_folder_instead_of_a_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"cannot be read \(is a directory\)"):
        read_text(tmp_path)


def test_path_that_cannot_be() -> None:
    with pytest.raises(FileError, match=r"cannot be read \(embedded null byte\)"):
        read_text("a\0b")


def test_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "secret.toml"
    path.write_text("")
    path.chmod(0)
    if os.access(path, os.R_OK):  # Whoever runs this may read everything: let the system refuse another way.
        path = Path("/proc/self/mem")
    with pytest.raises(FileError, match=r"cannot be read \("):
        read_toml(path, Whole)


@pytest.mark.parametrize(
    ("parts", "told"), [(16, "unknown|unexpected|contains"), (17, "of more than 16 parts at line 3")]
)
def test_a_key_of_too_many_parts_is_told_by_its_line(parts: int, told: str, tmp_path: Path) -> None:
    """Python's parser takes a time that grows with their square, and then a stack as deep."""
    path = tmp_path / "deep.toml"
    path.write_text(f"# a comment\n\n{'.'.join('k' * parts)} = 1\n")
    with pytest.raises(FileError, match=told):
        read_toml(path, Whole)


def test_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(FileError, match=r"large\.toml: larger than 1048576 bytes"):
        read_toml(path, Whole)
    with pytest.raises(FileError, match=r"large\.toml: larger than 16777216 bytes"):
        read_text(path)


def test_what_is_no_file_is_neither_waited_for_nor_read(tmp_path: Path) -> None:
    told = "cannot be read .*not a regular file"
    with pipe(place := tmp_path / "pipe.toml"), pytest.raises(FileError, match=told):
        read_bytes(place, limit=100)
    for path in (Path("/dev/zero"), tmp_path):
        with pytest.raises(FileError, match=f"{path}: cannot be read"):
            read_bytes(path, limit=100)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name = 'a'\n[[parts]]\nmass = 1\n[[parts]]\n# second\nmass = 'x'\n", 6),
        ("name = 'a'\n[[parts]]\nmass = 1\n[[parts]]\n# second\nkind = 'rod'\n", 4),
        ("\n\nname = 1", 3),
        ("[extra]\nmass = 1\nkind = 1", 3),
    ],
)
def test_the_line_is_named(tmp_path: Path, text: str, line: int) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(FileError, match=rf"\(line {line}\)$"):
        read_toml(tmp_path / "a.toml", Whole)


def test_file_that_is_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b'name = "\xe9"')
    with pytest.raises(FileError, match=r"a\.toml: byte 8 is not UTF-8; save the file as UTF-8"):
        read_toml(tmp_path / "a.toml", Whole)


def test_byte_order_mark_is_no_trouble(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b'\xef\xbb\xbfname = "x"\r\n')
    assert read_toml(tmp_path / "a.toml", Whole) == Whole(name="x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("parts = [", r"not valid TOML \(Invalid value \(at end of document\)\)"),
        ("name = 'x'\nparts = oops\n", r"not valid TOML \(.*line 2"),
        ("a = 1\na = 2", "not valid TOML"),
        ("name = " + "9" * 5000, "not valid TOML"),
        ("name = " + "[" * 100_000, "not valid TOML"),
        ("name = 3", r"expected text, got a whole number - at `\$.name`"),
        ("[[parts]]", r"`mass` is missing - at `\$.parts\[0\]`"),
        ("parts = [{mass = 1}, {mass = 'x'}]", r"expected a number, got text - at `\$.parts\[1\].mass`"),
        ("parts = [{mass = nan}]", r"expected a finite number, got nan - at `\$.parts\[0\].mass`"),
        ("parts = [{mass = 1}, {mass = -inf}]", r"got -inf - at `\$.parts\[1\].mass`"),
        ("mas = 1", r"unknown field `mas`; expected one of parts, extra, name$"),
        ("mas = 1\nmess = 1", r"unknown fields `mas`, `mess`; expected one of parts, extra, name$"),
        ("parts = [{mas = 1}]", r"unknown field `mas` - at `\$.parts\[0\]`; expected one of mass, kind"),
        ("extra = {mas = 1}", r"unknown field `mas` - at `\$.extra`; expected one of mass, kind"),
        (
            "parts = [{mass = 1, kind = 'x'}]",
            r"'x' - at `\$.parts\[0\].kind`; expected one of '(rod|plate)', '(rod|plate)'",
        ),
    ],
)
def test_wrong_toml(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(FileError, match=r"bad\.toml: (?s:.*)" + message):
        read_toml(tmp_path / "bad.toml", Whole)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not valid JSON"),
        ('{"name": "x"} 1', "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ('{"name": "x", "name": "y"}', "not valid JSON .*'name' is given twice"),
        ('{"parts": [{"mass": NaN}]}', r"expected a finite number, got nan - at `\$.parts\[0\].mass`"),
        ('{"parts": [{"mass": -Infinity}]}', r"got -inf - at `\$.parts\[0\].mass`"),
        ('{"parts": [{"mass": 1e999}]}', r"got inf - at `\$.parts\[0\].mass`"),
        ('{"parts": [{"mass": 1' + "0" * 400 + "}]}", r"Number out of range - at `\$.parts\[0\].mass`"),
        ('{"mas": 1}', "unknown field `mas`; expected one of parts, extra, name"),
        ("[]", "expected a table, got a list"),
    ],
)
def test_wrong_json(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(FileError, match=r"bad\.json: (?s:.*)" + message):
        read_json(tmp_path / "bad.json", Whole)


@dataclass(frozen=True)
class Result:
    values: np.ndarray
    count: np.int64
    place: Path
    part: Part


def test_json_takes_what_results_are_made_of_and_keeps_their_order(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, Result(np.array([[1.0, 2.5]]), np.int64(3), Path("b"), Part(1.0)))
    expected = {"values": [[1.0, 2.5]], "count": 3, "place": "b", "part": {"mass": 1.0, "kind": "rod"}}
    read = read_json(path, dict[str, Any])
    assert read == expected
    assert list(read) == list(expected)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_json_refuses_what_is_not_finite(tmp_path: Path, bad: float) -> None:
    with pytest.raises(FileError, match=r"a\.json: expected a finite number, got .* - at `\$.b\[1\]`"):
        write_json(tmp_path / "a.json", {"b": np.array([0.0, bad])})
    assert content_names(tmp_path) == []


def test_json_refuses_what_it_has_no_form_for(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"a\.json: a complex cannot be written as JSON"):
        write_json(tmp_path / "a.json", [1j])


@settings(max_examples=12, deadline=None)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False)), st.text())
def test_json_keeps_every_bit(tmp_path_factory: pytest.TempPathFactory, numbers: list[float], text: str) -> None:
    path = tmp_path_factory.mktemp("json") / "a.json"
    text = text.encode("utf-8", "ignore").decode()
    write_json(path, {"numbers": numbers, "text": text})
    assert read_json(path, dict[str, Any]) == {"numbers": numbers, "text": text}


@pytest.mark.parametrize("name", ["a" * 250 + ".json", "ä" * 125 + ".json", "a" * 255, "a." + "b" * 253])
def test_the_longest_names_are_written(tmp_path: Path, name: str) -> None:
    write_json(tmp_path / name, 1)
    with pytest.raises(FileError, match="cannot be written"):
        write_json(tmp_path / (name[:-5] + "xx" + name[-5:]), 1)
    assert content_names(tmp_path) == [name]
