"""Figures: that they hold their texts."""

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg

from dsbrdf import plot


def assert_nothing_is_cut(figure, drawn_at=None):
    """No text lies outside of the figure; it is drawn first, unless it has been, with so many dots an inch."""
    own = figure.dpi
    if drawn_at is None:
        with matplotlib.rc_context(plot.STYLE):
            FigureCanvasAgg(figure).draw()
    else:
        # What is placed when it is drawn is where it was placed
        figure.dpi = drawn_at
    try:
        _assert_nothing_is_cut(figure)
    finally:
        figure.dpi = own


def _assert_nothing_is_cut(figure):
    renderer = FigureCanvasAgg(figure).get_renderer()
    whole = figure.bbox
    texts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axes in figure.axes:
        texts += [*axes.texts, axes.title]
        if axes.axison:
            texts += [axes.xaxis.label, axes.yaxis.label]
            for axis in (axes.xaxis, axes.yaxis):
                low, high = sorted(axis.get_view_interval())
                ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
                texts += [label for place, label in ticks if low <= place <= high]
        texts += axes.get_legend().get_texts() if axes.get_legend() else []
    for text in (text for text in texts if text.get_text() and text.get_visible()):
        box = text.get_window_extent(renderer)
        # A pixel for rounding
        inside = min(box.x0 - whole.x0, whole.x1 - box.x1, box.y0 - whole.y0, whole.y1 - box.y1) > -1.0
        assert inside, f"{text.get_text()!r} at {box}, figure {whole}"
