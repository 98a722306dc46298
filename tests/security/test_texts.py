"""Names from files within texts for other programs: whatever the name, the text around it keeps its meaning."""

import base64
import csv
import io
import json
import re
import zlib

import numpy as np
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from spaces import smooth_model

from dsbrdf import _text, cli, library
from dsbrdf.batch import record
from dsbrdf.export import FORMATS, export
from dsbrdf.measured.formats.image_file import write_pixels
from dsbrdf.measured.source import Source
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


#: The same in the name of a file, which holds no more than 255 bytes and neither "/" nor NUL.
FILE = "=cmd() \x1b]0;x\x07\x1b[2J\n<b>`a`|[b] ${x} $\\frac{$ %s {0} \u202e \u2028 \udcff \\"


@pytest.fixture(scope="module")
def hostile_files(tmp_path_factory):
    """Files of every kind whose names are hostile, inside and outside; by what commands below call them."""
    folder = tmp_path_factory.mktemp("hostile")
    files = {
        name: folder / f"{FILE}{name}{ending}"
        for name, ending in {
            "model": ".json",
            "other": ".json",
            "channels": ".json",
            "space": ".npz",
            "table": ".npz",
            "scan": ".csv",
            "known": ".csv",
            "library": ".dsbrdf",
            "picture": ".exr",
            "small": ".exr",
            "lights": ".csv",
            "merl": ".binary",
            "text": ".txt",
            "data": "",
        }.items()
    }
    channels = [f"{c}{HOSTILE}" for c in "rgb"]
    model = smooth_model(1, name=HOSTILE)
    model.save(files["model"])
    content = json.loads(files["model"].read_text())
    content |= {
        "source": {"file": HOSTILE, "description": HOSTILE, "sha256": HOSTILE},
        "fit": {HOSTILE: HOSTILE},
    }
    content["errors"] = {HOSTILE: 0.5}
    files["model"].write_text(json.dumps(content))
    smooth_model(2, name=HOSTILE).save(files["other"])
    files["channels"].write_text(json.dumps(content | {"channels": channels}))
    build_space([smooth_model(i, name=f"{i}{HOSTILE}") for i in range(3)]).save(files["space"])
    described = smooth_model(1, name="plain")
    described = described.replace(channels=channels, source=Source(description=HOSTILE))
    library.write(files["library"], [described], {HOSTILE: {HOSTILE: HOSTILE}})
    values = np.full((6, 5, 4, 3), 0.2) * np.linspace(1.0, 0.5, 6)[:, None, None, None]
    np.savez(
        files["table"],
        name=np.array(_text.well_formed(HOSTILE).replace("\0", "")),
        channels=np.array([_text.well_formed(c) for c in channels]),
        values=values,
    )
    # What drives a terminal is no text, and the file no table
    plain = "".join(c for c in _text.well_formed(HOSTILE) if c.isprintable() and c != '"')
    rows = [f"{i},{o},{0.2 + 0.001 * o},1" for i in (0, 30, 60) for o in (-60, -30, 0, 45)]
    head = "theta_i_deg,theta_o_deg"
    files["scan"].write_text(
        "\n".join([f"# {plain}", f'{head},"BRDF [1/sr]","{NOTE}"', *rows]), encoding="utf-8"
    )
    files["known"].write_text("\n".join([f"{head},value", *(row.rsplit(",", 1)[0] for row in rows)]))
    files["text"].write_text(f"{plain}\u2028;{plain}\n1;2\n", encoding="utf-8")
    files["lights"].write_text("0 0 1\n\x1b[2J nonsense\n")
    write_pixels(np.full((12, 12, 3), 0.2), files["picture"])
    write_pixels(np.full((3, 3, 3), 0.2), files["small"])
    with files["merl"].open("wb") as file:
        np.array([90, 90, 180], "<i4").tofile(file)
        file.truncate(12 + 3 * 90 * 90 * 180 * 8)
    files["data"].mkdir()
    (files["data"] / "merl").mkdir()
    (files["data"] / "merl" / files["merl"].name).hardlink_to(files["merl"])
    return files


#: A column of text that is left out.
NOTE = "=note\u202e|`x`"
#: Lines of each command, and their exit status. Words in capitals stand for files; a new command needs a line here.
COMMANDS = {
    "info": [
        ("MODEL", 0),
        ("CHANNELS", 0),
        ("SCAN --ignore NOTE", 0),
        ("TABLE", 0),
        ("TEXT", 1),
        ("MERL", 0),
    ],
    "check": [("MODEL CHANNELS", 0), ("SCAN --ignore NOTE --json", 1)],
    "view": [("MODEL CHANNELS LIBRARY -o page.html", 0), ("MODEL TEXT -s SPACE -o page.html", 2)],
    "fit": [
        ("TABLE --lobes 1 -o out --plot --view", 0),
        ("TABLE --lobes 1 --json", 0),
        ("TABLE NOTHING TEXT SCAN --lobes 1 -o batch", 1),
        ("SCAN --ignore NOTE --prior SPACE -o out", 1),
        ("SCAN --set =cmd\x1b[2J=x", 2),
    ],
    "render": [
        ("MODEL -o out.png --spp 1 --size 8", 0),
        ("MODEL -o NOTHING.gif", 2),
        ("MODEL --envmap NOTHING -o x.png", 1),
    ],
    "export": [
        *((f"MODEL -t {kind} -o out.{entry.suffix}", 0) for kind, entry in FORMATS.items() if entry.exact),
        ("CHANNELS -t glsl -o out.glsl", 0),
        ("CHANNELS -t glsl --channels \x1b[2J -o out.glsl", 1),
        ("MODEL -t \x1b[2J", 2),
    ],
    "convert": [
        *((f"TABLE out -t {kind}", 0) for kind in ("npz", "csv", "tsv")),
        ("SCAN out -t bird --ignore NOTE", 0),
        ("CHANNELS out.json -t bird", 1),
        ("SCAN out.csv --ignore NOTE", 0),
        ("TEXT out.csv", 1),
    ],
    "paper": [("\x1b[2J -o out", 1), ("fig2 --data MODEL -o out", 1)],
    "photo": [
        ("PICTURE --light LIGHTS", 1),
        ("PICTURE --light unknown --mask SMALL", 1),
        ("PICTURE --light unknown --prior TEXT", 1),
        ("DATA", 1),
    ],
    "plan": [
        ("-s SPACE -n 1 --in-plane -o out.csv", 0),
        ("--known SCAN --ignore NOTE -s SPACE -n 1 --in-plane -o out.csv", 1),
        ("--known TABLE", 2),
        ("-s TEXT", 1),
    ],
    "demo": [("-o MODEL", 1)],
    "compare": [("TABLE NOTHING TEXT --methods bivariate -o out", 1), ("TABLE --methods NOTE", 1)],
    "data list": [("", 0), ("merl", 0)],
    "data fetch": [("merl \x1b[2J", 1), ("rgl a --url \x1b[2J", 1)],
    "data path": [("", 0)],
    "library list": [("-f LIBRARY", 0), ("-f TEXT", 1)],
    "library show": [("plain -f LIBRARY", 0), ("\x1b[2J -f LIBRARY", 1)],
    "library write": [("MODEL -o out.dsbrdf", 1), ("MODEL -o \x1b[2J", 2)],
    "space build": [("MODEL OTHER -o made.npz --view page.html", 0), ("TEXT OTHER MODEL -o made.npz", 1)],
    "space plot": [("-s SPACE -o out", 0)],
    "space nearest": [("MODEL -s SPACE", 0), ("\x1b[2J -s SPACE", 1)],
    "space draw": [("-s SPACE", 0)],
    "space move": [("MODEL -s SPACE", 0), ("CHANNELS -s SPACE", 1)],
    "space blend": [("MODEL MODEL -s SPACE", 0), ("MODEL TEXT -s SPACE", 1)],
}


def commands(command, path=()):
    """Names of all commands, as Typer knows them."""
    if hasattr(command, "commands"):
        for name, inner in command.commands.items():
            yield from commands(inner, (*path, name))
    else:
        yield " ".join(path)


def test_every_command_is_tried_with_hostile_names():
    assert set(COMMANDS) == set(commands(typer.main.get_command(cli.app)))


@pytest.mark.parametrize(
    ("line", "status"),
    [(f"{command} {line}", status) for command, lines in COMMANDS.items() for line, status in lines],
)
def test_no_command_lets_a_name_drive_the_terminal(
    hostile_files, tmp_path, monkeypatch, capsys, line, status
):
    """Each does its work, or says what is wrong in lines of its own; it writes nowhere else, and no controls."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DSBRDF_DATA", str(hostile_files["data"]))
    files = hostile_files | {"nothing": hostile_files["model"].with_name(f"{FILE}nothing")}
    words = {name.upper(): str(path) for name, path in files.items()} | {"NOTE": NOTE}
    before = {path: path.stat().st_mtime_ns for path in hostile_files["model"].parent.rglob("*")}
    found = cli.main([words.get(word, word.replace("NOTHING", FILE)) for word in line.split(" ") if word])
    out, err = capsys.readouterr()
    assert not CONTROL.search(out), out
    assert not CONTROL.search(err), err
    assert all(
        text.startswith("dsbrdf: ") for text in err.splitlines() if not line.startswith("data fetch")
    ), err
    assert "unexpected" not in err
    assert "Traceback" not in err
    assert found == status, err
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.parent for path in written} <= {tmp_path, tmp_path / "out", tmp_path / "batch"}
    assert {path: path.stat().st_mtime_ns for path in before} == before
    for path in written:
        if path.suffix in (
            ".csv",
            ".tsv",
            ".md",
            ".json",
            ".glsl",
            ".wgsl",
            ".hlsl",
            ".slang",
            ".brdf",
            ".html",
        ):
            assert not CONTROL.search(path.read_text(encoding="utf-8")), path


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
