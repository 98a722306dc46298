"""`dsbrdf photo`."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf.cli._app import Force, State, app, check_folder, check_output, missing_plots, note, tell

UNKNOWN = "unknown"
#: Endings of environment maps.
MAPS = (".exr", ".hdr", ".npy")


class CameraKind(StrEnum):
    """Cameras."""

    orthographic = "orthographic"
    perspective = "perspective"


class Exposure(StrEnum):
    """Whether the exposure is known."""

    known = "known"
    unknown = "unknown"


@app.command()
def photo(
    context: typer.Context,
    pictures: Annotated[
        list[Path],
        typer.Argument(
            metavar="PICTURE|FOLDER",
            help="Pictures of one object: linear EXR or HDR, or PNG; or a folder in the layout of DiLiGenT.",
            show_default=False,
        ),
    ],
    light: Annotated[
        str,
        typer.Option(
            metavar="MAP|LIST|unknown",
            help="An environment map (.exr, .hdr, .npy); a list of distant lights, one a picture (.csv: x, y, z, "
            "and r, g, b if not 1); or unknown.",
            show_default=False,
        ),
    ] = "",
    normals: Annotated[
        str, typer.Option(metavar="FILE|sphere", help="Normals of the pixels (.exr, .npy, .png), or sphere.")
    ] = "sphere",
    mask: Annotated[
        Path | None, typer.Option(metavar="FILE", help="White where the object is.", show_default=False)
    ] = None,
    camera: Annotated[CameraKind, typer.Option(help="How it sees.")] = CameraKind.orthographic,
    fov: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Angle of view of a perspective camera, over the shorter side.",
            show_default=False,
        ),
    ] = None,
    exposure: Annotated[
        Exposure, typer.Option(help="unknown: find a factor a channel too.")
    ] = Exposure.known,
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="SPACE",
            help="A space of 'dsbrdf space build', for the built-in library.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The model.")] = Path("model.json"),
    light_out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the light that was found as EXR.", show_default=False),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a .png of picture, model's picture, residual, material and light.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Find the reflectance of an object of known shape in pictures, in a known light or an unknown one."""
    from dsbrdf import images
    from dsbrdf.cli import _report as report
    from dsbrdf.images import sources
    from dsbrdf.model import energy

    if compare is not None and (missing := missing_plots()):
        raise ModuleNotFoundError(missing)
    given = [
        *pictures,
        *([mask] if mask else []),
        *(Path(p) for p in (light, normals) if p not in ("", UNKNOWN, "sphere")),
    ]
    for path in (out, light_out, compare):
        if path is not None:
            check_output(path, given, force=force)
            check_folder(path.parent)
    if light_out is not None and light != UNKNOWN and Path(light).suffix.lower() not in MAPS:
        raise typer.BadParameter("only an environment map can be written.", param_hint="'--light-out'")
    state: State = context.obj
    state.begin(str(pictures[0]))
    options: dict[str, Any] = {
        "camera": camera.value,
        "fov": None if fov is None else math.radians(fov),
        "exposure": exposure.value,
    }
    if prior is not None:
        from dsbrdf.space import load_space

        options["prior"] = load_space(prior)
    shown: Any = list(pictures)
    shape: Any = normals if normals == "sphere" else None
    if len(pictures) == 1 and pictures[0].is_dir():
        stack = sources.read_stack(pictures[0])
        shown, shape, lights = stack.images, stack.normals, stack.lights
        options |= {"mask": stack.mask, "exposure": Exposure.unknown.value}
    else:
        if not light:
            raise typer.BadParameter("give a map, a list of lights, or unknown.", param_hint="'--light'")
        lights = _lights(light, len(pictures))
        shape = shape or sources.read_normals(normals)
        options["mask"] = None if mask is None else sources.read_mask(mask)
    with report.progress(3) as step:
        found = images.fit_image(shown, shape, lights, step=state.announce(step), **options)
        step("files")
        state.begin(str(pictures[0]))
        found.model.save(out)
        if light_out is not None:
            found.write_light(light_out)
        if compare is not None:
            from dsbrdf import plot
            from dsbrdf.render import photo as sheets

            plot.write_figure(sheets.sheet(found), compare)
    if not found.is_up_to_scale and (bright := energy.warning([found.model])):
        note(bright)
    tell(found.summary)
    for path in (out, light_out, compare):
        if path is not None:
            tell(path)


def _lights(light: str, n: int) -> Any:
    from dsbrdf.images import Light, sources

    if light == UNKNOWN:
        return UNKNOWN
    if Path(light).suffix.lower() in MAPS:
        return Light.from_map(light)
    lights = sources.read_lights(light)
    if n == 1 and len(lights) > 1:
        import numpy as np

        return Light.distant(
            *(np.concatenate([getattr(one, part) for one in lights]) for part in ("direction", "flux"))
        )
    if len(lights) not in (1, n):
        raise typer.BadParameter(
            f"{light} holds {len(lights)} lights for {n} pictures: give one a picture, or one.",
            param_hint="'--light'",
        )
    return lights if len(lights) == n else lights[0]
