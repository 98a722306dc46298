"""The file formats of measured reflectance: one reader a format, and its writer where there is one.

`merl` and `rgl` read the two databases, `rgl` with the container in `tensor_file`; `nbrdf` decodes neural BRDFs.
`array_file`, `text_file` and `image_file` read what laboratories write themselves: NumPy arrays, columns of text, and
images over (theta_h, theta_d). Start with `merl`, the simplest. `dsbrdf.measured.read` chooses among them by what a
file holds.
"""
