"""Names from files within texts for other programs: whatever the name, the text around it keeps its meaning."""

import base64
import csv
import io
import json
import re
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from spaces import smooth_model

from dsbrdf import _text, cli
from dsbrdf.batch import record
from dsbrdf.export import FORMATS, export
from dsbrdf.space import build_space
from dsbrdf.view.page import page

pytestmark = pytest.mark.filterwarnings("ignore::dsbrdf.ConvergenceWarning")

#: A name that breaks out of every language that it comes into, one after the other.
HOSTILE = (
    "=cmd|'/C calc'!A0 \x1b]0;title\x07\x1b[2J\r\n</script><script>alert(1)</script>/*{floats}*/<!--{about}-->"
    "*/ int x; /* ]]> --> \"\"\" ''' ${x} $\\frac{$ %s {0} | `a` [b](javascript:x) \u202e \u2028 \udcff \0 \\"
)
#: What no output may hold: the beginning of an escape of a terminal.
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e\u2028\ud800-\udfff]")


@given(st.text())
def test_terminal(text):
    assert _text.shown(text).isprintable()
    assert _text.shown(_text.shown(text)) == _text.shown(text)
    assert _text.well_formed(text) == text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    assert len(_text.well_formed(text).encode()) >= len(text)


@given(st.text())
def test_cells_of_spreadsheets(text):
    cell = _text.csv_cell(text)
    assert cell[:1] not in ("=", "+", "-", "@", "\t", "\r")
    file = io.StringIO()
    csv.writer(file).writerow([cell, "next"])
    assert list(csv.reader(io.StringIO(file.getvalue()))) == [[cell, "next"]]


@given(st.text())
def test_cells_of_markdown(text):
    cell = _text.markdown_cell(text)
    assert "\n" not in cell
    # A bar that is not escaped would begin another cell
    assert len(re.findall(r"(?<!\\)(?:\\\\)*\|", cell)) == 0
    assert not re.search(r"<|(?<!\\)(?:\\\\)*[`*\[]", cell)


def test_tables_of_a_batch():
    rows = [record._row(name, {}, f"failed: {name}") for name in (HOSTILE, "@SUM(1)", "plain")]
    (_, *cells) = csv.reader(io.StringIO(record._csv(rows)))
    assert [len(row) for row in cells] == [len(record.COLUMNS)] * 3
    assert [row[0][:2] for row in cells] == ["'=", "'@", "pl"]
    lines = record._markdown(rows, {"x": HOSTILE}).splitlines()
    assert len(lines) == 4 + 3
    assert all(len(re.findall(r"(?<!\\)\|", line)) == len(record.COLUMNS) + 1 for line in lines[2:])
    assert "<script" not in "".join(lines)


def test_the_page_keeps_its_parts():
    """A name that is a mark of the template is not filled in, and none ends the script that it is in."""
    models = [smooth_model(1, name=HOSTILE), smooth_model(2, name="/*{words}*/")]
    text = page(models)
    plain = page([model.replace(name=f"m{i}") for i, model in enumerate(models)])
    assert text.count("<script") == plain.count("<script")
    assert text.count("<!--") == plain.count("<!--")
    data = {
        key: re.search(rf'id="{key}">(.*?)</script>', text, re.DOTALL)[1]
        for key in ("materials", "floats", "words")
    }
    content = json.loads(zlib.decompress(base64.b64decode(data["materials"])))
    names = [entry["name"] for entry in content["materials"]]
    assert names == [_text.well_formed(HOSTILE), "/*{words}*/"]
    assert data["floats"] == re.search(r'id="floats">(.*?)</script>', plain, re.DOTALL)[1]


@pytest.fixture(scope="module")
def hostile_files(tmp_path_factory):
    """A model file, a space and a table whose names, channels and sources are all hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    channels = [f"{c}{HOSTILE}" for c in "rgb"]
    model = smooth_model(1, name=HOSTILE)
    model.save(folder / "model.json")
    content = json.loads((folder / "model.json").read_text())
    content |= {
        "source": {"file": HOSTILE, "description": HOSTILE, "sha256": HOSTILE},
        "fit": {HOSTILE: HOSTILE},
    }
    content["errors"] = {HOSTILE: 0.5}
    (folder / "model.json").write_text(json.dumps(content))
    smooth_model(2, name=HOSTILE).save(folder / "other.json")
    (folder / "channels.json").write_text(json.dumps(content | {"channels": channels}))
    build_space([smooth_model(i, name=f"{i}{HOSTILE}") for i in range(3)]).save(folder / "space.npz")
    values = np.full((6, 5, 4, 3), 0.2) * np.linspace(1.0, 0.5, 6)[:, None, None, None]
    np.savez(
        folder / "table.npz",
        name=np.array(_text.well_formed(HOSTILE).replace("\0", "")),
        channels=np.array([_text.well_formed(c) for c in channels]),
        values=values,
    )
    return folder


@pytest.mark.parametrize(
    "command",
    [
        "info model.json",
        "info channels.json",
        "check model.json",
        "view model.json channels.json -o page.html",
        "fit table.npz --lobes 1 -o out --plot",
        "fit table.npz --lobes 1 --json",
        "fit table.npz nothing.npz --lobes 1 -o batch",
        "space build model.json other.json -o made.npz",
        "space nearest model.json -s space.npz",
        "space draw -s space.npz",
        "space move model.json -s space.npz",
        "space blend model.json model.json -s space.npz",
        "convert table.npz table.csv",
    ],
)
def test_no_command_lets_a_name_drive_the_terminal(hostile_files, tmp_path, monkeypatch, capsys, command):
    """Each does its work, or says what is wrong in lines of its own."""
    for file in hostile_files.iterdir():
        (tmp_path / file.name).hardlink_to(file)
    monkeypatch.chdir(tmp_path)
    status = cli.main(command.split())
    out, err = capsys.readouterr()
    assert not CONTROL.search(out), out
    assert not CONTROL.search(err), err
    assert all(line.startswith("dsbrdf: ") for line in err.splitlines())
    assert "unexpected" not in err
    assert "Traceback" not in err
    assert status == (1 if "nothing" in command else 0), err
    assert {path.parent for path in tmp_path.rglob("*") if path.is_file()} <= {
        tmp_path,
        tmp_path / "out",
        tmp_path / "batch",
    }


#: Of those that hold the nearest material of a program, `tests/export` has more.
KINDS = [
    kind for kind, entry in FORMATS.items() if entry.exact and kind not in ("merl", "rgl", "rgl-spectral")
]


@pytest.mark.parametrize("kind", KINDS)
def test_exports_hold_a_name_as_text(tmp_path, kind):
    """A name adds no line, and no character that drives a terminal, to any file of text."""
    plain, hostile = (tmp_path / f"{name}.{FORMATS[kind].suffix}" for name in ("plain", "hostile"))
    model = smooth_model(1, n_lobes=1)
    export(model.replace(name="name"), plain, kind)
    export(model.replace(name=HOSTILE), hostile, kind)
    text = hostile.read_text(encoding="utf-8")
    assert not CONTROL.search(text)
    assert len(text.splitlines()) == len(plain.read_text(encoding="utf-8").splitlines())
