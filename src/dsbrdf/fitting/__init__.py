"""Fits of the model to measurements, how certain they are, and reports of them.

Scattered samples are gathered to slices in `scattered` and fitted in `fit_scattered`; `fit_splines` fits curves over
theta_d, with the minimiser in `_minimise`. `uncertainty` gives standard errors of what was fitted, and `report` prints
tables of fits and models. Read them in this order.
"""
