"""Names of columns and what they mean: the one place where a name becomes an angle, a channel or an uncertainty."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Meaning", "column_names", "meaning", "unit_of", "wavelength_name"]

#: Names of channels that can be part of a header.
COLUMN = re.compile(r"\w[\w.]*")

_GREEK = {
    **dict.fromkeys("θϑΘ", "theta"),
    **dict.fromkeys("φϕΦ", "phi"),
    **dict.fromkeys("λΛ", "lambda"),
    **dict.fromkeys("σΣ", "sigma"),
    **dict.fromkeys("ΔδΔ∆", "delta"),
    **dict.fromkeys("µμ", "u"),
    "°": "deg",
    "º": "deg",
    "−": "-",
    "⋅": "*",
    "×": "*",
}
_UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees", "degs", "d"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("nm", "nanometer", "nanometre", "nanometers", "nanometres"), "nm"),
    **dict.fromkeys(("um", "micron", "microns", "micrometer", "micrometre", "micrometers"), "um"),
    **dict.fromkeys(("%", "percent", "pct"), "percent"),
    **dict.fromkeys(("", "1", "-", "1/sr", "sr-1", "sr^-1", "sr^(-1)", "/sr", "persr", "persteradian",
        "1/steradian"), ""),
}  # fmt: skip
_THETA = ("theta", "zenith", "polar", "polarangle", "zenithangle", "th")
_PHI = ("phi", "azimuth", "azimuthangle", "azim", "az", "ph")
_IN = ("i", "in", "inc", "incident", "incidence", "incoming", "illumination", "illum", "light", "l", "source",
       "sun", "solar", "irradiation")  # fmt: skip
_OUT = ("o", "out", "outgoing", "r", "ref", "refl", "reflected", "reflection", "s", "sc", "scat", "scatter",
        "scattered",
        "v", "view", "viewing", "viewer", "obs", "observer", "observation", "det", "detector", "detection", "sensor",
        "receiver", "e", "exit", "exitant", "emergent", "emission")  # fmt: skip


def _sides(stems: tuple[str, ...], sides: tuple[str, ...]) -> set[str]:
    both = {stem + side for stem in stems for side in sides}
    return both | {side + stem for stem in stems for side in sides if len(side) > 1}


#: Angles, by their names without separators.
_ANGLES: dict[str, str] = {
    **dict.fromkeys(_sides(_THETA, _IN), "theta_i"),
    **dict.fromkeys(_sides(_THETA, _OUT), "theta_o"),
    **dict.fromkeys(_sides(_PHI, _IN), "phi_i"),
    **dict.fromkeys(_sides(_PHI, _OUT), "phi_o"),
    **dict.fromkeys(("aoi", "angleofincidence", "incidentangle", "incidenceangle", "sza", "lightangle",
                     "illuminationangle"), "theta_i"),
    **dict.fromkeys(("viewangle", "viewingangle", "detectorangle", "observationangle", "reflectionangle", "vza",
                     "detectionangle", "receiverangle"), "theta_o"),
    "saa": "phi_i",
    "vaa": "phi_o",
    **dict.fromkeys(("phi", "dphi", "deltaphi", "phirel", "relphi", "relativephi", "relativeazimuth", "relazimuth",
                     "relaz", "raa", "azimuth", "deltaazimuth", "azimuthdifference", "relativeazimuthangle",
                     "phirelative"), "phi"),
    **dict.fromkeys(("thetah", "thetahalf", "halftheta"), "theta_h"),
    **dict.fromkeys(("thetad", "thetadiff", "thetadifference"), "theta_d"),
    **dict.fromkeys(("phid", "phidiff", "phidifference"), "phi_d"),
    **dict.fromkeys(("phih", "phihalf", "halfphi"), "phi_h"),
    **dict.fromkeys(("aspecular", "aspecularangle", "asp", "gammaas"), "aspecular"),
}  # fmt: skip
_VECTORS = {
    **{side + axis: f"wi_{axis}" for side in ("wi", "i", "l", "in", "light", "omegai", "incident") for axis in "xyz"},
    **{side + axis: f"wo_{axis}" for side in ("wo", "o", "v", "out", "view", "omegao") for axis in "xyz"},
}  # fmt: skip
_COLOURS = {"r": "r", "g": "g", "b": "b", "red": "r", "green": "g", "blue": "b"}
_TRISTIMULUS = {"x": "X", "y": "Y", "z": "Z", "tristimulusx": "X", "tristimulusy": "Y", "tristimulusz": "Z"}
_VALUE = ("value", "values", "val", "brdf", "bsdf", "bxdf", "f", "fr")
_SPREAD = ("std", "stdev", "stddev", "sd", "sigma", "u", "unc", "uncertainty", "err", "error", "standarddeviation",
           "standarduncertainty", "stdunc", "dev", "stderr")  # fmt: skip
_INDEX = ("", "index", "idx", "id", "no", "nr", "n", "num", "number", "row", "line", "point", "#", "count", "counter",
          "sample", "i", "k", "rownumber", "pointno", "unnamed:0", "level0")  # fmt: skip
_FACTOR = ("reflectance", "refl", "reflectancefactor", "rho", "brf", "hcrf", "hdrf", "radiancefactor",
        "bidirectionalreflectancefactor",
           "rf", "pibrdf", "br", "reflectivity")  # fmt: skip
_COSINE = ("ccbrdf", "ccbsdf", "brdfcos", "bsdfcos", "fcos", "frcos", "cosbrdf", "brdf*cos", "f*cos",
        "bsdf*cos", "brdfcosine",
           "cosinecorrectedbrdf", "brdf*cos(theta)", "brdf*costheta", "valuecos")  # fmt: skip
_TRANSMITTED = ("btdf", "transmittance", "transmission", "transmitted", "fbtdf")
_OTHER = ("temperature", "temp", "humidity", "pressure", "time", "date", "timestamp", "seconds", "duration",
        "dark", "darkcurrent",
          "raw", "signal", "voltage", "current", "gain", "exposure", "integrationtime", "comment", "name",
              "polarisation",
          "polarization", "pol", "intensity", "radiance", "irradiance", "power", "flux")  # fmt: skip
_WAVE = (
    "wavelength",
    "wavelengths",
    "lambda",
    "wl",
    "nm",
    "wave",
    "wvl",
    "wlen",
    "wavelengthnm",
    "wavelengthum",
)
_BRACKETS = re.compile(r"(.*?)[\s_]*[\[({<]\s*(.*?)\s*[\])}>]\s*")
_SLASHED = re.compile(r"(.*?)\s*/\s*(deg|degrees?|rad|radians?|nm|um|%)", re.IGNORECASE)
_SUFFIX = re.compile(r"(.+?)[\s_.,-]+(deg|degrees?|rad|radians?|nm|um|percent|pct|%)", re.IGNORECASE)
_WAVELENGTH = re.compile(
    r"(?:value|brdf|bsdf|f|fr|lambda|wl|wavelength|w|l|nm)?[\s_]*(\d{3,4}(?:\.\d+)?|\d?\.\d+)[\s_]*(nm|um)?"
)
_EXPLICIT = re.compile(r"value[:_](?=\S)(.*)", re.IGNORECASE)
_NM = (100.0, 20000.0)
#: A longer name is none with a unit; to look for one takes the cube of its length.
MOST_LETTERS = 120


@dataclass(frozen=True)
class Meaning:
    """What a column holds.

    Parameters
    ----------
    kind : str
        "angle", "vector", "channel", "wavelength", "std", "weight", "index"; or why it is no channel: "factor"
        (pi times the BRDF), "cosine" (times the cosine), "transmitted", "other", "unknown".
    key : str
        Which angle or component, the name of the channel, or the channel that an uncertainty is of ("" for all).
    unit : str
        "deg", "rad", "nm", "um", "percent", "" if none is said, or what is said and not known.
    """

    kind: str
    key: str = ""
    unit: str = ""


def wavelength_name(nm: float) -> str:
    """Name of the channel of a wavelength in nm."""
    return f"{nm:.10g}nm"


def meaning(name: str) -> Meaning:
    """What a column of this name holds.

    Parameters
    ----------
    name : str
        As it stands in a header, with its unit as `theta_i_deg`, `theta_i [deg]`, `theta_i (deg)` or `theta_i/deg`.

    Examples
    --------
    >>> meaning("Theta_R [deg]")
    Meaning(kind='angle', key='theta_o', unit='deg')
    >>> meaning("lambda_450")
    Meaning(kind='channel', key='450nm', unit='')
    >>> meaning("temperature").kind
    'other'
    """
    text = "".join(_GREEK.get(c, c) for c in name.strip().strip("\"'\ufeff").strip())
    text = unicodedata.normalize("NFKC", text)
    if match := _EXPLICIT.fullmatch(text):
        return Meaning("channel", match[1].strip())
    for pattern in (_BRACKETS, _SLASHED, _SUFFIX) if len(text) <= MOST_LETTERS else ():
        if match := pattern.fullmatch(text):
            unit = unit_of(match[2])
            found = _of(match[1], unit)
            if found.kind != "unknown":
                return found
    found = _of(text, "")
    if found.kind == "unknown":
        # As in thetaideg
        for end in ("deg", "rad"):
            folded = _fold(text)
            if folded.endswith(end) and folded.removesuffix(end) in _ANGLES:
                return Meaning("angle", _ANGLES[folded.removesuffix(end)], end)
    return found


def unit_of(text: str) -> str:
    """A unit as `Meaning` has it; "" for one that is no other than 1/sr, and what is not known as it stands."""
    folded = re.sub(r"\s+", "", text.lower())
    return _UNITS.get(folded, folded)


def _fold(text: str) -> str:
    return re.sub(r"[\s_.\-]+", "", text.lower())


def _of(text: str, unit: str) -> Meaning:
    """Meaning of a name without its unit."""
    key = _fold(text)
    if key in _ANGLES:
        return Meaning("angle", _ANGLES[key], unit)
    if key in _VECTORS:
        return Meaning("vector", _VECTORS[key], unit)
    if key in _WAVE:
        said = "nm" if key.endswith("nm") else "um" if key.endswith("um") else ""
        return Meaning("wavelength", "", unit or said)
    if key in ("weight", "weights"):
        return Meaning("weight")
    if (spread := _spread(key)) is not None:
        return Meaning("std", spread, "relative" if "rel" in key else unit)
    if (channel := _channel(text, key, unit)) is not None:
        return Meaning("channel", channel, "" if unit in ("nm", "um") else unit)
    for kind, words in (
        ("index", _INDEX),
        ("factor", _FACTOR),
        ("cosine", _COSINE),
        ("transmitted", _TRANSMITTED),
    ):
        if key in words:
            return Meaning(kind, text.strip(), unit)
    if re.fullmatch(r"unnamed:\d+", key):
        return Meaning("index", text.strip(), unit)
    if key in _OTHER:
        return Meaning("other", text.strip(), unit)
    return Meaning("unknown", text.strip(), unit)


def _channel(text: str, key: str, unit: str) -> str | None:
    """Name of the channel, None if it is none."""
    if key in _COLOURS:
        return _COLOURS[key]
    if key in _TRISTIMULUS:
        return _TRISTIMULUS[key]
    if key in _VALUE or key in ("v", "luminance", "lum"):
        return text.strip().lower()
    for value in _VALUE:
        rest = key.removeprefix(value) if key.startswith(value) else key.removesuffix(value)
        if rest != key and (rest in _COLOURS or rest in _TRISTIMULUS):
            return {**_COLOURS, **_TRISTIMULUS}[rest]
    if (match := _WAVELENGTH.fullmatch(text.strip().lower())) is not None:
        said = match[2] or unit
        number = float(match[1])
        nm = number * 1000.0 if said == "um" or (not said and number < 20.0 and "." in match[1]) else number
        if _NM[0] <= nm <= _NM[1]:
            return wavelength_name(nm)
    return None


def _spread(key: str) -> str | None:
    """The channel that a column of this name holds the standard deviation of, "" for all; None if it holds none."""
    if key in _SPREAD or key in {f"{word}{value}" for word in _SPREAD for value in _VALUE}:
        return ""
    for word in sorted(_SPREAD, key=len, reverse=True):
        for rest in (key.removeprefix(word), key.removesuffix(word)):
            if rest != key:
                if rest in _VALUE or rest in ("rel", "relative", "luminance"):
                    return ""
                channel = _channel(rest, rest, "")
                if channel is not None and (len(word) > 2 or key.startswith("u") or len(rest) > 2):
                    return channel
    return None


def column_names(channels: Sequence[str]) -> list[str]:
    """Names of channels as those of columns, which are read as such; numbers if they cannot be."""
    unlike = len({name.lower() for name in channels}) == len(channels)
    if not unlike or not all(map(COLUMN.fullmatch, channels)):
        return [f"value_{i + 1}" for i in range(len(channels))]
    whole = {"X", "Y", "Z"} <= set(channels)
    plain = [
        meaning(name) == Meaning("channel", name) and (whole or name not in ("X", "Z")) for name in channels
    ]
    return [name if is_plain else f"value_{name}" for name, is_plain in zip(channels, plain, strict=True)]
