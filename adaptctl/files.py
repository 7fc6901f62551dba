"""Atomic writing and checked reading of files."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from adaptctl.content_words import errors_of, in_words, told_all
from adaptctl.errors import FileError, printable, suggested_name

MAX_LISTED, SIMILAR = 1000, 0.8
"""files of a folder, and likeness of names, where one of them may have been meant"""
MAX_BYTES = 16 * 2**20
"""size above which files are not read"""
MAX_TOML_BYTES = 2**20
"""size above which TOML files are not read"""
MAX_STEM_BYTES, MAX_SUFFIX_BYTES = 200, 40
"""bytes of a name that its temporaries repeat, and of a suffix among them"""
MAX_KEY_PARTS = 16
"""parts of a TOML key; reading time is quadratic in them"""
NOT_REGULAR = "not a regular file, but a pipe, a device or the like; give a file"
MAX_MAGNITUDE = 1e30
"""magnitude of numbers in TOML files, so that products of five are finite"""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w.-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_KEY_PARTS}}}")
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")

Content = TypeVar("Content")


@cache
def _process_space() -> str:
    """Hash of what a process number belongs to: host, boot and namespace."""
    told = [os.uname().nodename]
    with suppress(OSError):  # Linux alone tells these.
        told.append(str(Path("/proc/self/ns/pid").readlink()))
        told.append(Path("/proc/sys/kernel/random/boot_id").read_text())
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Context with a temporary path that replaces `path` at success."""
    target = validate_place(path)
    remove_stale_temporaries(target.parent, target.name)
    beside = name_beside(target)
    try:
        yield beside
        flush(beside)
        beside.replace(target)
    except OSError as error:
        if error.filename not in (None, str(beside)):
            raise
        raise FileError(f"{path}: cannot be written ({reason(error)})") from error
    finally:
        with suppress(OSError):  # told already, where nothing can be written
            beside.unlink(missing_ok=True)
    with suppress(OSError):  # Some file systems do not flush folders; the file is in place by now.
        flush(target.parent)


def validate_place(path: str | Path, overwrite: bool = True) -> Path:
    """Resolved path of a file to write, checked."""
    target = real_place(path)
    if not target.parent.is_dir():
        raise FileError(f"{path}: the folder {target.parent} does not exist; create it or choose another place")
    if target.is_dir():
        raise FileError(f"{path}: cannot be written (is a directory)")
    validate_regular(path, target)
    if target.exists() and not overwrite:
        raise FileError(f"{path}: exists already; choose another or allow it with --overwrite")
    if not os.access(target.parent, os.W_OK):
        raise FileError(f"{path}: cannot be written (the folder {target.parent} is not yours to write to)")
    return target


def validate_output(path: str | Path, overwrite: bool = True) -> None:
    """Raise `FileError` unless `write_bytes` can write a place: a file, or a stream that takes bytes as they come."""
    if _own_stream(path) is None and not _takes_bytes(path):
        validate_place(path, overwrite)


def _own_stream(path: str | Path) -> int | None:
    """Number of an open descriptor of this process that a path such as /dev/stdout names."""
    named = os.path.normpath(path)
    found = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d{1,9})", named)
    return int(found[1]) if found else {"/dev/stdout": 1, "/dev/stderr": 2}.get(named)


def _takes_bytes(path: str | Path) -> bool:
    """True for pipes and devices."""
    with suppress(OSError, ValueError):
        mode = Path(path).stat().st_mode
        return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)
    return False


def _stream(path: str | Path) -> int | None:
    """New descriptor of a pipe that is read, a device, or a stream of this process; None for all other places."""
    if (own := _own_stream(path)) is not None:
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
        return os.dup(own)
    if not _takes_bytes(path):
        return None
    with suppress(OSError):  # of a pipe that nobody reads, which would hold us
        descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        os.set_blocking(descriptor, True)
        return descriptor
    return None


def validate_regular(path: str | Path, target: Path, instead: str = "another") -> None:
    """Raise `FileError` where a pipe, a device or the like would be replaced."""
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise FileError(f"{path}: is no regular file, but a pipe, a device or the like; choose {instead}")


def real_place(path: str | Path) -> Path:
    """Resolved path of a file or folder to write."""
    try:
        target = Path(os.path.realpath(path))
        target.exists()  # raises for names that are too long
    except OSError as error:
        gone = not Path(path).is_absolute() and error.errno == errno.ENOENT
        cause = "the working folder does not exist any more; change to another" if gone else reason(error)
        raise FileError(f"{printable(str(path))}: cannot be written ({cause})") from error
    if Path(path).is_symlink() and not target.is_relative_to(os.path.realpath(Path(path).parent)):
        raise FileError(f"{path}: is a link to {target}, outside its folder; give that path itself")
    return target


def name_beside(target: Path) -> Path:
    """Hidden path beside another, for temporary files."""
    stem, suffix = _parts(target.name)
    return target.with_name(f".{stem}.{_process_space()}-{os.getpid()}-{os.urandom(4).hex()}{suffix}")


def _parts(name: str) -> tuple[str, str]:
    """Stem and suffix of a name, the stem cut so that a temporary's name is not too long."""
    stem, suffix = Path(name).stem, Path(name).suffix
    if len(os.fsencode(suffix)) > MAX_SUFFIX_BYTES:
        stem, suffix = name, ""
    return os.fsdecode(os.fsencode(stem)[: MAX_STEM_BYTES - len(os.fsencode(suffix))]), suffix


def remove_stale_temporaries(folder: Path, name: str) -> list[Path]:
    """Delete temporaries of ended processes; return others."""
    stem, suffix = _parts(name)
    pattern = re.compile(rf"\.{re.escape(stem)}\.[\w-]+-\d+-[0-9a-f]{{8}}{re.escape(suffix)}")
    alive: list[Path] = []
    with suppress(OSError):
        for entry in [entry for entry in folder.iterdir() if pattern.fullmatch(entry.name)]:
            if not is_stale_temporary(entry.name):
                alive.append(entry)
            elif entry.is_dir():
                from shutil import rmtree  # which takes longer to import than most files to write

                rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
    return alive


def is_stale_temporary(name: str) -> bool:
    """True for temporaries of ended processes here."""
    owner = re.search(rf"\.{_process_space()}-(\d+)-[0-9a-f]{{8}}(?:\.\w+)?$", name)
    if owner is None:
        return False
    try:
        os.kill(int(owner.group(1)), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        pass
    return False


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file atomically, or through a pipe, device or stream as /dev/stdout."""
    try:
        if (descriptor := _stream(path)) is not None:
            with os.fdopen(descriptor, "wb") as through:
                through.write(data)
            return
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({reason(error)})") from error
    with replacing(path) as beside:
        beside.write_bytes(data)


def write_text(path: str | Path, data: str) -> None:
    """Write UTF-8 text atomically."""
    write_bytes(path, data.encode())


def write_json(path: str | Path, value: object) -> None:
    """Write indented JSON atomically."""
    try:
        plain = msgspec.to_builtins(value, str_keys=True, enc_hook=_plain)
    except TypeError as error:
        raise FileError(f"{path}: {error}") from error
    _validate_finite(path, plain)
    write_text(path, json.dumps(plain, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def finite_or_none(value: float | None) -> float | None:
    """Number for JSON, None if not finite."""
    return float(value) if value is not None and math.isfinite(value) else None


def toml_string(text: str) -> str:
    """TOML basic string of a text."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def hashed(content: Any) -> str:
    """SHA-256 hash of JSON content, independent of key order."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def read_bytes(path: str | Path, limit: int = MAX_BYTES) -> bytes:
    """Bytes of the file at `path`."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            # Opened without waiting: a pipe would hold us until somebody writes into it.
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ValueError(NOT_REGULAR)
            data = file.read(limit + 1)
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: cannot be read ({reason(error)}){similar(path)}") from error
    if len(data) > limit:
        raise FileError(f"{path}: larger than {limit} bytes, the most that is read")
    return data


def similar(path: str | Path) -> str:
    """Hint at a file of a similar name in the folder of one that is not there."""
    place = Path(path)
    try:
        with os.scandir(place.parent) as entries:
            names = [entry.name for entry in islice(entries, MAX_LISTED) if entry.is_file()]
    except (OSError, ValueError):
        return ""
    if place.name in names:
        return ""
    others = [name for name in names if Path(name).stem == place.stem]
    return suggested_name(place.name, names, SIMILAR) or suggested_name(place.name, others, 0.0)


def validate_readable(path: str | Path) -> None:
    """Raise `FileError` for a pipe, a device or the like, which would hold who opens it."""
    if (place := Path(path)).exists() and not place.is_file():
        raise FileError(f"{path}: cannot be read ({NOT_REGULAR})")


def read_text(path: str | Path, limit: int = MAX_BYTES) -> str:
    """Text of a UTF-8 file, without byte order mark."""
    return decoded(path, read_bytes(path, limit))


def decoded(path: str | Path, data: bytes) -> str:
    """Text of UTF-8 bytes, without byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from error


def read_json(path: str | Path, kind: type[Content], limit: int = MAX_BYTES) -> Content:
    """Contents of a JSON file as a `kind`."""
    text = read_text(path, limit)
    try:
        plain = json.loads(text, object_pairs_hook=_unrepeated)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: not valid JSON ({error})") from error
    return typed(path, plain, kind)


def read_toml(path: str | Path, kind: type[Content]) -> Content:
    """Contents of a TOML file as a `kind`."""
    text = read_text(path, MAX_TOML_BYTES)
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise FileError(f"{path}: not valid TOML (a key of more than {MAX_KEY_PARTS} parts at line {line})")
    import tomllib  # here, since programs that read no such file need not wait for it

    try:
        plain = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        kind_given = Path(path).suffix
        told = "not valid TOML" if kind_given in ("", ".toml") else f"expected a TOML file, got a {kind_given}"
        raise FileError(f"{path}: {told} ({error})") from error
    return typed(path, plain, kind, MAX_MAGNITUDE, text)


def with_line(message: str, text: str) -> str:
    """Error message with the line of its element."""
    element = re.search(r"\$((?:\.[\w-]+|\[\d+\])+)", message)
    line = toml_line(text, element.group(1)) if element else 0
    return f"{message} (line {line})" if line else message


def toml_line(text: str, element: str) -> int:
    """Line of an element in a TOML text, or 0."""
    table = re.match(r"\.([\w-]+)(?:\[(\d+)\])?(?:\.([\w-]+))?", element)
    if table is None:
        return 0
    name, index, key = table.groups()
    start = rf"^[ \t]*\[+[ \t]*{re.escape(name)}[ \t]*\]+|^[ \t]*{re.escape(name)}\b"
    heads = list(re.finditer(start, text, re.MULTILINE))
    if int(index or 0) >= len(heads):
        return 0
    head = heads[int(index or 0)]
    end = re.compile(r"^[ \t]*\[\[", re.MULTILINE).search(text, head.end())
    inner = re.compile(rf"^[ \t]*{re.escape(key)}\b", re.MULTILINE).search(text, head.end()) if key else None
    found = inner if inner and (end is None or inner.start() < end.start()) else head
    return text.count("\n", 0, found.start()) + 1


def typed(path: str | Path, plain: object, kind: type[Content], largest: float = math.inf, text: str = "") -> Content:
    """Contents of a file as a `kind`, from what was read of it; all errors are told, with their lines in a text."""
    try:
        _validate_finite(path, plain, largest)
        return msgspec.convert(plain, kind)
    except FileError as error:
        raise FileError(with_line(str(error), text)) from error
    except (msgspec.ValidationError, OverflowError, RecursionError) as error:
        found = list(errors_of(plain, kind)) or [in_words(str(error))]
        raise FileError(f"{path}: {told_all([with_line(one, text) for one in found])}") from error


def _validate_finite(path: str | Path, content: object, largest: float = math.inf) -> None:
    pending = [("$", content)]
    while pending:
        element, value = pending.pop()
        if isinstance(value, float) and not math.isfinite(value):
            raise FileError(f"{path}: expected a finite number, got {value} - at `{element}`")
        if isinstance(value, int | float) and not -largest <= value <= largest:
            raise FileError(f"{path}: expected a number of at most {largest:g} - at `{element}`")
        if largest < math.inf and isinstance(value, str) and _CONTROL.search(value):
            raise FileError(f"{path}: control characters in {printable(value)!r} - at `{element}`")
        if isinstance(value, dict):
            pending += [(f"{element}.{key}", entry) for key, entry in value.items()]
        elif isinstance(value, list | tuple):
            pending += [(f"{element}[{index}]", entry) for index, entry in enumerate(value)]


def _unrepeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Object of pairs, refusing equal keys."""
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(key for key in keys if keys.count(key) > 1)!r} is given twice")
    return content


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")


def flush(path: Path) -> None:
    """Write a file or folder to disk (fsync)."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def reason(error: Exception) -> str:
    """Text of an `error` within a sentence."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text[:1].lower() + text[1:]
