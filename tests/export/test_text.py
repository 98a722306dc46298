"""Names in files of other programs: whatever a name holds, it stays a name."""

import ast
import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from by_hand import by_hand
from hypothesis import given
from hypothesis import strategies as st

from dsbrdf import _text
from dsbrdf.baselines import engine
from dsbrdf.export import FORMATS, export, preview, text

HOSTILE = [
    "ends in a backslash \\",
    "two\nlines */ end of comment /* again",
    "quotes ' \" ''' \"\"\" \\\" <tag attribute='x'> & &amp; ]]> --> {braces} {0}",
    "\u2028 line \x85 separators \x0b\x0c\r \0 null \ud800 surrogate",
    "trigraph ??/",
    "é 漢字 \U0001f600",
    "9",
    "",
    "#include <x>\n::end shader",
    "a" * 5000,
]
ANY = st.text(st.characters(), max_size=60)


@given(ANY)
def test_a_comment_stays_one(name):
    found = text.comment(name)
    assert len(found.splitlines()) <= 1
    assert "*/" not in found
    assert not found.endswith(("\\", "/"))


@given(ANY)
def test_an_identifier_is_one(name):
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text.identifier(name))


@given(ANY)
def test_an_attribute_keeps_what_can_be_printed(name):
    found = ET.fromstring(f"<a b={text.attribute(name)} />")
    assert found.attrib["b"] == "".join(c for c in name if c.isprintable())


@given(ANY)
def test_a_string_is_closed(name):
    found = text.quoted(name)
    assert ast.literal_eval(found) == "".join(c for c in name if c.isprintable())


@pytest.fixture
def no_search(monkeypatch):
    """What the material is does not matter here."""

    def material(_, form, name):
        third = np.full(3, 0.3)
        return engine.EngineMaterial(third, third, third, 0.5, 0.5, 0.04, 0.5, False, form, name)

    monkeypatch.setattr(preview, "fit_engine", material)
    monkeypatch.setattr(preview, "nearness", lambda *_: preview.Nearness(0.1, 1.0))


def exported(folder, format, name):
    path = folder / f"x.{FORMATS[format].suffix}"
    export(by_hand([0.4], [3.0], [0.0], name=name), path, format, force=True)
    return path.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize(
    "format", ["glsl", "wgsl", "hlsl", "slang", "brdf", "gltf", "openpbr", "usd", "blender"]
)
@pytest.mark.usefixtures("no_search")
def test_hostile_names(tmp_path, format, name):
    """A file has as many lines as with a plain name, but for the title, and parses."""
    written = exported(tmp_path, format, name)
    expected = len(exported(tmp_path, format, "plain").splitlines())
    assert len(written.splitlines()) == expected
    if format == "gltf":
        assert json.loads(written)["materials"][0]["name"] == (_text.well_formed(name) or "material")
    elif format == "openpbr":
        ET.fromstring(written)
    elif format == "blender":
        ast.parse(written)
