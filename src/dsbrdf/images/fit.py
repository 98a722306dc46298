"""`fit_image`: a picture of an object of known shape to the reflectance of what it is made of."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsbrdf._brief import Brief
from dsbrdf.fitting import uncertainty
from dsbrdf.fitting.coverage import Coverage
from dsbrdf.fitting.fit import ConvergenceWarning, PriorWarning, fit
from dsbrdf.images import coverage, distant, linear, search, unknown
from dsbrdf.images.independence import independent
from dsbrdf.images.light import Light
from dsbrdf.images.picture import Picture
from dsbrdf.images.view import Camera, Points, points
from dsbrdf.measured.formats import image_file
from dsbrdf.model.dsbrdf import DSBRDF
from dsbrdf.space import Gaussian, MaterialSpace

__all__ = ["ImageFit", "PictureWarning", "fit_image", "fit_regions", "relight"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Pixels of all pictures that are fitted, and least of each; more tell nothing that these do not.
N_PIXELS, LEAST_PIXELS = 600, 20
#: What a picture is taken to be worth, in independent pixels, on the way to the material and for it.
WAY_WORTH, WORTH = 30.0, 300.0
#: For intervals it is worth so many times less than its residuals show: what the lobes bend to, they do not show.
HIDDEN = 5.0
#: Pictures of more pixels along a side are rendered with few points of each.
FULL = 80
#: RMS of the residuals of the logarithm above which it is told that the picture is not explained.
UNEXPLAINED = 0.12


class PictureWarning(UserWarning):
    """A picture does not hold what it should, or the model does not explain it."""


@dataclass(frozen=True, eq=False, repr=False)
class ImageFit(Brief):
    """A reflectance found in pictures.

    Parameters
    ----------
    model : DSBRDF
        Up to a factor a channel, if the exposure or the light was unknown.
    light : list of Light
        Of each picture: as given, or as found.
    covariance : (unknown, unknown) ndarray
        Of the unknowns, in the order of the prior; under an unknown light that between the materials compared, of
        what a scale a channel does not change.
    n_decided : float
        How many of the unknowns the pictures decided; the prior decided the others. Under an unknown light, how many of
        the main components of the materials compared.
    n_effective : float
        Independent pixels that the pictures are worth in `covariance` and `n_decided`; see decision record 0024.
    rms : float
        RMS of the residuals of the logarithm over the pixels that were fitted.
    coverage : Coverage
        Which angles make up the pictures.
    exposure : (channel,) ndarray
        Factors that the pictures were found to be exposed with; ones if they were known.
    converged : bool
    seconds : float
    """

    model: DSBRDF
    light: list[Light]
    covariance: Array = field(repr=False)
    n_decided: float
    n_effective: float
    rms: float
    coverage: Coverage
    exposure: Array
    converged: bool
    seconds: float
    posterior: uncertainty.Posterior = field(repr=False)
    pictures: list[Picture] = field(repr=False)
    points: list[Points] = field(repr=False)

    @cached_property
    def rendered(self) -> list[Array]:
        """The pictures (height, width, channel) that the model makes; zero where there is no object."""
        return [
            self.exposure * _image(linear.rendered(self.model.lobes, seen.few, light), seen, picture.shape)
            for seen, light, picture in zip(self.points, self.light, self.pictures, strict=True)
        ]

    @property
    def residual(self) -> list[Array]:
        """Logarithms (height, width, channel) of model over picture, with an offset; NaN where nothing is fitted."""
        found = []
        for made, seen, picture in zip(self.rendered, self.points, self.pictures, strict=True):
            offset = search.OFFSET * picture.flat[seen.pixel].mean(0)
            ratio = np.arcsinh(0.5 * made / offset) - np.arcsinh(0.5 * picture.pixels / offset)
            shown = np.zeros(picture.shape, dtype=bool)
            shown.flat[seen.pixel] = True
            found.append(np.where(shown[..., None], ratio, np.nan))
        return found

    @property
    def summary(self) -> str:
        """What was found, in a few sentences."""
        parts = [
            f"{self.model.n_lobes} lobes; the picture is missed by {self.rms:.1%} (RMS of the logarithm)",
            f"it is worth {self.n_effective:.0f} independent pixels and decided {self.n_decided:.0f} of "
            f"{len(self.covariance)} numbers, the prior the others",
        ]
        if self.is_up_to_scale:
            parts.append("the model is known up to a scale a channel")
        if self.coverage.sentence:
            parts.append(self.coverage.sentence)
        return ". ".join(part[0].upper() + part[1:] for part in parts) + "."

    @property
    def is_up_to_scale(self) -> bool:
        """Whether the model is known only up to a scale a channel."""
        return self.model.fit_options.get("exposure") == "unknown"

    def write_light(self, path: str | Path) -> None:
        """Write the map of the first picture's light as OpenEXR.

        Raises
        ------
        ValueError
            If the light is no map.
        OSError
            If the file cannot be written.
        """
        if self.light[0].map is None:
            raise ValueError("the light is a list of directions, not a map: there is nothing to write.")
        image_file.write_pixels(self.light[0].map, path)

    def std(self, wi: ArrayLike, wo: ArrayLike) -> Array:
        """Standard deviations (..., channel) in 1/sr of values at pairs of directions (..., 3)."""
        return np.asarray(self.model.eval(wi, wo)) * self.posterior.deviation(wi, wo)

    def band(self, wi: ArrayLike, wo: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper bounds (..., channel) in 1/sr that hold values with this probability.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        return uncertainty.band(np.asarray(self.model.eval(wi, wo)), self.posterior.deviation(wi, wo), level)


def fit_image(
    image: Any,
    normals: Any,
    light: Any,
    *,
    mask: Any = None,
    camera: str = "orthographic",
    fov: float | None = None,
    prior: str | MaterialSpace | Gaussian = "library",
    exposure: str = "known",
    step: Callable[[str], None] = lambda _: None,
) -> ImageFit:
    """The reflectance of an object in a picture, or in several pictures, of known shape.

    Parameters
    ----------
    image : (height, width, channel) array_like or path, or a list of them
        Linear radiance; EXR, HDR and .npy files, or arrays. Of 8-bit images, and PNG files, the sRGB curve is undone.
    normals : (height, width, 3) array_like or "sphere", or a list of them
        Unit vectors in the camera's frame: x to the right, y up, z toward the camera. One for all, or one each.
    light : Light, or a list of them, or "unknown"
        One each picture, or one for all. An unknown light of one picture is found too; the model is then known up to a
        factor a channel.
    mask : (height, width) array_like of bool, or a list of them, optional
        Pixels that may be used.
    camera : {"orthographic", "perspective"}, optional
    fov : float, optional, radians
        Angle of view over the shorter side, of a perspective camera.
    prior : "library", MaterialSpace or Gaussian, optional
        What materials are like; the built-in library of materials by default.
    exposure : {"known", "unknown"}, optional
        With "unknown", a factor a channel, the same for all pictures, is found too: the model is then known up to it.
    step : callable, optional
        Told what is done next.

    Returns
    -------
    ImageFit

    Raises
    ------
    ValueError
        If shapes do not agree, no pixel shows the object, or an option is unknown.

    Warns
    -----
    PictureWarning
        If a picture has 8 bits, or the model does not explain it.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf.images import Light, fit_image, relight
    >>> lamp = Light.distant([[0.0, 0.6, 0.8], [0.9, 0.3, 0.3162]], 3.0)
    >>> picture = relight(dsbrdf.library.load("blue-acrylic"), "sphere", lamp, size=24)
    >>> found = fit_image(picture, "sphere", lamp, prior=dsbrdf.space.builtin())
    >>> found.model.n_channels
    3
    """
    begun = time.perf_counter()
    if exposure not in ("known", "unknown"):
        raise ValueError(f"'exposure' must be 'known' or 'unknown', got {exposure!r}.")
    if isinstance(light, str):
        if light != "unknown":
            raise ValueError(
                f"'light' must be a Light or 'unknown', got {light!r}. Light.from_map(path) reads a map."
            )
        return _unknown(image, normals, mask, _camera(camera, fov), prior, step)
    pictures, of_points, lights = _inputs(image, normals, light, mask, _camera(camera, fov))
    is_space = prior == "library" if isinstance(prior, str) else isinstance(prior, MaterialSpace)
    if is_space and exposure == "known" and all(map(distant.is_one_direction, lights)):
        step("reflectance")
        return _distant(pictures, of_points, lights, _space(prior), begun)
    gaussian = _gaussian(prior, pictures[0].n_channels)
    step("pictures as functions of the reflectance")
    problem = _problem(pictures, of_points, lights, gaussian, exposure == "unknown")
    step("reflectance")
    found = solve(problem)
    _warn_unexplained(_rms(found), pictures[0].name)
    return finished(problem, found, pictures, of_points, lights, time.perf_counter() - begun)


def _unknown(
    image: Any,
    normals: Any,
    mask: Any,
    camera: Camera,
    prior: str | MaterialSpace | Gaussian,
    step: Callable[[str], None],
) -> ImageFit:
    """Material and light of a picture."""
    begun = time.perf_counter()
    white = Light.distant([0.0, 0.0, 1.0])
    pictures, of_points, _ = _inputs(image, normals, white, mask, camera)
    if len(pictures) != 1:
        raise ValueError(f"an unknown light is found from one picture, got {len(pictures)}.")
    (picture,), (seen,) = pictures, of_points
    space = _space(prior)
    gaussian = _gaussian(space, picture.n_channels)
    step("material, whatever the light")
    grid = unknown.Grid(unknown.ROWS)
    # Even over the picture: many pixels of highlights would speak for mirrors
    few, many = (_even(seen, most) for most in (unknown.N_PIXELS, unknown.N_LIGHT))
    material = unknown.material(unknown.Scene(few.middles, picture.flat[few.pixel], grid), space, gaussian)
    step("light")
    scene = unknown.Scene(many.middles, picture.flat[many.pixel], grid)
    light = Light.from_map(scene.light(search.raw_lobes(material.x, gaussian)))
    problem = _problem(pictures, of_points, [light], gaussian, False)
    found = problem.at(material.x)
    _warn_unexplained(_rms(found), picture.name)
    whole = finished(problem, found, pictures, of_points, [light], time.perf_counter() - begun)
    options = {**whole.model.fit_options, "exposure": "unknown", "light": "unknown"}
    return dataclasses.replace(
        whole,
        model=whole.model.replace(fit_options=options),
        covariance=material.covariance,
        n_decided=material.n_decided,
        posterior=dataclasses.replace(whole.posterior, covariance=material.covariance),
    )


def _distant(
    pictures: list[Picture],
    of_points: list[Points],
    lights: list[Light],
    space: MaterialSpace,
    begun: float,
) -> ImageFit:
    """Material of pictures in a distant light each."""
    _check_channels(space.channels, pictures[0].n_channels)
    most = max(N_PIXELS // len(pictures), LEAST_PIXELS)
    some = [
        seen.take(chosen(picture.flat[seen.pixel], most))
        for picture, seen in zip(pictures, of_points, strict=True)
    ]
    lit = [distant.Lit.of(each, light) for each, light in zip(some, lights, strict=True)]
    samples = distant.samples(pictures, lit, space.channels)
    with warnings.catch_warnings():
        # It is told of the picture, and by `converged`
        warnings.simplefilter("ignore", PriorWarning)
        warnings.simplefilter("ignore", ConvergenceWarning)
        found = fit(samples, prior=space)
        # A pixel is a mean over its points: what that is of its middle, the last fit tells
        for _ in range(distant.ROUNDS if any(len(each.normal) > len(each.pixel) for each in some) else 0):
            samples = distant.samples(pictures, lit, space.channels, found.model)
            found = fit(samples, prior=space)
    made = np.asarray(found.model.eval(samples.wi, samples.wo))
    offset = search.OFFSET * np.nanmean(samples.values, axis=0)
    residual = np.arcsinh(0.5 * made / offset) - np.arcsinh(0.5 * samples.values / offset)
    rms = float(np.sqrt(np.nanmean(residual**2)))
    _warn_unexplained(rms, pictures[0].name)
    options = {"from": "pictures", "prior": True, "exposure": "known"}
    return ImageFit(
        found.model.replace(fit_options=options, errors={}),
        lights,
        found.posterior.covariance,
        found.n_decided,
        found.observations.n_effective,
        rms,
        found.coverage,
        np.ones(pictures[0].n_channels),
        found.converged,
        time.perf_counter() - begun,
        found.posterior,
        pictures,
        of_points,
    )


def _even(seen: Points, most: int) -> Points:
    """Some pixels, even over the picture."""
    n = len(seen.pixel)
    return seen.take(np.linspace(0, n - 1, min(n, most)).astype(int))


def _space(prior: str | MaterialSpace | Gaussian) -> MaterialSpace:
    if isinstance(prior, str) and prior == "library":
        from dsbrdf import space

        return space.builtin()
    if not isinstance(prior, MaterialSpace):
        raise TypeError(
            "an unknown light needs materials to compare: 'prior' must be 'library' or a MaterialSpace."
        )
    return prior


def fit_regions(
    image: Any, normals: Any, light: Any, labels: ArrayLike, **options: Any
) -> dict[int, ImageFit]:
    """The reflectance of each region of an object of several materials.

    Parameters
    ----------
    image, normals, light
        As of `fit_image`.
    labels : (height, width) array_like of int
        Which region a pixel belongs to; 0 is none.
    **options
        Of `fit_image`.

    Returns
    -------
    dict of int to ImageFit

    Raises
    ------
    ValueError
        As `fit_image`; if there is no region.
    """
    labels = np.asarray(labels)
    given = options.pop("mask", None)
    regions = [int(label) for label in np.unique(labels) if label != 0]
    if not regions:
        raise ValueError("'labels' must hold a region at least, a number that is not 0.")
    found = {}
    for label in regions:
        region = labels == label
        masks = [np.asarray(m, bool) & region for m in given] if isinstance(given, list) else region
        if given is not None and not isinstance(given, list):
            masks = np.asarray(given, bool) & region
        found[label] = fit_image(image, normals, light, mask=masks, **options)
    return found


def relight(
    model: DSBRDF,
    normals: Any,
    light: Light,
    *,
    size: int = 256,
    mask: Any = None,
    camera: str = "orthographic",
    fov: float | None = None,
) -> Array:
    """Picture of an object in a light, without shadows and light between its parts.

    Parameters
    ----------
    model : DSBRDF
    normals : (height, width, 3) array_like or "sphere"
    light : Light
    size : int, optional
        Pixels along a side of the picture of a sphere.
    mask, camera, fov
        As of `fit_image`.

    Returns
    -------
    (height, width, channel) ndarray
        Linear radiance; zero where there is no object.

    Raises
    ------
    ValueError
        If model and light have other channels; and as `fit_image`.

    Examples
    --------
    >>> import dsbrdf
    >>> from dsbrdf.images import Light, relight
    >>> model = dsbrdf.library.load("blue-acrylic")
    >>> relight(model, "sphere", Light.distant([[0.0, 0.6, 0.8]]), size=32).shape
    (32, 32, 3)
    """
    if model.n_channels != light.n_channels:
        raise ValueError(f"the light has {light.n_channels} channels, the model {model.n_channels}.")
    if isinstance(normals, str):
        shape = (size, size) if mask is None else np.shape(mask)
    else:
        normals = np.asarray(normals, dtype=np.float64)
        shape = normals.shape[:2]
    mask = None if mask is None else np.asarray(mask, dtype=bool)
    seen = points(normals, shape, _camera(camera, fov), mask, least_cosine=0.0)
    if min(shape) > FULL:
        seen = seen.few
    return _image(linear.rendered(model.lobes, seen, light), seen, shape)


def _camera(camera: str, fov: float | None) -> Camera:
    if camera not in ("orthographic", "perspective"):
        raise ValueError(f"'camera' must be 'orthographic' or 'perspective', got {camera!r}.")
    if (camera == "perspective") != (fov is not None):
        raise ValueError("'fov' is the angle of view, in radians, of a perspective camera, and of no other.")
    return Camera(fov)


def _image(pixels: Array, of_points: Points, shape: tuple[int, ...]) -> Array:
    """An image (height, width, channel) of some pixels (pixel, channel)."""
    image = np.zeros((shape[0] * shape[1], pixels.shape[1]))
    image[of_points.pixel] = pixels
    return image.reshape(shape[0], shape[1], -1)


def _inputs(
    image: Any, normals: Any, light: Any, mask: Any, camera: Camera
) -> tuple[list[Picture], list[Points], list[Light]]:
    """Pictures, their points and lights."""
    images = list(image) if isinstance(image, list | tuple) else [image]
    n = len(images)
    each = {}
    for name, value in (("normals", normals), ("light", light), ("mask", mask)):
        values = list(value) if isinstance(value, list | tuple) else [value] * n
        if len(values) != n:
            raise ValueError(f"'{name}' must be one, or one for each of {n} pictures, got {len(values)}.")
        each[name] = values
    if not n:
        raise ValueError("'image' must be a picture at least, got none.")
    pictures, seen = [], []
    for i, (one, normal, shown) in enumerate(zip(images, each["normals"], each["mask"], strict=True)):
        picture = Picture.of(one, f"picture {i + 1}" if n > 1 else "the picture")
        if picture.note:
            warnings.warn(f"{picture.name}: {picture.note}", PictureWarning, stacklevel=4)
        outline = None if shown is None else np.asarray(shown, dtype=bool)
        found = points(normal, picture.shape, camera, outline)
        usable = picture.valid.ravel()[found.pixel]
        if not usable.any():
            raise ValueError(
                f"{picture.name}: no pixel of the object is valid: all are clipped, negative or not finite."
            )
        pictures.append(picture)
        seen.append(found.take(np.flatnonzero(usable)))
    for i, one in enumerate(each["light"]):
        if not isinstance(one, Light):
            raise TypeError(
                f"'light' must be a dsbrdf.images.Light, got {type(one).__name__}. Light.from_map(path) reads a map."
            )
        if one.n_channels != pictures[i].n_channels:
            raise ValueError(
                f"{pictures[i].name}: {pictures[i].n_channels} channels, where the light has {one.n_channels}."
            )
    return pictures, seen, each["light"]


def _gaussian(prior: str | MaterialSpace | Gaussian, n_channels: int) -> Gaussian:
    if isinstance(prior, str):
        if prior != "library":
            raise ValueError(f"'prior' must be 'library', a MaterialSpace or a Gaussian, got {prior!r}.")
        from dsbrdf import space

        prior = space.builtin()
    gaussian = prior if isinstance(prior, Gaussian) else prior.gaussian()
    _check_channels(gaussian.channels, n_channels)
    return gaussian


def _check_channels(channels: tuple[str, ...], n_channels: int) -> None:
    if len(channels) != n_channels:
        raise ValueError(
            f"a picture of {n_channels} channels does not go with a prior of {len(channels)}: "
            f"{', '.join(channels)}. Give a picture with these channels."
        )


def _problem(
    pictures: Sequence[Picture],
    of_points: Sequence[Points],
    lights: Sequence[Light],
    gaussian: Gaussian,
    exposure: bool,
) -> search.Problem:
    """What is to be solved, for some pixels of each picture."""
    most = max(N_PIXELS // len(pictures), LEAST_PIXELS)
    weights, pixels, places = [], [], []
    for picture, seen, light in zip(pictures, of_points, lights, strict=True):
        some = seen.take(chosen(picture.flat[seen.pixel], most))
        weights.append(linear.weights(some, light).astype(np.float32))
        pixels.append(picture.flat[some.pixel])
        places.append(some.normal[some.start[:-1]])
    values = np.concatenate(pixels)
    offset = search.OFFSET * np.maximum(values.mean(0), 1e-12)
    groups = np.repeat(np.arange(len(pixels)), [len(p) for p in pixels])
    return search.Problem(
        np.ascontiguousarray(np.concatenate(weights, axis=1)),
        values,
        offset,
        gaussian,
        WORTH,
        exposure,
        np.concatenate(places),
        groups,
    )


def chosen(values: Array, most: int) -> NDArray[np.int_]:
    """Indices of `most` pixels (pixel, channel) at most: half of them even over the picture, half over brightness."""
    n = len(values)
    if n <= most:
        return np.arange(n)
    even = np.linspace(0, n - 1, most // 2).astype(int)
    brightness = np.log(values.mean(1) + 1e-3 * values.mean())
    order = np.argsort(brightness, kind="stable")
    levels = np.linspace(brightness[order[0]], brightness[order[-1]], most - most // 2)
    by_level = order[np.minimum(np.searchsorted(brightness[order], levels), n - 1)]
    return np.unique(np.concatenate([even, by_level]))


def solve(problem: search.Problem) -> search.Solution:
    """The most probable material; the prior leads the way there."""
    on_the_way = dataclasses.replace(problem, n_effective=WAY_WORTH)
    return problem.solve(on_the_way.solve(problem.start, search.LOOSE).x)


def finished(
    problem: search.Problem,
    found: search.Solution,
    pictures: list[Picture],
    of_points: list[Points],
    lights: list[Light],
    seconds: float,
) -> ImageFit:
    """The fit of a solution."""
    gaussian = problem.gaussian
    n = len(gaussian.mean)
    worth = max(independent(found.residual, problem.places, problem.groups) / HIDDEN, 1.0)
    covariance: Array = np.linalg.inv(worth * found.hessian + problem.precision).astype(np.float64)
    n_decided = float(np.trace(covariance @ (worth * found.hessian)))
    lobes = search.raw_lobes(found.x[:n], gaussian)
    order = np.argsort(lobes.gamma.mean(1), kind="stable")
    fit_options = {"from": "pictures", "prior": True, "exposure": "unknown" if problem.exposure else "known"}
    model = DSBRDF(lobes.take(order), gaussian.channels, name=pictures[0].name, fit_options=fit_options)
    return ImageFit(
        model,
        lights,
        covariance,
        n_decided,
        worth,
        _rms(found),
        coverage.of(problem, lobes),
        np.exp(found.x[n:]) if problem.exposure else np.ones(problem.pixels.shape[1]),
        found.converged,
        seconds,
        uncertainty.Posterior(lobes, covariance[:n, :n], n_decided),
        pictures,
        of_points,
    )


def _rms(found: search.Solution) -> float:
    return float(np.sqrt((found.residual**2).mean()))


def _warn_unexplained(miss: float, name: str) -> None:
    if miss > UNEXPLAINED:
        warnings.warn(
            f"{name}: the model misses the pixels by a factor of {np.exp(miss):.2f} (RMS). Check the normals, the "
            "light and the exposure; flakes, shadows and light between parts of the object are not in the model.",
            PictureWarning,
            stacklevel=4,
        )
