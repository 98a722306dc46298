"""The model: a sum of lobes, its values, its samples, its energy and its file.

`hemi_epd` is the distribution that a lobe is made of (Eq. 4). `dsbrdf` holds a model's parameters and is what users
call; its methods lead to `evaluation` (values for directions), `sampling` (directions for a renderer), `energy`
(albedo) and `components` (lobes in plain words), and `file` writes and reads it. `check` judges a model, with the test
in `chi_square`; `sphere` draws one as a shaded sphere. Read them in this order.
"""
