"""What is read is a regular file, is bounded before memory is taken, and holds only numbers that later steps bear."""

import json
import os
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib

import h5py
import numpy as np
import pytest
from formats import VALID, place, sound
from scipy.io import savemat
from spaces import smooth_model

import dsbrdf
from dsbrdf import Samples, batch, comparison, library
from dsbrdf.batch.texels import MAPS, TexelMaps
from dsbrdf.fitting.observations import Observations
from dsbrdf.images import Light, sources
from dsbrdf.images.picture import Picture
from dsbrdf.measured.formats import image_file, tensor_file, utia
from dsbrdf.measured.names import meaning
from dsbrdf.model.file import dumps, loads
from dsbrdf.space import Sizes, build_space, load_space
from dsbrdf.space.space_file import SpaceFormatError

LOADERS = {
    "model": dsbrdf.load,
    "space": load_space,
    "library": library.open,
    "measured": dsbrdf.read,
    "samples": dsbrdf.read_samples,
    "merl": dsbrdf.read_merl,
    "tensors": tensor_file.read_tensor_file,
    "picture": image_file.read_pixels,
    "lights": sources.read_lights,
    "normals": sources.read_normals,
    "mask": sources.read_mask,
    "map of light": Light.from_map,
    "picture of an object": lambda path: Picture.of(path, ""),
    "texels": dsbrdf.load_texels,
    "utia": utia.read_utia,
    "comparison": comparison.Comparison.load,
}


@pytest.mark.parametrize("name", LOADERS)
def test_what_is_no_regular_file_is_refused(tmp_path, name):
    """At once: a pipe would be waited for, and a device read without end."""
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "pipe.npy")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for path in ("/dev/zero", "/dev/full", tmp_path / "zero", tmp_path / "pipe", tmp_path / "pipe.npy"):
        with pytest.raises(ValueError, match="regular file"):
            LOADERS[name](path)
    with pytest.raises((OSError, ValueError), match=r"directory|a folder|regular"):
        LOADERS[name](tmp_path)
    with pytest.raises(OSError, match="No such file"):
        LOADERS[name](tmp_path / "missing.npy")


@pytest.mark.parametrize("kind", VALID)
def test_a_file_that_is_mostly_a_hole_is_refused(tmp_path, kind):
    """Four terabytes that take no room on the disk, behind a valid beginning."""
    path = place(kind, tmp_path, VALID[kind]())
    os.truncate(path, 2**42)
    assert not sound(kind, path) or kind == "record"


def test_pipes_in_a_stack(tmp_path):
    """A folder of pictures from elsewhere: no file of it is waited for."""
    for name in ("filenames.txt", "light_directions.txt", "light_intensities.txt"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(ValueError, match="regular file"):
        sources.read_stack(tmp_path)
    os.mkfifo(tmp_path / "Normal_gt.mat")
    with pytest.raises(ValueError, match="regular file"):
        sources._ground_truth(tmp_path, (2, 2))


def test_a_group_that_would_run_what_it_holds(tmp_path):
    """Zarr knows a way of storing that unpickles; a group with it is refused before any of it is read."""
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(tmp_path / "x.zarr", mode="w", zarr_format=2)
    group.attrs.update({"format": "dsbrdf texels", "n_lobes": 1, "sizes": [1] * 5, "channels": ["a"]})
    for name in MAPS:
        group.create_array(name, shape=(2, 2), dtype="f4", chunks=(2, 2))
        about = json.loads((tmp_path / "x.zarr" / name / ".zarray").read_text())
        about |= {"dtype": "|O", "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}], "fill_value": ""}
        (tmp_path / "x.zarr" / name / ".zarray").write_text(json.dumps(about))
        # What unpickling it would call: open(path, "w")
        code = f"cio\nopen\n(V{tmp_path / 'ran'}\nVw\ntR."
        (tmp_path / "x.zarr" / name / "0.0").write_bytes(code.encode())
    with pytest.raises(ValueError, match=r"not maps of texels: unknowns must be a Zarr 3 array"):
        dsbrdf.load_texels(tmp_path / "x.zarr")
    assert not (tmp_path / "ran").exists()


def test_a_group_replaces_only_groups_of_ours(tmp_path):
    pytest.importorskip("zarr")
    maps = texels_of_nothing()
    (tmp_path / "x.zarr").mkdir()
    (tmp_path / "x.zarr" / "precious").write_text("precious")
    with pytest.raises(FileExistsError, match="no group of ours"):
        maps.save(tmp_path / "x.zarr")
    assert (tmp_path / "x.zarr" / "precious").read_text() == "precious"
    for _ in range(2):
        maps.save(tmp_path / "y.zarr")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.zarr", "y.zarr"]
    assert dsbrdf.load_texels(tmp_path / "y.zarr").shape == maps.shape


def test_pipes_in_a_folder(tmp_path, small_table):
    """They are no measured files, whatever their names, and none is taken for the record of a batch."""
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    out.mkdir()
    for name in ("a.txt", "b.dat"):
        os.mkfifo(folder / name)
    with pytest.raises(ValueError, match="no measured file"):
        batch.expand([folder], strict=True)
    os.mkfifo(out / batch.RECORD)
    with pytest.raises(OSError, match="not a regular file"):
        batch.fit_many([small_table], out, n_lobes=1)


def test_a_link_in_place_of_the_lock_is_not_followed(tmp_path, small_table):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".dsbrdf-batch.lock").symlink_to(victim)
    with pytest.raises(OSError, match="symbolic links"):
        batch.fit_many([small_table], tmp_path / "out", n_lobes=1)
    assert victim.read_text() == "precious"


# Bombs


def texels_of_nothing(n=2):
    """Maps of `n` by `n` texels without a model."""
    empty = np.full((n, n), np.nan, "f4")
    return TexelMaps(np.full((n, n, 8), np.nan, "f4"), empty, empty, 2, Sizes(1, 1, 1, 1, 1), ("a",))


def bombs(folder):
    """Files that unpack to much more than they are, by name of the loader."""
    header = (
        b"\x93NUMPY\x01\0v\0"
        + b"{'descr': '<f8', 'fortran_order': False, 'shape': (20000000,), }".ljust(117)
        + b"\n"
    )
    with (
        zipfile.ZipFile(folder / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("values.npy", "w") as file,
    ):
        file.write(header)
        for _ in range(20):
            file.write(bytes(8_000_000))
    with h5py.File(folder / "bomb.h5", "w") as file:
        for i in range(60):
            file.create_dataset(
                f"theta_{i}", (1_000_000,), "f8", chunks=(100_000,), compression="gzip", fillvalue=0.0
            )
    packing, parts = zlib.compressobj(9), []
    for _ in range(160):
        parts.append(packing.compress(bytes(1_000_000)))
    packed = b"".join(parts) + packing.flush()
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    (folder / "bomb.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    column = b'{"values":[1],"unit":"deg"},'
    columns = b"".join(b'"theta_%d":' % i + column for i in range(20_000))
    values = b"[" + b"0," * 200_000 + b"0]"
    (folder / "bomb.json").write_bytes(
        b'{"metadata":{},"data":{' + columns + b'"BRDF":{"values":' + values + b"}}}"
    )
    # Small numbers, each of which becomes one of 64 bits
    angles = ("theta_i_deg", "theta_o_deg", "phi_o_deg", "brdf")
    np.savez_compressed(folder / "small.npz", **{name: np.ones(9_000_000, "u1") for name in angles})
    with h5py.File(folder / "small.h5", "w") as file:
        for name in angles:
            file.create_dataset(name, data=np.ones(9_000_000, "u1"), compression="gzip")
    savemat(folder / "small.mat", {name: np.ones(9_000_000, "u1") for name in angles}, do_compression=True)
    # Lists within lists of texts that hold them
    np.savez_compressed(
        folder / "lists.npz", header=np.array("[" + "[]," * 2_000_000 + "0]"), curves=0, present=0
    )
    header = b'{"sources":[' + b"[]," * 2_000_000 + b"0]}"
    start = 16 + len(header) + 16
    index = struct.pack("<2Q", start, start + 2)
    (folder / "lists.dsbrdf").write_bytes(
        b"dsbrdfL1" + struct.pack("<II", len(header), 1) + header + index + b"\0\0"
    )
    np.savez_compressed(folder / "texels.npz", **vars(texels_of_nothing(1500)))
    image = struct.pack(">II5B", 16_000, 16_000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + image
    (folder / "bomb.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )


def test_bombs_take_no_memory(tmp_path):
    """In a process of a gigabyte: each is refused with a reason."""
    bombs(tmp_path)
    code = """
import resource, sys, warnings
import h5py, numpy, scipy.io, mitsuba, dsbrdf
from pathlib import Path
from dsbrdf import library
from dsbrdf.images import Light
from dsbrdf.space import load_space
warnings.simplefilter("ignore")
mitsuba.set_variant("scalar_rgb")
def peak():
    return int(next(l for l in open("/proc/self/status") if l.startswith("VmHWM")).split()[1]) / 1024
before = peak()
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
for path in sorted(Path(sys.argv[1]).iterdir()):
    readers = {".npz": [load_space, dsbrdf.load_texels], ".dsbrdf": [library.open], ".png": [Light.from_map]}
    for reader in (dsbrdf.read, *readers.get(path.suffix, [])):
        try:
            reader(path)
        except ValueError as error:
            print(path.name, "refused", str(error)[:200])
        else:
            print(path.name, "READ")
print("grown", round(peak() - before))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    *lines, grown = done.stdout.splitlines()
    assert len(lines) == 11 + 2 * 4 + 2
    assert all(" refused " in line for line in lines), done.stdout
    assert int(grown.split()[1]) < 130, done.stdout


def test_a_damaged_image_prints_nothing(tmp_path, capfd):
    """The library that reads images warns of parts of them that do not matter, in colours of the terminal."""
    content = VALID["png"]()
    damaged = bytearray(content)
    # A byte of the sum of the first part after the header
    damaged[33 + 8 + struct.unpack(">I", content[33:37])[0]] ^= 1
    (tmp_path / "x.png").write_bytes(damaged)
    image_file.read_pixels(tmp_path / "x.png")
    assert capfd.readouterr() == ("", "")


def test_hdf5_that_points_to_other_files(tmp_path):
    """Its numbers would be those of any file that the reader may read."""
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(80))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["values"] = np.ones((3, 3))
    with h5py.File(tmp_path / "raw.h5", "w") as file:
        file.create_dataset("values", (2, 5), "f8", external=[(str(secret), 0, 80)])
    with pytest.raises(ValueError, match="lies in another file"):
        dsbrdf.read(tmp_path / "raw.h5")
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["values"] = h5py.ExternalLink("other.h5", "/values")
    with pytest.raises(ValueError, match="without arrays at its top"):
        dsbrdf.read(tmp_path / "link.h5")


# Models


@pytest.fixture
def stored(tmp_path):
    """Call with changes: a model file with some numbers changed."""

    def write(**changes):
        path = tmp_path / "x.json"
        smooth_model(1).save(path)
        content = json.loads(path.read_text())
        for key, change in changes.items():
            change(content[key]) if callable(change) else content.update({key: change})
        path.write_text(json.dumps(content))
        return path

    return write


def set_first(key, value):
    def change(lobes):
        row = lobes[key][0]
        (row[0] if isinstance(row[0], list) else row)[0] = value

    return change


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("key", ["scale", "gamma", "beta", "falloff", "colour"])
def test_numbers_that_are_none(stored, key, value):
    with pytest.raises(dsbrdf.ModelFormatError, match=f"'{key}' must be .*finite, got {value}"):
        dsbrdf.load(stored(lobes=set_first(key, value)))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("scale", 1e300, r"'scale' must be >= -1000 and <= 100 and finite, got 1e\+300 at index \(0, 0\)"),
        ("colour", 1e300, "'colour' must be"),
        ("gamma", 1e3, "'gamma' must be"),
        ("beta", -1e6, "'beta' must be"),
        ("falloff", -1.0, "'falloff' must be"),
        ("scale", 9.0, r"ln\(kappa\) reaches 9\.\d+, beyond 6\.5, the most that expm1 holds"),
    ],
)
def test_numbers_that_no_fit_gives(stored, key, value, message):
    with pytest.raises(dsbrdf.ModelFormatError, match=message):
        dsbrdf.load(stored(lobes=set_first(key, value)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fit": {"a": float("nan")}}, '"fit" must hold finite numbers, got nan'),
        ({"errors": {"rel": float("inf")}}, '"errors" must hold finite numbers, got inf'),
        ({"fit": {"a": 10**400}}, '"fit" must hold numbers of 64 bits, got one of 1329'),
        ({"fit": {"a": [[[[[[[[0]]]]]]]]}}, '"fit" must have at most 8 levels'),
        ({"name": "n" * 100_000}, "a name has 100,000 letters, expected at most 1,000"),
        (
            {"lobes": {"scale": [], "gamma": [], "beta": [], "falloff": [], "colour": []}},
            "'scale' must have shape",
        ),
        (
            {
                "lobes": {k: [[0.0]] * 5000 for k in ("scale", "gamma", "beta", "falloff")}
                | {"colour": [[[0.0]] * 5000]},
                "channels": ["a"],
            },
            "5,000 lobes are more than any model has",
        ),
        (
            {
                "lobes": {k: [[0.0] * 101] for k in ("scale", "gamma", "beta", "falloff")}
                | {"colour": [[[0.0]]]}
            },
            "101 coefficients are more than any model has",
        ),
        (
            {"profile": {"theta_d": [0.1], "theta_h": [[0.1]], "mean": [[[1e300]]], "amplitude": [[[0]]]}},
            "'mean' of the profile must be within",
        ),
    ],
    ids=["fit", "errors", "whole number", "levels", "name", "no lobes", "lobes", "coefficients", "profile"],
)
def test_models_that_later_commands_would_stumble_on(stored, changes, message):
    with pytest.raises(dsbrdf.ModelFormatError, match=message):
        dsbrdf.load(stored(**changes))


def test_the_widest_model_that_loads_is_finite(stored):
    """What passes the limits can be evaluated, sampled, checked and shown."""
    lobes = {k: [[0.0], [0.0]] for k in ("scale", "gamma", "beta", "falloff")}
    lobes |= {"scale": [[6.5], [-1000.0]], "gamma": [[-30.0], [30.0]], "beta": [[20.0], [-20.0]]}
    lobes |= {"falloff": [[-0.9], [20.0]], "colour": [[[0.0], [100.0]]]}
    model = dsbrdf.load(stored(lobes=lobes, channels=["a"]))
    rng = np.random.default_rng(1)
    w = rng.normal(size=(2, 500, 3))
    w[..., 2] = np.abs(w[..., 2])
    wi, wo = w / np.linalg.norm(w, axis=-1, keepdims=True)
    assert np.isfinite(model.eval(wi, wo)).all()
    assert np.isfinite(model.pdf(wi, wo)).all()
    assert np.isfinite(model.sample(wo, rng)).all()
    assert np.isfinite(model.albedo([0.0, 1.0])).all()


def test_a_library_refuses_the_same(tmp_path):
    model = smooth_model(1, name="a")
    wide = model.replace(lobes=model.lobes.replace(beta=np.full_like(model.lobes.beta, 1e6)))
    library.write(tmp_path / "x.dsbrdf", [wide])
    with pytest.raises(library.LibraryFormatError, match="'beta' must be"):
        library.open(tmp_path / "x.dsbrdf").load("a")


def test_spaces(tmp_path):
    build_space([smooth_model(i) for i in range(3)]).save(tmp_path / "space.npz")
    with np.load(tmp_path / "space.npz") as file:
        arrays = dict(file)
    arrays["curves"][0, 0, 0] = 1e300
    np.savez(tmp_path / "space.npz", **arrays)
    with pytest.raises(SpaceFormatError, match="curves must be finite float64 numbers within"):
        load_space(tmp_path / "space.npz")


def test_the_memory_of_channels_is_linear():
    """Ten times the channels take no more than ten times the memory, and a little: observations, values, files."""

    def peak(n):
        wi = np.tile([0.0, 0.6, 0.8], (50, 1))
        model = smooth_model(1, n_channels=n)
        tracemalloc.start()
        values = model.eval(wi, wi)
        Observations.of(Samples(wi, wi, values))
        loads(dumps(model))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(300)
    assert peak(3000) < 12 * peak(300)


@pytest.mark.parametrize("name", ["(" * 30_000, "[deg]" * 6000, "a_" * 15_000, " /" * 15_000])
def test_long_names_of_columns(name):
    """To look for a unit in them would take hours."""
    assert meaning(name).kind in ("other", "unknown")


def test_text_of_too_many_columns(tmp_path):
    names = ",".join(
        ["theta_i_deg", "theta_o_deg", "phi_o_deg", *(f"{400 + 0.01 * i:.2f}nm" for i in range(20_000))]
    )
    path = tmp_path / "wide.csv"
    path.write_text(f"{names}\n" + ",".join(["1"] * 20_003) + "\n")
    with pytest.raises(ValueError, match=r"columns|channels"):
        dsbrdf.read(path)
