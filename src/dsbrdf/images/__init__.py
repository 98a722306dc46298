"""Reflectance and light from pictures of objects of known shape.

A picture in distant light is linear in the reflectance. `view` says where pixels look, `light` what shines on the
object, `linear` makes a picture a matrix of one with the other, `search` finds the material that the prior of a space
and the pixels agree on, `independence` what a picture is worth, `fit` puts it together.
"""

from dsbrdf.images.fit import ImageFit, PictureWarning, fit_image, fit_regions, relight
from dsbrdf.images.light import Light

__all__ = ["ImageFit", "Light", "PictureWarning", "fit_image", "fit_regions", "relight"]
