"""Directions, angles, grids and colours: each convention has its one owner here.

Every other room takes its angles from `half_diff`, which turns a pair of directions into half and difference angles
(Eq. 2) and back. `grids` says which cells a table over these angles has, and where in a cell its value belongs.
`directions` makes unit vectors, and the pairs over which an albedo is integrated. `colour` takes spectra to linear
sRGB, and colours to luminance. `panorama` is the frame of environment maps, `lighting` one of our own. Read them in
this order.
"""
