"""The fit of the model to measurements, how good and how certain it is.

`options` says what can be asked for. `observations` turns a table or samples into what is fitted, `estimator` finds
lobes (the work is the kernel's), `metrics` measures errors over the whole hemisphere, `coverage` says which angles were
measured, and `uncertainty` how certain the result is. `fit` puts these together. Read them in this order.
"""

from dsbrdf.fitting.fit import ConvergenceWarning, Fit, PriorWarning, fit
from dsbrdf.fitting.options import FitOptions

__all__ = ["ConvergenceWarning", "Fit", "FitOptions", "PriorWarning", "fit"]
