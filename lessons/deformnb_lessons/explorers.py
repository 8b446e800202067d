"""Figures of the first lesson that a pupil changes without code."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import ipywidgets as ipw

from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.imaging.thompson import draw_grids
from deformnb.widgets.cell_widgets import with_png
from deformnb.words import translate
from deformnb_lessons.drawing_parts import Drawing, draw_rules, rule_nodes
from deformnb_lessons.moved_animal import SIDE, steps_fault
from deformnb_lessons.studio_tasks import session_of

_STEP = 0.1


class RuleExplorer(ipw.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """Sliders for shear and taper, and the grid that they bend.

    Examples
    --------
    >>> explorer = RuleExplorer()
    >>> explorer.shear.value, explorer.taper.value
    (0.0, 0.0)
    """

    def __init__(self) -> None:
        self.shear, self.taper = (
            ipw.FloatSlider(value=0.0, min=-1.0, max=1.0, step=_STEP, description=translate(word))
            for word in ("Shear k", "Taper t")
        )
        self._grid = ipw.HTML()
        for slider in (self.shear, self.taper):
            slider.observe(self._draw, "value")
        super().__init__([ipw.HBox([self.shear, self.taper], layout={"flex_flow": "row wrap"}), self._grid])
        self._draw()

    def _draw(self, _change: Any = None) -> None:
        self._grid.value = _grid_svg(rule_nodes(self.shear.value, self.taper.value))

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), lambda: draw_rules().png())


def _grid_svg(nodes: Floats) -> str:
    lines = "".join(
        f'<polyline points="{" ".join(f"{a:.3f},{b:.3f}" for a, b in line)}" fill="none" stroke="#0072b2" '
        'stroke-width="1.5" vector-effect="non-scaling-stroke"/>'
        for line in (*nodes, *nodes.transpose(1, 0, 2))
    )
    words = translate("The bent grid")
    return (
        f'<svg viewBox="-0.85 -0.85 2.7 1.7" role="img" aria-label="{words}" '
        f'style="width: 360px; max-width: 100%; background: #fff"><title>{words}</title>{lines}</svg>'
    )


class GrownFigure(ipw.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """The areas of a deformed animal in colours, drawn when a button is pressed.

    Parameters
    ----------
    studio : the studio, or its session.

    Raises
    ------
    DeformError
        If it is no studio.
    """

    def __init__(self, studio: object) -> None:
        session = session_of(studio)
        if session is None:
            raise DeformError(
                "the figure is of a studio; run the cell of the studio first, and give the studio itself."
            )
        self._session = session
        self.button = ipw.Button(
            description=translate("Show where my fish has grown"), layout={"width": "auto", "align_self": "flex-start"}
        )
        self.button.on_click(lambda _button: self._show())
        self.note, self._picture = ipw.HTML(), ipw.HTML()
        super().__init__([self.button, self.note, self._picture])

    def _show(self) -> None:
        fault = steps_fault(self._session)
        self.note.value = translate(fault)
        self._picture.value = "" if fault else self._picture_html()

    def _picture_html(self) -> str:
        words = translate("Colours: where the fish has grown and shrunk")
        source = f"data:image/png;base64,{b64encode(self._draw()).decode()}"
        return f'<img alt="{words}" style="max-width: 100%" src="{source}">'

    def _draw(self) -> bytes:
        session = self._session
        title = translate("where my fish has grown")
        figure = draw_grids(
            session.editing.deformation, project(session.volume, SIDE, "mip"), overlay="area", title=title
        )
        return Drawing(figure, title).png()

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), self._draw)
