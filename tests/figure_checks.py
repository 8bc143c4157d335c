"""What tests ask of figures."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text


def check_layout(figure: Figure) -> None:
    """Texts lie on the page and beside each other, legends beside the panels; none is empty."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    page = figure.bbox
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in visible_texts(figure)]
    assert len(boxes) > 3
    for number, (text, box) in enumerate(boxes):
        assert page.containsx(box.x0), text
        assert page.containsx(box.x1), text
        assert page.containsy(box.y0), text
        assert page.containsy(box.y1), text
        for other, other_box in boxes[number + 1 :]:
            assert not box.overlaps(other_box), (text, other)
    legends = [legend.get_window_extent(renderer) for legend in figure.findobj(Legend)]
    for axes in figure.axes:
        assert axes.has_data()
        panel = axes.get_window_extent(renderer)
        assert not any(legend.overlaps(panel) for legend in legends)


def visible_texts(figure: Figure) -> list[Text]:
    """Texts that are drawn: a tick outside the limits of its axis keeps a label that is not."""
    hidden = {
        id(label)
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
        for label in (tick.label1, tick.label2)
        if not axis.get_visible()
        or not min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
    }
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text() and id(text) not in hidden
    ]


def x_of(artist: Artist) -> np.ndarray:
    assert isinstance(artist, Line2D)
    return np.asarray(artist.get_xdata())


def y_of(artist: Artist) -> np.ndarray:
    assert isinstance(artist, Line2D)
    return np.asarray(artist.get_ydata())


def curves(axes: Axes, colour: str) -> list[Line2D]:
    return [line for line in axes.lines if line.get_color() == colour]


def on_top_edge(axes: Axes) -> list[Line2D]:
    """Markers there; a line from bottom to top has none."""
    transform = axes.get_xaxis_transform()
    marks = [line for line in axes.lines if line.get_marker() not in ("None", "")]
    return [line for line in marks if line.get_transform() == transform]


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]
