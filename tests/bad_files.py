"""Files that nobody should trust: a corpus of bad robots, bases, constraints and priorities, by name."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

URDF = """<robot name="two">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 0.5" rpy="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.05"/></inertial></link>
  <link name="tool"><inertial><origin xyz="0 0 0.2"/><mass value="1.5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.03"/></inertial></link>
  <joint name="first" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="40"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="second" type="prismatic"><parent link="arm"/><child link="tool"/><axis xyz="0 0 1"/>
    <limit lower="-0.2" upper="0.3" velocity="1" effort="20"/></joint>
</robot>
"""
MJCF = """<mujoco model="two">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="arm" pos="0 0 1" quat="1 0 0 0"><joint name="first" axis="0 1 0" range="-2 2" damping="0.1"/>
      <geom type="capsule" size="0.05 0.3" density="900"/>
      <body name="tool" pos="0 0 0.5"><joint name="second" type="slide" axis="0 0 1" pos="0 0 0" armature="0.1"/>
        <inertial pos="0 0 0.1" mass="1.5" diaginertia="0.1 0.1 0.03"/></body>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="first" gear="50" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
CHAIN = """schema = "adaptctl/denavit-hartenberg/1"
convention = "standard"
name = "two"
gravity = [0.0, 0.0, -9.81]

[[links]]
a = 0.4
d = 0.1
alpha = 1.5
mass = 2.0
first_moment = [0.1, 0.0, 0.2]
inertia = { xx = 0.2, yy = 0.3, zz = 0.1 }
velocity = 3.0

[[links]]
a = 0.3
alpha = 0.0
theta = 0.2
mass = 1.0
center_of_mass = [0.0, 0.0, 0.1]
inertia_at_center = { xx = 0.1, yy = 0.1, zz = 0.02 }
"""
LOOP = """schema = "adaptctl/mechanism/1"
name = "four-bar"
primary = ["crank"]
reference = { crank = 1.2 }

[[links]]
name = "a"
joint = "crank"
axis = [0.0, 1.0, 0.0]
mass = 1.0
center_of_mass = [0.2, 0.0, 0.0]
inertia_at_center = { xx = 0.01, yy = 0.02, zz = 0.02 }

[[links]]
name = "b"
joint = "coupler"
parent = "a"
axis = [0.0, 1.0, 0.0]
position = [0.4, 0.0, 0.0]
mass = 1.0
center_of_mass = [0.2, 0.0, 0.0]
inertia_at_center = { xx = 0.01, yy = 0.02, zz = 0.02 }

[[links]]
name = "c"
joint = "rocker"
position = [0.5, 0.0, 0.0]
axis = [0.0, 1.0, 0.0]
mass = 1.0
center_of_mass = [0.2, 0.0, 0.0]
inertia_at_center = { xx = 0.01, yy = 0.02, zz = 0.02 }

[[closures]]
name = "pin"
first = { link = "b", position = [0.5, 0.0, 0.0] }
second = { link = "c", position = [0.4, 0.0, 0.0] }
"""
CONSTRAINTS = """schema = "adaptctl/parameter-constraints/1"

[known]
link2.mc_y = 0.0

[[relations]]
name = "equal"
weights = { link1.I_xx = 1.0, link1.I_yy = -1.0 }
value = 0.1
"""
PRIORITY = """schema = "adaptctl/priority/1"
order = ["link1.m", "link2.m"]
keep = ["link2.I_zz"]
"""
GOOD = {".urdf": URDF, ".xml": MJCF, ".toml": CHAIN, ".loop.toml": LOOP}
"""Robots that can be read, by the ends of their names."""

NO_NUMBERS = ("nan", "-inf", "1e300", "x", "", "\N{FULLWIDTH DIGIT ONE}", "1_0", "0x10", "1;0")
"""What no number is, or no magnitude that a robot has."""
URDF_NUMBERS = (
    'value="2"',
    'ixx="0.2"',
    'izz="0.03"',
    'damping="0.1"',
    'xyz="0 0 0.5"',
    'rpy="0 0 0.1"',
    'xyz="0 1 0"',
)
MJCF_NUMBERS = ('size="0.05 0.3"', 'density="900"', 'mass="1.5"', 'diaginertia="0.1 0.1 0.03"', 'gravity="0 0 -9.81"')
MJCF_MORE = ('pos="0 0 0.5"', 'quat="1 0 0 0"', 'axis="0 1 0"', 'gear="50"', 'armature="0.1"')
TOML_NUMBERS = ("a = 0.4", "d = 0.1", "alpha = 1.5", "mass = 2.0", "theta = 0.2", "velocity = 3.0")
NO_TOML = ("nan", "-inf", "1e300", "1e400", "'1'", "true", "[]", "\N{FULLWIDTH DIGIT ONE}", "")


def bad_files() -> dict[str, bytes]:
    """Content by name; the name's end says what kind of file it is."""
    groups = (_numbers(), _urdf(), _mjcf(), _toml(), _bytes(), _others())
    return {name: text if isinstance(text, bytes) else text.encode() for group in groups for name, text in group}


def _numbers() -> Iterator[tuple[str, str]]:
    for kind, text, places in (("urdf", URDF, URDF_NUMBERS), ("xml", MJCF, (*MJCF_NUMBERS, *MJCF_MORE))):
        for place in places:
            name, _, values = place.replace('"', "").partition("=")
            for i, wrong in enumerate(NO_NUMBERS):
                words = [*values.split()[:-1], wrong]
                yield f"{name}-{words[0]}-{i}.{kind}", text.replace(place, f'{name}="{" ".join(words)}"', 1)
    for place in TOML_NUMBERS:
        for i, wrong in enumerate(NO_TOML):
            name = place.partition(" = ")[0]
            yield f"{name}-{i}.toml", CHAIN.replace(place, f"{name} = {wrong}", 1)


def _changed(text: str, changes: Mapping[str, tuple[str, str]], kind: str) -> Iterator[tuple[str, str]]:
    for name, (old, new) in changes.items():
        assert old in text, name
        yield f"{name}.{kind}", text.replace(old, new, 1)


def _urdf() -> Iterator[tuple[str, str]]:
    yield from _changed(
        URDF,
        {
            "axis-overflows": ('axis xyz="0 1 0"', 'axis xyz="1e200 1e200 0"'),
            "axis-zero": ('axis xyz="0 1 0"', 'axis xyz="0 0 0"'),
            "mass-zero": ('mass value="2"', 'mass value="0"'),
            "mass-minus-zero": ('mass value="2"', 'mass value="-0"'),
            "mass-tiny": ('mass value="2"', 'mass value="5e-324"'),
            "mass-negative": ('mass value="2"', 'mass value="-2"'),
            "origin-far": ('xyz="0 0 1"', 'xyz="0 0 1e12"'),
            "inertia-vast": ('ixx="0.2"', 'ixx="1e25"'),
            "limits-crossed": ('lower="-2"', 'lower="3"'),
            "effort-word": ('effort="40"', 'effort="forty"'),
            "friction-negative": ('friction="0.2"', 'friction="-0.2"'),
            "xacro-value": ('mass value="2"', 'mass value="${m}"'),
            "xacro-find": ('name="two"', 'name="$(arg name)"'),
            "xacro-unbound": ("<link name", "<xacro:link name"),
            "xacro-bound": (
                '<robot name="two">',
                '<robot name="two" xmlns:x="http://ros.org/wiki/xacro"><x:if value="1"/>',
            ),
            "xacro-deep": ('<mass value="2"/>', '<mass value="2"/><a xmlns:xacro="u/xacro"><xacro:b/></a>'),
            "doctype": ("<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot'),
            "external-entity": ("<robot", '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot'),
            "unclosed": ("</robot>", ""),
            "two-roots": ("</robot>", "</robot><robot/>"),
            "wrong-root": ("<robot", "<robots"),
            "cycle": ('<parent link="base"/>', '<parent link="tool"/>'),
            "no-such-parent": ('<parent link="base"/>', '<parent link="floor"/>'),
            "names-twice": ('link name="tool"', 'link name="arm"'),
            "nameless": ('link name="tool"', "link"),
            "name-long": ('link name="tool"', f'link name="{"x" * 1000}"'),
            "name-controls": ('joint name="first"', 'joint name="\x9b2Jfirst"'),
            "name-reversed": ('joint name="first"', 'joint name="\u202efirst"'),
            "escape": ('joint name="first"', 'joint name="\x1b]0;title\x07"'),
            "kind-unread": ('type="prismatic"', 'type="floating"'),
            "kind-unknown": ('type="revolute"', 'type="revolut"'),
            "two-inertials": ("</inertial></link>", "</inertial><inertial/></link>"),
            "six-numbers": ('xyz="0 0 1"', 'xyz="0 0 1 0 0 0"'),
            "many-numbers": ('xyz="0 0 1"', f'xyz="{"0 " * 100_000}"'),
            "mimic-itself": ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="second"/>'),
            "mimic-zero": ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="first" multiplier="0"/>'),
            "attribute-twice": ('mass value="2"', 'mass value="2" value="3"'),
            "nul": ('name="two"', 'name="t\0wo"'),
        },
        "urdf",
    )
    chain = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(2_500)
    )
    yield "links-2500.urdf", f'<robot name="long">{chain}<link name="l2500"/></robot>'
    cut = "".join(part + "</joint>" for part in chain.split("</joint>")[:300])
    yield "links-that-move-300.urdf", f'<robot name="long">{cut}<link name="l300"/></robot>'
    yield "deep-50000.urdf", "<robot>" + "<link>" * 50_000
    yield "elements-100000.urdf", f"<robot>{'<a/>' * 100_000}</robot>"
    yield "empty.urdf", ""
    yield "blank.urdf", " \n"


def _mjcf() -> Iterator[tuple[str, str]]:
    yield from _changed(
        MJCF,
        {
            "capsule-negative": ('size="0.05 0.3"', 'size="-0.05 0.3"'),
            "capsule-zero": ('size="0.05 0.3"', 'size="0 0.3"'),
            "capsule-tiny": ('size="0.05 0.3"', 'size="1e-300 0.3"'),
            "model-reversed": ('model="two"', 'model="\u202etwo"'),
            "model-long": ('model="two"', f'model="{"x" * 1000}"'),
            "capsule-flat": ('size="0.05 0.3"', 'size="0.05 0"'),
            "capsule-one-size": ('size="0.05 0.3"', 'size="0.05"'),
            "size-vast": ('size="0.05 0.3"', 'size="1e29 1e29"'),
            "density-negative": ('density="900"', 'density="-900"'),
            "geom-mass-negative": ('density="900"', 'mass="-1"'),
            "mass-negative": ('mass="1.5"', 'mass="-1.5"'),
            "mass-zero": ('mass="1.5"', 'mass="0"'),
            "mass-minus-zero": ('mass="1.5"', 'mass="-0.0"'),
            "mass-tiny": ('mass="1.5"', 'mass="1e-308"'),
            "no-such-joint": ('joint="first" gear', 'joint="third" gear'),
            "axis-overflows": ('axis="0 1 0"', 'axis="1e200 1e200 1e200"'),
            "axis-zero": ('axis="0 1 0"', 'axis="0 0 0"'),
            "quat-zero": ('quat="1 0 0 0"', 'quat="0 0 0 0"'),
            "two-attitudes": ('quat="1 0 0 0"', 'quat="1 0 0 0" euler="0 0 0"'),
            "include": ("<worldbody>", '<include file="/etc/passwd"/><worldbody>'),
            "doctype": ("<mujoco", '<!DOCTYPE m [<!ENTITY a "b">]><mujoco'),
            "ball": ('type="slide"', 'type="ball" pos="1e99 0 0"'),
            "kind-unknown": ('type="slide"', 'type="slid"'),
            "range-crossed": ('range="-2 2"', 'range="2 -2"'),
            "range-missing": ('range="-2 2"', 'limited="true"'),
            "class-unknown": ("<geom", '<geom class="none"'),
            "section-unknown": ("<actuator>", "<robots/><actuator>"),
            "attribute-unknown": ('pos="0 0 0.5"', 'position="0 0 0.5"'),
            "compiler-choice": ('angle="radian"', 'angle="rad"'),
            "compiler-eulerseq": ('angle="radian"', 'eulerseq="xyw"'),
            "names-twice": ('body name="tool"', 'body name="arm"'),
            "joints-twice": ('joint name="second"', 'joint name="first"'),
            "damping-negative": ('damping="0.1"', 'damping="-0.1"'),
            "armature-negative": ('armature="0.1"', 'armature="-0.1"'),
            "mesh-geom": ('type="capsule"', 'type="mesh"'),
            "equality-unknown": ("<actuator>", '<equality><weld body1="arm" body2="none"/></equality><actuator>'),
            "holds-still": ("<actuator>", '<equality><joint joint1="second"/></equality><actuator>'),
            "name-controls": ('joint name="first"', 'joint name="\x85first"'),
            "two-moving-roots": (
                "</worldbody>",
                '<body><joint name="own"/><geom size="1"/></body></worldbody><actuator><motor joint="own"/></actuator>',
            ),
        },
        "xml",
    )
    shapes = {"box": "0.1 -0.1 0.1", "sphere": "-1", "cylinder": "0 1", "ellipsoid": "1 1 0"}
    for shape, size in shapes.items():
        yield f"{shape}-size.xml", MJCF.replace('type="capsule" size="0.05 0.3"', f'type="{shape}" size="{size}"')
    yield "geoms-100000.xml", MJCF.replace("<geom", '<geom size="0.1"/>' * 100_000 + "<geom", 1)
    yield "geoms-20000.xml", MJCF.replace("<geom", '<geom size="0.1"/>' * 20_000 + "<geom", 1)
    bodies = '<body><joint/><geom size="1"/>' * 300 + "</body>" * 300
    yield "links-300.xml", f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
    yield "deep-5000.xml", f"<mujoco><worldbody>{'<body>' * 5_000}{'</body>' * 5_000}</worldbody></mujoco>"


def _toml() -> Iterator[tuple[str, str]]:
    long_key = ".".join("a" * 50_000)
    yield from _changed(
        CHAIN,
        {
            "mass-negative": ("mass = 2.0", "mass = -2.0"),
            "mass-zero": ("mass = 2.0", "mass = 0.0"),
            "mass-minus-zero": ("mass = 2.0", "mass = -0.0"),
            "mass-tiny": ("mass = 2.0", "mass = 1e-308"),
            "a-far": ("a = 0.4", "a = 1e12"),
            "inertia-vast": ("xx = 0.2", "xx = 1e25"),
            "gravity-vast": ("-9.81", "-1e15"),
            "key-of-50000-parts": ("name =", f"{long_key} = 1\nname ="),
            "table-of-50000-parts": ("[[links]]", f"[{long_key}]\n[[links]]"),
            "inner-key-of-50000-parts": ('name = "two"', f"name = {{{long_key} = 1}}"),
            "nested-arrays": ('name = "two"', "name = " + "[" * 5_000 + "]" * 5_000),
            "name-escape": ('"two"', '"\\u001b]0;title\\u0007"'),
            "name-empty": ("[[links]]", '[[links]]\nname = ""'),
            "name-long": ("[[links]]", f'[[links]]\nname = "{"x" * 1000}"'),
            "field-unknown": ("mass = 2.0", "maas = 2.0"),
            "schema-unknown": ("hartenberg/1", "hartenberg/2"),
            "schema-missing": ("schema", "scheme"),
            "alpha-twice": ("alpha = 1.5", "alpha = 1.5\nalpha_deg = 90"),
            "alpha-missing": ("alpha = 1.5\n", ""),
            "key-twice": ("mass = 2.0", "mass = 2.0\nmass = 2.0"),
            "inertia-twice": ("mass = 2.0", "mass = 2.0\ncenter_of_mass = [0.0, 0.0, 0.0]"),
            "velocity-negative": ("velocity = 3.0", "velocity = -3.0"),
            "drive-negative": ("velocity = 3.0", "drive = { viscous = -1.0 }"),
            "range-crossed": ("velocity = 3.0", "range = [1.0, -1.0]"),
            "links-300": ("[[links]]", "[[links]]\nalpha = 0.0\n" * 300 + "[[links]]"),
        },
        "toml",
    )
    yield from _changed(
        LOOP,
        {
            "open": ("position = [0.5, 0.0, 0.0] }", "position = [50.0, 0.0, 0.0] }"),
            "closed-on-itself": ('second = { link = "c"', 'second = { link = "b"'),
            "no-such-link": ('second = { link = "c"', 'second = { link = "z"'),
            "no-such-primary": ('primary = ["crank"]', 'primary = ["crane"]'),
            "primary-twice": ('primary = ["crank"]', 'primary = ["crank", "crank"]'),
            "too-many-primary": ('primary = ["crank"]', 'primary = ["crank", "rocker", "coupler"]'),
            "no-such-reference": ("{ crank = 1.2 }", "{ crane = 1.2 }"),
            "parent-itself": ('parent = "a"', 'parent = "b"'),
            "no-such-parent": ('parent = "a"', 'parent = "z"'),
            "axis-zero": ("axis = [0.0, 1.0, 0.0]", "axis = [0.0, 0.0, 0.0]"),
            "axis-overflows": ("axis = [0.0, 1.0, 0.0]", "axis = [1e200, 1e200, 0.0]"),
            "links-twice": ('name = "b"', 'name = "a"'),
            "kind-unknown": ('name = "pin"', 'name = "pin"\nkind = "ball"'),
            "reference-far": ("crank = 1.2", "crank = 1e29"),
        },
        "loop.toml",
    )


def _bytes() -> Iterator[tuple[str, bytes]]:
    for kind, text in (("urdf", URDF), ("xml", MJCF), ("toml", CHAIN)):
        yield f"utf-16.{kind}", text.encode("utf-16")
        yield f"utf-16-undeclared.{kind}", text.encode("utf-16-le")
        yield f"latin-1.{kind}", text.replace("two", "zw\xf6lf").encode("latin-1")
        yield f"cut.{kind}", text.encode()[: len(text) // 2]
        yield f"zeros.{kind}", bytes(1000)
        yield f"noise.{kind}", bytes(range(256)) * 4


def _others() -> Iterator[tuple[str, str]]:
    yield from _changed(
        CONSTRAINTS,
        {
            "two-spellings": ("link2.mc_y = 0.0", 'link2.mc_y = 0.0\n"link2.mc_y" = 1.0'),
            "weights-in-two-spellings": ("link1.I_xx = 1.0,", 'link1.I_xx = 1.0, "link1.I_xx" = 2.0,'),
            "no-such-parameter": ("link2.mc_y", "link9.mc_y"),
            "contradiction": (
                "[[relations]]",
                "[[relations]]\nweights = { link2.mc_y = 1.0 }\nvalue = 1.0\n[[relations]]",
            ),
            "weights-zero": ("link1.I_xx = 1.0, link1.I_yy = -1.0", "link1.I_xx = 0.0"),
            "value-vast": ("value = 0.1", "value = 1e300"),
            "value-nan": ("value = 0.1", "value = nan"),
        },
        "constraints.toml",
    )
    yield from _changed(
        PRIORITY,
        {
            "no-such-parameter": ('"link2.m"', '"link9.m"'),
            "twice": ('"link2.m"', '"link1.m"'),
            "text": ('["link1.m", "link2.m"]', '"link1.m"'),
            "grid-too": ("keep", "grid = { m = [1, 2] }\nkeep"),
        },
        "priority.toml",
    )


def bad_bases(good: str) -> dict[str, str]:
    """Files of a basis made wrong: contradictions that its file shows, and numbers that only its mechanism can."""
    found: dict[str, str] = {}

    def change(name: str, **fields: object) -> None:
        found[name] = json.dumps({**json.loads(good), **fields})

    content = json.loads(good)
    rows: dict[str, dict[str, float]] = content["regrouping"]
    added = next(kept for kept, row in rows.items() if row)
    lone = next(kept for kept, row in rows.items() if not row)
    term = next(iter(rows[added]))
    change("scales-zero", scales=[0.0, *content["scales"][1:]])
    change("scales-negative", scales=[-1.0, *content["scales"][1:]])
    change("scales-short", scales=content["scales"][1:])
    change("gap-zero", gap=0.0)
    change("gap-negative", gap=-1.0)
    change("rank", rank=content["rank"] + 1)
    change("schema", schema="adaptctl/fundamental-basis/9")
    change("coefficient", regrouping={**rows, added: {**rows[added], term: rows[added][term] + 0.1}})
    change("term-missing", regrouping={**rows, added: {k: v for k, v in rows[added].items() if k != term}})
    change("row-missing", rank=content["rank"] - 1, regrouping={k: v for k, v in rows.items() if k != added})
    change("lone-row-missing", rank=content["rank"] - 1, regrouping={k: v for k, v in rows.items() if k != lone})
    change("no-such-parameter", regrouping={**rows, added: {"link9.m": 1.0}})
    change("parameters-twice", parameters=[*content["parameters"][:-1], content["parameters"][0]])
    change("parameters-5000", parameters=[f"p{i}" for i in range(5000)])
    found["nan"] = good.replace('"gap": ', '"gap": NaN, "gap": ', 1)
    found["key-twice"] = good.replace('"gap": ', '"gap": 1.0, "gap": ', 1)
    found["cut"] = good[: len(good) // 2]
    found["deep"] = "[" * 100_000
    return found


@contextmanager
def pipe(path: Path) -> Iterator[None]:
    """A pipe whose other end is closed at once by whoever waits there, so that a reader would not wait for ever."""
    os.mkfifo(path)
    writer = threading.Thread(target=lambda: os.close(os.open(path, os.O_WRONLY)), daemon=True)
    writer.start()
    try:
        yield
    finally:
        reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        writer.join(5.0)
        os.close(reader)
