"""Databases: from a server on this machine, that behaves well and badly."""

import dataclasses
import errno
import hashlib
import shutil
import zipfile

import numpy as np
import pytest
from data_server import Server

from dsbrdf import _lock, cli, read
from dsbrdf.measured import _download, databases
from dsbrdf.measured.formats.merl import N_BYTES
from dsbrdf.measured.formats.tensor_file import write_tensor_file

pytest.importorskip("pooch")


@pytest.fixture
def server():
    server = Server()
    yield server
    server.close()


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Where the databases are kept."""
    folder = tmp_path / "databases"
    monkeypatch.setenv("DSBRDF_DATA", str(folder))
    return folder


@pytest.fixture(scope="session")
def archive(merl_file, tmp_path_factory):
    """A zip file of two materials, and of members that want to be elsewhere."""
    path = tmp_path_factory.mktemp("zip") / "BRDFDatabase.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        file.write(merl_file, "BRDFDatabase/brdfs/nickel.binary")
        file.writestr("../evil.binary", b"out")
        file.writestr("/tmp/evil.binary", b"out")
        file.writestr("BRDFDatabase/brdfs/../../../brass.binary", b"out")
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("BRDFDatabase/brdfs/brass.binary", bytes(N_BYTES))
        file.writestr("BRDFDatabase/brdfs/steel.binary", bytes(N_BYTES - 1))
    return path.read_bytes()


@pytest.fixture
def merl(server, here, archive, monkeypatch):  # noqa: ARG001
    """The server has the archive, and the archive is what is expected."""
    return offer(server, archive, monkeypatch)


def offer(server, content, monkeypatch, names=("nickel", "brass", "steel", "teflon")):
    known = databases.Archive(len(content), hashlib.md5(content).hexdigest(), "BRDFDatabase/brdfs/{}.binary")
    stand_in = dataclasses.replace(databases.DATABASES["merl"], archive=known, names=names)
    monkeypatch.setitem(databases.DATABASES, "merl", stand_in)
    server.files["/zip"] = content
    monkeypatch.setenv("DSBRDF_MERL_URL", f"{server.url}/zip")
    return known


def in_folder(here):
    return sorted(str(path.relative_to(here)) for path in here.rglob("*") if path.is_file())


def test_what_is_known_of_merl():
    """From the record that holds it, see `page`."""
    of = databases.DATABASES["merl"]
    assert of.archive == databases.Archive(
        1_253_117_184, "7141af4c12b4c4feed299769260b3604", "BRDFDatabase/brdfs/{}.binary"
    )
    assert len(set(of.names)) == 100
    assert of.url.startswith(of.page)


@pytest.mark.usefixtures("merl")
def test_materials_are_extracted_and_can_be_read(here, merl_file):
    (path,) = databases.fetch("merl", ["nickel"])
    assert path == here / "merl" / "nickel.binary"
    assert path.read_bytes() == merl_file.read_bytes()
    assert read(path).name == "nickel"
    assert databases.fetched("merl") == [path]
    assert in_folder(here) == ["merl/merl.zip", "merl/nickel.binary"]


@pytest.mark.usefixtures("merl")
def test_what_is_here_is_not_fetched_again(server):
    first = databases.fetch("merl", ["nickel"])
    assert len(server.asked) == 1
    assert databases.fetch("merl", ["nickel"]) == first
    # Another one comes from the archive that was kept
    assert [path.name for path in databases.fetch("merl", ["brass", "nickel"])] == [
        "brass.binary",
        "nickel.binary",
    ]
    assert len(server.asked) == 1


@pytest.mark.usefixtures("merl")
def test_one_download_at_a_time(here):
    with (
        _lock.held(here / "merl" / databases.LOCK),
        pytest.raises(_lock.BusyError, match="is writing to this folder"),
    ):
        databases.fetch("merl", ["nickel"])
    assert databases.fetch("merl", ["nickel"])


def test_the_archive_goes_when_all_are_extracted(server, here, archive, monkeypatch):
    offer(server, archive, monkeypatch, names=("nickel", "brass"))
    assert len(databases.fetch("merl")) == 2
    assert in_folder(here) == ["merl/brass.binary", "merl/nickel.binary"]


@pytest.mark.usefixtures("merl")
def test_a_half_file_of_earlier_is_made_whole(here, merl_file):
    (here / "merl").mkdir(parents=True)
    (here / "merl" / "nickel.binary").write_bytes(b"half")
    (path,) = databases.fetch("merl", ["nickel"])
    assert path.read_bytes() == merl_file.read_bytes()


# Interrupted


def test_goes_on_by_itself_where_it_was_cut(merl, server, here):
    server.cut = [1000, 2000]
    told = []
    databases.fetch("merl", ["nickel"], told=lambda there, total: told.append((there, total)))
    assert server.asked == [None, "bytes=1000-", "bytes=3000-"]
    assert told[0] == (1000, merl.size)
    assert told[-1] == (merl.size, merl.size)
    assert (here / "merl" / "nickel.binary").exists()


def test_goes_on_in_the_next_run(merl, server, here):
    server.cut = [1000] + [0] * 10
    with pytest.raises(
        ConnectionError, match=rf"1,000 of {merl.size:,} bytes are here: run it again to go on"
    ):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == ["merl/merl.zip.part"]
    server.cut.clear()
    server.asked.clear()
    databases.fetch("merl", ["nickel"])
    assert server.asked == ["bytes=1000-"]


@pytest.mark.usefixtures("merl", "here")
@pytest.mark.parametrize("ranges", [False, True])
def test_begins_anew_where_the_server_cannot_go_on(server, ranges, merl_file):
    server.ranges, server.lies_about_range = ranges, True
    server.cut = [1000]
    (path,) = databases.fetch("merl", ["nickel"])
    assert server.asked == [None, "bytes=1000-"] + [None] * ranges
    assert path.read_bytes() == merl_file.read_bytes()


@pytest.mark.usefixtures("merl", "here")
def test_a_server_that_never_gives_the_whole(server):
    server.ranges, server.cut = False, [2000, 1000] * 10
    with pytest.raises(ConnectionError, match="it ended early"):
        databases.fetch("merl", ["nickel"])
    assert len(server.asked) < 6


def test_more_than_the_whole_is_thrown_away(merl, server, here):
    (here / "merl").mkdir(parents=True)
    (here / "merl" / "merl.zip.part").write_bytes(bytes(merl.size + 1))
    databases.fetch("merl", ["nickel"])
    assert server.asked == [None]


@pytest.mark.usefixtures("merl")
def test_killed_while_it_extracts(here, monkeypatch):
    def interrupt(source, target, *_):
        target.write(source.read(1000))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfileobj", interrupt)
        with pytest.raises(KeyboardInterrupt):
            databases.fetch("merl", ["nickel"])
    assert in_folder(here) == ["merl/merl.zip"]
    databases.fetch("merl", ["nickel"])


# Refused and damaged


@pytest.mark.usefixtures("merl")
def test_wrong_hash(server, here):
    content = bytearray(server.files["/zip"])
    content[100] ^= 1
    server.files["/zip"] = bytes(content)
    with pytest.raises(ValueError, match=r"hash of downloaded file \(merl\.zip\) does not match"):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == []


@pytest.mark.parametrize("keep", [0, 10, 30_000_000, -30])
def test_truncated_archive(server, here, archive, monkeypatch, keep):
    """Whose hash is right: the record itself is damaged."""
    offer(server, archive[:keep] if keep else b"no zip", monkeypatch)
    with pytest.raises(
        ValueError, match=r"merl\.zip: not the archive it should be: .*Remove it and fetch again"
    ):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == ["merl/merl.zip"]


@pytest.mark.usefixtures("merl")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("teflon", "no item named 'BRDFDatabase/brdfs/teflon.binary'"),
        ("steel", "steel.binary should have 34,992,012 bytes, and has 34,992,011"),
    ],
)
def test_members_are_checked(here, name, text):
    with pytest.raises(ValueError, match=text):
        databases.fetch("merl", [name])
    assert in_folder(here) == ["merl/merl.zip"]


def test_a_damaged_member(server, here, archive, monkeypatch):
    content = bytearray(archive)
    content[1_000_000] ^= 1
    offer(server, bytes(content), monkeypatch)
    with pytest.raises(ValueError, match="Bad CRC-32"):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == ["merl/merl.zip"]


@pytest.mark.usefixtures("merl")
def test_nothing_climbs_out(here, tmp_path):
    databases.fetch("merl", ["nickel", "brass"])
    assert in_folder(here) == ["merl/brass.binary", "merl/merl.zip", "merl/nickel.binary"]
    assert in_folder(tmp_path) == [f"databases/{name}" for name in in_folder(here)]
    assert (here / "merl" / "brass.binary").stat().st_size == N_BYTES


@pytest.mark.usefixtures("merl")
@pytest.mark.parametrize("status", [403, 404, 500, 503])
def test_the_server_refuses(server, here, status):
    server.status["/zip"] = status
    with pytest.raises(ConnectionError, match=rf"/zip: the server says {status} .*See https://zenodo\.org"):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == []


@pytest.mark.usefixtures("merl")
@pytest.mark.parametrize("url", ["http://127.0.0.1:9/zip", "http://host.invalid/zip"])
def test_offline(here, url):
    with pytest.raises(ConnectionError, match=rf"{url}: .*Is this machine online\? Try again later"):
        databases.fetch("merl", ["nickel"], url=url)
    assert in_folder(here) == []


# No space


@pytest.mark.usefixtures("here")
def test_no_space_is_told_before(merl, server, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9 - 1000, 1000))
    need = merl.size + N_BYTES
    with pytest.raises(
        OSError, match=rf"{need:,} bytes are needed, 1,000 are free; set DSBRDF_DATA"
    ) as caught:
        databases.fetch("merl", ["nickel"])
    assert caught.value.errno == errno.ENOSPC
    assert server.asked == []


@pytest.mark.usefixtures("merl")
def test_the_disk_fills_up(server, here, monkeypatch):
    real = _download.Download._write

    def write(self, file, block):
        if file.tell() > 3_000_000:
            file = Full()
        real(self, file, block)

    class Full:
        def write(self, _):
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(_download.Download, "_write", write)
        with pytest.raises(OSError, match="No space left on device; what has come stays") as caught:
            databases.fetch("merl", ["nickel"])
        assert caught.value.errno == errno.ENOSPC
    (part,) = in_folder(here)
    there = (here / part).stat().st_size
    assert there > 3_000_000
    databases.fetch("merl", ["nickel"])
    assert server.asked == [None, f"bytes={there}-"]


@pytest.mark.usefixtures("merl")
def test_the_disk_fills_up_while_it_extracts(here, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(shutil, "copyfileobj", full)
    with pytest.raises(OSError, match="No space left"):
        databases.fetch("merl", ["nickel"])
    assert in_folder(here) == ["merl/merl.zip"]


# RGL


@pytest.fixture
def rgl(server, here, tmp_path, monkeypatch):  # noqa: ARG001
    write_tensor_file(tmp_path / "a.bsdf", {"description": np.frombuffer(b"made up", np.uint8)})
    server.files["/made_up/made_up_rgb.bsdf"] = (tmp_path / "a.bsdf").read_bytes()
    monkeypatch.setenv("DSBRDF_RGL_URL", f"{server.url}/{{0}}/{{0}}_rgb.bsdf")


@pytest.mark.usefixtures("rgl")
def test_a_material_of_rgl(server, here):
    (path,) = databases.fetch("rgl", ["made_up"])
    assert path.read_bytes() == server.files["/made_up/made_up_rgb.bsdf"]
    assert databases.fetch("rgl", ["made_up"]) == [path]
    assert len(server.asked) == 1
    assert in_folder(here) == ["rgl/made_up_rgb.bsdf"]


@pytest.mark.usefixtures("rgl")
def test_a_material_that_is_not_there(here):
    with pytest.raises(
        ConnectionError, match=r"the server says 404 .*Is 'nothing' listed at https://rgl\.epfl\.ch"
    ):
        databases.fetch("rgl", ["nothing"])
    assert in_folder(here) == []


@pytest.mark.usefixtures("rgl")
def test_half_a_material_is_not_put_in_place(server, here):
    server.cut = [20] * 5
    with pytest.raises(ConnectionError, match=r"it ended after 20 of \d+ bytes.*Try again later"):
        databases.fetch("rgl", ["made_up"])
    server.cut.clear()
    server.files["/made_up/made_up_rgb.bsdf"] = server.files["/made_up/made_up_rgb.bsdf"][:-3]
    with pytest.raises(ValueError, match=r"/made_up/made_up_rgb\.bsdf: "):
        databases.fetch("rgl", ["made_up"])
    assert [name for name in in_folder(here) if not name.endswith(".part")] == []
    assert databases.fetched("rgl") == []


# What is asked for


@pytest.mark.parametrize(
    ("database", "names", "text"),
    [
        ("mirl", [], r"no database 'mirl': there are merl and rgl\."),
        ("merl", ["nikel"], r"merl: no material 'nikel'\. Did you mean nickel\?.*dsbrdf data list merl"),
        ("merl", ["../../x"], r"merl: no material '\.\./\.\./x'\."),
        ("rgl", [], r"rgl: name the materials; they are listed at https://rgl\.epfl\.ch/materials\."),
        ("rgl", ["../x"], r"rgl: '\.\./x' is no name of a material"),
    ],
)
def test_names_are_checked(here, database, names, text):
    with pytest.raises(ValueError, match=text):
        databases.fetch(database, names)
    assert not here.exists()


@pytest.mark.usefixtures("here")
def test_the_address_of_a_mirror_needs_a_place_for_the_name():
    with pytest.raises(
        ValueError, match=r"rgl: the address needs \{0\} in place of the material, got http://x\."
    ):
        databases.fetch("rgl", ["a"], url="http://x")


@pytest.mark.usefixtures("merl")
def test_without_pooch(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pooch", None)
    with pytest.raises(ModuleNotFoundError, match=r"databases need pooch: pip install 'dsbrdf\[data\]'"):
        databases.fetch("merl", ["nickel"])
    monkeypatch.delenv("DSBRDF_DATA")
    with pytest.raises(ModuleNotFoundError, match="or name a folder that holds them in DSBRDF_DATA"):
        databases.folder()


def test_the_folder(here, monkeypatch):
    assert databases.folder() == here
    monkeypatch.delenv("DSBRDF_DATA")
    assert databases.folder().name == "dsbrdf"


# The command


def run(capsys, *arguments):
    status = cli.main(["data", *arguments])
    return status, *capsys.readouterr()


@pytest.mark.usefixtures("merl")
def test_fetch_shows_licence_and_citation(here, capsys):
    status, out, err = run(capsys, "fetch", "merl", "nickel")
    assert status == 0
    assert out == f"{here / 'merl' / 'nickel.binary'}\n"
    assert "CC-BY-SA-4.0" in err
    assert "A Data-Driven Reflectance Model" in err
    assert "https://zenodo.org/records/8101681" in err


@pytest.mark.usefixtures("merl", "here")
def test_list(capsys):
    assert "0 of 4" in run(capsys, "list")[1]
    databases.fetch("merl", ["nickel"])
    status, out, _ = run(capsys, "list")
    assert status == 0
    assert "1 of 4" in out
    assert "CC0-1.0" in out
    assert run(capsys, "list", "merl")[1].splitlines() == ["nickel (here)", "brass", "steel", "teflon"]
    assert run(capsys, "list", "rgl")[1] == "All are listed at https://rgl.epfl.ch/materials\n"


def test_path(here, capsys):
    assert run(capsys, "path") == (0, f"{here}\n", "")


@pytest.mark.usefixtures("merl")
def test_a_failure_is_a_line(server, capsys):
    server.status["/zip"] = 500
    status, out, err = run(capsys, "fetch", "merl", "nickel")
    assert (status, out) == (1, "")
    assert err.splitlines()[-1].startswith(f"dsbrdf: error: {server.url}/zip: the server says 500 ")
