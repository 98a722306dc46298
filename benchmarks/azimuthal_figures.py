"""Draws the pictures of docs/azimuthal.md.

    python benchmarks/azimuthal_figures.py OUT MERL RGL

OUT is the folder they are written to (docs/images). MERL and RGL are as in azimuthal_forms.py, which reads
and fits the materials. Needs matplotlib.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from azimuthal_forms import (
    BASE,
    CHOSEN,
    FORMS,
    INGREDIENTS,
    Samples,
    fit_form,
    merl_samples,
    modulation,
    read_all,
    rgl_samples,
)
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from dsbrdf.measured.reflectance import ggx
from dsbrdf.paper import metrics
from dsbrdf.paper.slice_fit import fit_profiles

BLUE, ORANGE, GREEN, PINK, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#777777"
BROWN = "#8a3c00"
N_LOBES = 3
DPI = 110
STYLE = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
}


@dataclass(frozen=True)
class Slice:
    """A slice of a material to draw, the nearest to theta_d; angles in degrees, green channel."""

    samples: Samples
    title: str
    theta_d: float
    largest_theta_h: float
    ticks: tuple[float, ...]
    #: What the samples are called.
    kind: str


def draw_slice(ax: Axes, what: Slice) -> None:
    """Samples in and across the plane of incidence, and the fits with and without beta."""
    samples = what.samples
    i = int(np.argmin(np.abs(np.degrees(samples.theta_d) - what.theta_d)))
    theta_h = np.degrees(samples.theta_h)
    values = samples.values[i, 1]
    valid = np.isfinite(values).all(-1) & (theta_h <= what.largest_theta_h)
    for phi_d, colour in ((0, BLUE), (90, ORANGE)):
        j = int(np.argmin(np.abs(np.degrees(samples.phi_d) - phi_d)))
        label = f"{what.kind}, φd = {phi_d}°"
        ax.plot(theta_h[valid], values[valid, j], "o", ms=3, mfc="none", mec=colour, mew=0.8, label=label)

    fine = np.linspace(np.deg2rad(0.5), np.deg2rad(theta_h[valid].max()), 300)
    rows = np.tile(fine, (len(samples.theta_d), 1))
    plain, _ = fit_profiles(samples.profiles(), N_LOBES)
    full, _ = fit_profiles(samples.profiles(), N_LOBES, azimuthal=True)
    mean = metrics.profile_model(rows, samples.theta_d, *plain)[0][i, 1]
    a, b = (x[i, 1] for x in metrics.profile_model(rows, samples.theta_d, *full))
    ax.plot(np.degrees(fine), mean, color=GREY, lw=1.4, ls="--", label="fit, β = 0")
    ax.plot(np.degrees(fine), a + b, color=BLUE, lw=1.4, label="fit with β, φd = 0°")
    ax.plot(np.degrees(fine), a - b, color=ORANGE, lw=1.4, label="fit with β, φd = 90°")
    ax.set(yscale="log", xlabel="θh (degrees)", xlim=(0.0, None))
    ax.set_yticks(what.ticks, [f"{tick:g}" for tick in what.ticks])
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_title(f"{what.title}, θd = {np.degrees(samples.theta_d[i]):.3g}°", fontsize=9)
    ax.legend()


def draw_what(path: Path, merl: Path, rgl: Path) -> None:
    """One slice with beta < 0 and one with beta > 0."""
    paint, teflon = rgl_samples(rgl / "aurora_white_rgb.bsdf"), merl_samples(merl / "teflon.binary")
    slices = (
        Slice(paint, "aurora_white (RGL)", 45.0, 30.0, (0.1, 0.2, 0.5, 1, 2, 5), "measured"),
        Slice(teflon, "teflon (NBRDF-decoded MERL)", 70.0, 90.0, (0.2, 0.3, 0.5, 1), "decoded"),
    )
    fig, axes = plt.subplots(1, 2, figsize=(7.6, 3.2), layout="constrained")
    for ax, what in zip(axes, slices, strict=True):
        draw_slice(ax, what)
    axes[0].set_ylabel("reflectance (1/sr)")
    fig.savefig(path, dpi=DPI)


def draw_origin(path: Path) -> None:
    """Relative amplitude of cos(2 phi_d) of closed-form reflectances at theta_d = 60 degrees."""
    theta_h = np.deg2rad(np.linspace(0.2, 29.5, 120))
    bare = partial(ggx, masking=False, foreshortening=False)
    aperture = INGREDIENTS["D alone, alpha 0.05, seen through 1 degree"]
    curves = (
        ("1 / (cos θi cos θo) alone", partial(ggx, alpha=0.1, masking=False), ORANGE, "-"),
        ("GGX with masking, α = 0.1", partial(ggx, alpha=0.1), PINK, "-"),
        ("GGX with masking, α = 0.3", partial(ggx, alpha=0.3), PINK, "--"),
        ("glossy plastic", INGREDIENTS["glossy plastic: base, coat, GGX alpha 0.1"], "black", "-"),
        ("Fresnel, D: none", partial(bare, alpha=0.1, fresnel=1.5), GREY, "-"),
        ("masking alone, α = 0.3", partial(ggx, alpha=0.3, foreshortening=False), BLUE, "--"),
        ("base under a coat", BASE, GREEN, "-"),
        ("narrow lobe seen through 1°", aperture, BLUE, ":"),
    )
    fig, ax = plt.subplots(figsize=(6.6, 3.4), layout="constrained")
    for name, reflectance, colour, style in curves:
        ratio = modulation(reflectance, theta_h, np.deg2rad(60.0))
        ax.plot(np.degrees(theta_h), ratio, color=colour, ls=style, lw=1.5, label=name)
    ax.set(xlabel="θh (degrees)", ylabel="amplitude of cos 2φd / mean", xlim=(0, 29), ylim=(-0.5, 0.8))
    ax.set_title("θd = 60°", fontsize=9)
    fig.legend(loc="outside right center")
    fig.savefig(path, dpi=DPI)


def draw_materials(path: Path, merl: Path, rgl: Path) -> None:
    """Error with beta against error without, a point a material."""
    errors: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    names = []
    for is_rgl, samples in read_all(merl, rgl, 1):
        moments = samples.moments(2)
        without, with_beta = (fit_form(samples, moments, N_LOBES, form) for form in (None, FORMS[CHOSEN]))
        errors[is_rgl].append((without.error, with_beta.error))
        names += [samples.name] if is_rgl else []
    fig, ax = plt.subplots(figsize=(4.8, 4.4), layout="constrained")
    limits = (2e-3, 1.0)
    ax.plot(limits, limits, color=GREY, lw=0.8)
    ax.text(0.0034, 0.0041, "no change", color=GREY, fontsize=8, rotation=45)
    label = f"{len(errors[False])} NBRDF-decoded MERL"
    ax.plot(*np.transpose(errors[False]), "o", ms=3.5, mfc="none", mec=BLUE, label=label)
    ax.plot(*np.transpose(errors[True]), "s", ms=5, color=ORANGE, label=f"{len(names)} RGL measurements")
    offsets = {"cc_ibiza_sunset": (6, -2), "irid_flake_paint1": (16, -30)}
    offsets |= {"chm_orange": (-26, -12), "vch_silk_blue": (-18, -12)}
    for name, point in zip(names, errors[True], strict=True):
        ax.annotate(
            name,
            point,
            xytext=offsets.get(name, (6, -3)),
            textcoords="offset points",
            fontsize=6.5,
            color=BROWN,
            arrowprops={"arrowstyle": "-", "color": BROWN, "lw": 0.5} if name.startswith("irid") else None,
        )
    ax.set(xscale="log", yscale="log", xlim=limits, ylim=limits, aspect="equal")
    ax.set(xlabel="relative RMS without β (K = 3)", ylabel="relative RMS with β (K = 3)")
    ax.legend(loc="upper left")
    fig.savefig(path, dpi=DPI)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of the azimuthal term.")
    parser.add_argument("out", type=Path, help="folder to write to")
    parser.add_argument("merl", type=Path, help="folder of MERL tables (.binary)")
    parser.add_argument("rgl", type=Path, help="folder of RGL measurements (.bsdf)")
    args = parser.parse_args()
    mpl.use("Agg")
    plt.rcParams.update(STYLE)
    draw_what(args.out / "azimuthal-what.png", args.merl, args.rgl)
    draw_origin(args.out / "azimuthal-origin.png")
    draw_materials(args.out / "azimuthal-materials.png", args.merl, args.rgl)


if __name__ == "__main__":
    main()
