"""An exported page in Firefox and in WebKitGTK: its picture and its volume follow a real mouse, as in Chromium."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from browser.other_browsers import firefox_tab, webkit_tab, why_no_firefox, why_no_webkit
from browser.test_standalone_page import EDITOR, FINE, MODELS, PLANE, VIEW, _decoded, dice, pair, silhouette

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.standalone import write_standalone

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

BROWSERS = {"firefox": (firefox_tab, why_no_firefox), "webkit": (webkit_tab, why_no_webkit)}
DRAWN = f"""(() => {{ const view = {VIEW}; view.loop.drawNow(2);
    return view.elements.canvas.toDataURL('image/png').split(',')[1]; }})()"""
PICTURE = "document.querySelector('.dnb-ed-canvas').toDataURL('image/png').split(',')[1]"
SETTLED = f"{EDITOR}.picture.painter.source && !{EDITOR}.frames.isMoving && !{EDITOR}.frames.request"
MOVED = f"{MODELS}.editor.get('points').some((p) => String(p.source) !== String(p.target))"


@pytest.mark.parametrize("name", BROWSERS)
def test_picture_and_volume_follow_a_drag_and_undo_takes_it_back(name: str, tmp_path: Path) -> None:
    open_tab, why_not = BROWSERS[name]
    if why_not():
        pytest.skip(why_not())
    editor, view = pair()
    write_standalone(tmp_path / "page.html", editor, view)
    with open_tab(tmp_path) as tab:
        tab.goto((tmp_path / "page.html").as_uri())
        tab.wait(f"document.querySelector('.dnb-editor') && {SETTLED}")
        tab.wait("document.querySelector('.dnb-view') && !document.querySelector('.dnb-page-still')")
        tab.wait(f"{VIEW}.caster?.isReady && {VIEW}.field")
        start, flat = _decoded(tab.js(DRAWN)), _decoded(tab.js(PICTURE))
        size = (start.shape[1], start.shape[0])
        assert dice(silhouette(start), silhouette(view.still(size))) > 0.965
        x, y, k = tab.js(f"""(() => {{ const {{ view }} = {EDITOR}.viewport,
            box = document.querySelector('.dnb-ed-stage').getBoundingClientRect();
            return [view.x + box.x, view.y + box.y, view.k]; }})()""")
        place = editor.points.target[4]
        tab.drag((x + k * place[0], y + k * place[1]), (40, 25))
        tab.wait(f"{SETTLED} && {MOVED}")
        rows = tab.js(f"{MODELS}.editor.get('points')")
        points = ControlPoints.from_arrays([row["source"] for row in rows], [row["target"] for row in rows])
        assert np.abs(points.displacement).max() > 1
        moved = _decoded(tab.js(DRAWN))
        view.show_deformation(Deformation.from_picture_points(FINE, PLANE, points), output=FINE)
        assert dice(silhouette(moved), silhouette(view.still(size))) > 0.965
        assert dice(silhouette(moved), silhouette(start)) < 0.93
        assert np.abs(_decoded(tab.js(PICTURE)) - flat).mean() > 2
        tab.press("z", "\ue009")
        tab.wait(f"{SETTLED} && !{MOVED}")
        assert np.abs(_decoded(tab.js(PICTURE)) - flat).mean() < 0.3
        tab.wait(f"({DRAWN}).length > 0")
        assert dice(silhouette(_decoded(tab.js(DRAWN))), silhouette(start)) > 0.99
