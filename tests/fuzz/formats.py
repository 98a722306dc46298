"""Small valid files of every format, and what a reader may make of a file: for the fuzz tests and the long run."""

import io
import json
import struct
import tempfile
import warnings
from pathlib import Path

import numpy as np

from dsbrdf import DSBRDF, Lobes, Samples, library, load, read
from dsbrdf.batch.record import FORMAT, HEADS, SCHEMA, _read_record
from dsbrdf.batch.texels import TexelMaps, load_texels
from dsbrdf.images import Light, sources
from dsbrdf.measured.formats import nbrdf, utia
from dsbrdf.measured.formats.image_file import read_pixels
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.measured.formats.tensor_file import write_tensor_file
from dsbrdf.measured.profile import MeasuredProfile
from dsbrdf.measured.samples import ReadWarning
from dsbrdf.model.file import dumps
from dsbrdf.space import Sizes, build_space, load_space

#: What a reader may raise.
CLEAN = (ValueError, OSError)
UP = np.tile([0.0, 0.0, 1.0], (3, 1))
MERL_BYTES = 12 + 3 * 90 * 90 * 180 * 8
#: Bytes of files of one size, of which only the head is written.
WHOLE = {"merl": MERL_BYTES, "utia": utia.N_BYTES}


def text_file():
    return b"theta_i_deg,theta_o_deg,phi_o_deg,r,g,b\n10,20,180,1,2,3\n-5.5,60,1e1,0.5,nan,1e-3\n"


SHEET = """Instrument;GX-1
% exported °
theta_i [°];theta_r [°];phi_r [°];wavelength;BRDF;u_BRDF
deg;deg;deg;nm;1/sr;1/sr
30;45;180;450;0,2;0,01
30;45;180;650;"0,3";0,01
30;-5,5;0;450;NA;1.#QNAN
60;0;0;650;1,0D-01;0,01

Ende der Messung
"""
BIRD = {
    "metadata": {"type": "measured"},
    "data": {
        "theta_i": {"unit": "deg", "values": [30, 30]},
        "phi_i": {"unit": "deg", "values": [0, 0]},
        "theta_r": {"unit": "rad", "values": [0.5, 0.1]},
        "phi_r": {"unit": "deg", "values": [180, 0]},
        "BRDF": {"unit": "sr^-1", "values": [1.2, 0.2], "uncertainty": {"value": 5, "unit": "%"}},
        "wavelength_i": {"unit": "nm", "values": [650, 450]},
        "polarization_i": {"values": ["u", "u"]},
    },
}
ZEMAX = """Source Measured
Symmetry PlaneSymmetrical
SpectralContent Monochrome
ScatterType BRDF
SampleRotation 1
0
AngleOfIncidence 2
0 30
ScatterAzimuth 2
0 180
ScatterRadial 2
0 30
Monochrome
DataBegin
TIS 0.5
1 2
1 2
TIS 0.4
9 4
9 6
DataEnd
"""
SSDD = """VERSION 0.2
DATA_TYPE brdf
COLOR_MODEL rgb
PARAM_TYPE half_difference_coordinate_system
PARAM0_LIST 0 10
PARAM2_LIST 30
PARAM3_LIST 0
DATA ascii
1 1 1
2 2 2
"""
DDR = """;; by hand
TypeSym ASymmetrical
TypeData Luminance Absolute
sigma 1
30
phi 1
0
theta 2
0 30
bw
kbdf
0.5
def
2 4
"""


def alta_binary():
    head = "#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n#PARAM_OUT INV_STERADIAN\n"
    head += "#FORMAT binary\n#SAMPLE_COUNT 2\n#BEGIN_STREAM\n"
    return head.encode() + np.linspace(0.1, 0.8, 8).astype("<f8").tobytes() + b"\n#END_STREAM\n"


def matlab():
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {"theta_i_deg": [30.0, 30.0], "theta_o_deg": [-30.0, 0.0], "brdf": [1.2, 0.2]})
    return file.getvalue()


def _npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def npz_samples():
    return _npz(wi=UP, wo=UP, values=np.ones((3, 2)), weights=np.ones(3), name=np.array("x"))


def npz_table():
    angles = {name: np.array([0.1, 0.5]) for name in ("theta_h", "theta_d", "phi_d")}
    return _npz(values=np.ones((2, 2, 2, 1)), convention=np.array("edge"), **angles)


def npy_array(shape=(3, 4), dtype=float):
    file = io.BytesIO()
    np.save(file, np.ones(shape, dtype))
    return file.getvalue()


def rgl():
    fields = {
        "description": np.frombuffer(b"made up", np.uint8),
        "phi_i": np.zeros(1, "f4"),
        "theta_i": np.array([0.0, 1.5], "f4"),
        "sigma": np.ones((2, 2), "f4"),
        "ndf": np.ones((2, 2), "f4"),
        "vndf": np.ones((1, 2, 2, 2), "f4"),
        "rgb": np.ones((1, 2, 3, 2, 2), "f4"),
        "jacobian": np.ones(1, "u1"),
    }
    return _written("a.bsdf", lambda path: write_tensor_file(path, fields))


def keras():
    import h5py

    def write(path):
        with h5py.File(path, "w") as file:
            for name, shape in (("a", (6, 3)), ("b", (3, 3)), ("c", (3, 3))):
                file[f"{name}/kernel"], file[f"{name}/bias"] = np.ones(shape, "f4"), np.ones(shape[1], "f4")

    return _written("a.h5", write)


def hdf5_table():
    import h5py

    def write(path):
        with h5py.File(path, "w") as file:
            file["theta_i_deg"], file["theta_o_deg"] = np.array([30.0, 30.0]), np.array([-30.0, 0.0])
            file.create_dataset("brdf", data=np.array([1.2, 0.2]), compression="gzip")

    return _written("a.h5", write)


def model():
    return _written("a.json", made_up().save)


def library_file():
    return _written("a.dsbrdf", lambda path: library.write(path, [made_up().replace(name=n) for n in "ab"]))


def space_file():
    models = [made_up(0.1 * i).replace(name=str(i)) for i in range(3)]
    return _written("a.npz", build_space(models).save)


def texels_file():
    # Two lobes: 3 + 2 + 2 + 1 numbers of shape, and one of colour, as in the standard curves of textures
    sizes = (3, 2, 2, 1, 1)
    unknowns, flat = np.full((2, 3, 2 * 8 + 3 * 2), 0.1, "f4"), np.full((2, 3), 0.1, "f4")
    maps = TexelMaps(unknowns, flat, flat, 2, Sizes(*sizes), ("r", "g", "b"))
    return _written("a.npz", maps.save)


def record():
    model = made_up()
    summary = dict.fromkeys(HEADS, 1) | {"name": "a"}
    entry = {"name": "a", "options": {}, "summary": summary, "status": "ok", "model_sha256": "0" * 64}
    entry["source"] = {"file": "a.csv", "size": 3, "stamp": 4, "is_table": True, "sha256": model.name}
    head = {"format": FORMAT, "schema": SCHEMA}
    return "".join(json.dumps(row) + "\n" for row in (head, entry, entry | {"name": "b"})).encode()


def normals_matlab():
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {"Normal_gt": np.ones((2, 2, 3))}, do_compression=True)
    return file.getvalue()


ASTM = """VERSION 1
LAMBDA 550
VARS theta_i, phi_i, theta_s, phi_s, BRDF
0.5,0,0.5,3.14,1.2
0.5,0,-0.1,0,1e-3
"""


def radiance():
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n" + bytes(range(100, 124))


def made_up(more=0.0):
    lobes = Lobes(
        np.linspace(-1.0, 1.0 + more, 6).reshape(2, 3),
        np.array([[0.0, 1.0], [4.0, 5.0 - more]]),
        np.array([[0.1], [-0.2]]),
        np.zeros((2, 1)),
        np.linspace(-0.2, 0.2, 6).reshape(3, 2, 1),
    )
    profile = MeasuredProfile(
        np.array([0.1, 0.8]), np.full((2, 4), 0.3), np.ones((2, 3, 4)), np.zeros((2, 3, 4))
    )
    return DSBRDF(lobes, name="made up", errors={"rel": 0.1, "albedo": np.nan}, profile=profile)


def image(name, dtype):
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    return _written(name, lambda path: mi.Bitmap(np.ones((3, 4, 3), dtype)).write(str(path)))


def _written(name, write):
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


#: By name: the content of a valid file. That of MERL is the head of one.
VALID = {
    "merl": lambda: struct.pack("<3i", 90, 90, 180) + np.full(100, 0.5).tobytes(),
    "rgl": rgl,
    "text": text_file,
    "sheet": lambda: SHEET.encode("latin-1"),
    "sheet utf-16": lambda: SHEET.encode("utf-16"),
    "bird": lambda: json.dumps(BIRD).encode(),
    "zemax": lambda: ZEMAX.encode(),
    "ssdd": lambda: SSDD.encode(),
    "ddr": lambda: DDR.encode(),
    "alta": lambda: (
        b"#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n#PARAM_OUT INV_STERADIAN\n0.1 0.2 0.3 1\n0.5 0.4 2 4\n"
    ),
    "alta binary": alta_binary,
    "pbrt": lambda: b"# plate\n2\n450 650\n0.5 0 0.5 3.14 1 2\n0.5 0 0.1 0 0.3 0.2\n",
    "matlab": matlab,
    "npz samples": npz_samples,
    "npz table": npz_table,
    "npy": npy_array,
    "npy weights": lambda: npy_array((6, 3), "f4"),
    "keras": keras,
    "exr": lambda: image("a.exr", np.float32),
    "png": lambda: image("a.png", np.uint8),
    "hdf5": hdf5_table,
    "picture": radiance,
    "lights": lambda: b"x y z r g b\n0 0 1 1 1 1\n0.5,0,1,2,2,2\n",
    "normals": lambda: npy_array((2, 2, 3)),
    "model": model,
    "library": library_file,
    "space": space_file,
    "astm": lambda: ASTM.encode(),
    "utia": lambda: np.full(100, 0.5).tobytes(),
    "light map": lambda: image("a.exr", np.float32),
    "mask": lambda: image("a.png", np.uint8),
    "normals .mat": normals_matlab,
    "library name": library_file,
    "texels": texels_file,
    "record": record,
}


#: Those that are not `read`, or would tabulate what they read, which takes seconds.
READERS = {
    "model": load,
    "rgl": read_rgl,
    "keras": nbrdf.read_weights,
    "npy weights": nbrdf.read_weights,
    "library": lambda path: [
        content.load(name) for content in [library.open(path)] for name in content.names
    ],
    "space": lambda path: [load_space(path).material(name) for name in load_space(path).names[:1]],
    "picture": read_pixels,
    "lights": sources.read_lights,
    "normals": sources.read_normals,
    "light map": Light.from_map,
    "mask": sources.read_mask,
    "normals .mat": lambda path: sources._ground_truth(path.parent, (2, 2)),
    "library name": lambda path: [library.model_named(f"{path}/{name}") for name in "ab"],
    "texels": load_texels,
    "record": _read_record,
}
#: A direction toward the light, and two toward the viewer.
WI, WO = np.array([0.6, 0.0, 0.8]), np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0]])


def place(kind, folder, content):
    """Write a file of some kind, and what belongs to it; its path."""
    if kind == "npy weights":
        for part, shape in zip(nbrdf.PARTS, [(6, 3), (3,)] + 2 * [(3, 3), (3,)], strict=True):
            np.save(folder / f"x_{part}.npy", np.ones(shape, "f4"))
    names = {
        "npy weights": "x_fc1.npy",
        "merl": "x.binary",
        "normals": "x.npy",
        "normals .mat": "Normal_gt.mat",
        "library name": "x.dsbrdf",
    }
    path = folder / names.get(kind, "x")
    path.write_bytes(content)
    if kind in WHOLE and len(content) > 400:
        # A sparse file: what is not written reads as zero
        with path.open("r+b") as file:
            file.truncate(WHOLE[kind])
    return path


def sound(kind, path):
    """Read a file: it is refused with a reason (False), or makes sense (True)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ReadWarning)
            content = READERS.get(kind, read)(path)
    except CLEAN as error:
        if not str(error):
            raise
        return False
    if kind in ("model", "library", "library name", "space"):
        for made in [content] if kind == "model" else content:
            assert np.isfinite(made.eval(WI, WO)).all()
            assert json.loads(dumps(made))["format"]
    elif kind in ("picture", "normals"):
        assert content.ndim == 3
    elif kind == "mask":
        assert content.dtype == bool
    elif kind == "normals .mat":
        assert np.isfinite(content).all()
    elif kind == "light map":
        assert np.isfinite(content.flux).all()
    elif kind == "texels":
        assert content[0, 0].lobes.n_channels == len(content.channels)
        assert content.albedo().shape == (*content.shape, content.n_channels)
    elif kind == "record":
        assert all(isinstance(entry["status"], str) for entry in content.values())
    elif kind == "lights":
        assert all(np.isfinite(light.direction).all() for light in content)
    elif kind == "merl":
        # Mapped: its numbers are not read
        assert content.planes.nbytes == MERL_BYTES - 12
    elif kind in ("keras", "npy weights"):
        assert all(np.isfinite(array).all() for array in content[1])
    elif kind == "rgl":
        assert np.isfinite(content.eval(WI, WO)).all()
    else:
        if isinstance(content, Samples):
            assert np.isfinite(content.wi).all()
            assert np.isfinite(content.wo).all()
        values = content.values if isinstance(content, Samples) else content.rows([0])
        assert not (values < 0.0).any() or (isinstance(content, Samples) and content.weights is not None)
        assert not np.isinf(values).any()
    return True
