"""Figures: that they hold their texts."""

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg

from dsbrdf import plot


def assert_nothing_is_cut(figure):
    """No text lies outside of the figure."""
    with matplotlib.rc_context(plot.STYLE):
        FigureCanvasAgg(figure).draw()
    whole = figure.bbox
    texts = [*figure.texts, *(text for axes in figure.axes for text in axes.texts)]
    for axes in figure.axes:
        texts.append(axes.title)
        if axes.axison:
            low, high = sorted(axes.get_xlim())
            ticks = [tick for tick in axes.get_xticklabels() if low <= tick.get_position()[0] <= high]
            texts += [axes.xaxis.label, axes.yaxis.label, *ticks]
        texts += axes.get_legend().get_texts() if axes.get_legend() else []
    for text in (text for text in texts if text.get_text() and text.get_visible()):
        box = text.get_window_extent()
        inside = whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
        assert inside, f"{text.get_text()!r} at {box}, figure {whole}"
