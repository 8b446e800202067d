"""The editor: control points dragged on a picture that follows them while the mouse moves.

The page fits the points and warps the picture itself, by the same mathematics as :func:`deformnb.rbf.fit_rbf`, so a
drag needs no kernel. The kernel gets the points at the end of an edit, and during a drag only if a callback asked.

Messages are those of :mod:`~deformnb.widgets.edited_points`.
"""

from __future__ import annotations

from typing import Any

import traitlets

from deformnb.control_points import ControlPoints
from deformnb.deformation import Step
from deformnb.degenerate import default_support
from deformnb.errors import DeformError
from deformnb.picture import Picture
from deformnb.plane import Raster
from deformnb.rbf import RBFInterpolant, fit_rbf
from deformnb.widgets.assets import joined, style
from deformnb.widgets.edited_points import EditedPoints, PointsTrait
from deformnb.widgets.editor_pictures import picture_png, preview_png, raster_json, sheet
from deformnb.widgets.static_picture import with_png

_FILES = ("rbf_solve.js", "rbf.js", "link.js", "maps.js", "edits.js", "sender.js", "elements.js", "paint.js",
          "handles.js", "toolbar.js", "gestures.js", "editor_drawing.js", "editor.js")

# Without a trend one point alone has no reach of its own: a quarter of the picture is a bump one can see and grab.
_LONE_POINT_SHARE = 0.25


class Editor(EditedPoints):
    """Control points on a picture, dragged in the page.

    Parameters
    ----------
    picture : what is seen behind the points; None for an empty sheet.
    points : control points in the picture's coordinates; default is none.
    raster : where an empty sheet lies; default is the box of the points with some air.
    kernel, support, trend, smoothing, strength : of the fit, as in :class:`~deformnb.deformation.Step`.
    density : cells of the grid along the longer side of the picture; 0 for no grid.
    show_net, show_radius : whether the grid and the reach of the points are drawn.
    height : largest height of the picture in CSS pixels; the editor is as wide as its place, and lower in a narrow one.
    theme : "auto" follows the page, "light" and "dark" do not.
    label : what a screen reader calls the picture.
    read_only : True shows points that cannot be changed.
    lone_support : reach of a single point without trend; default is a quarter of the picture's diagonal.

    Notes
    -----
    ``points`` is a trait: ``editor.observe(f, "points")`` calls f after every edit, ``editor.points = ...`` shows
    others. While f runs for an edit of the page, ``edit_under_way`` says what was done; it is None where code did it.
    ``selected`` holds the ids of the selected points. ``history`` is {} where the page keeps an undo of its
    own. Whoever keeps one in Python sets it to ``{"undo": "move nose", "redo": ""}``: what would be undone and redone,
    "" for nothing; :meth:`on_history` then tells what the page asks for. ``waiting`` is "" or says what is being made,
    such as another picture: while it is not empty the page dims the picture, shows that text over it and takes no edit
    and no undo; a drag under way is given up. An edit sent just before may still come. ``uid`` names the
    editor in its page, where other widgets find its live points without the kernel (see link.js).

    Raises
    ------
    DeformError
        For points in space, an unknown name, or a setting that is no sensible number.

    Examples
    --------
    >>> editor = Editor(None, ControlPoints.from_arrays([[0, 0], [40, 0], [0, 30]], [[0, 0], [50, 0], [0, 30]]))
    >>> editor.points = editor.points.move(2, [5, 33])
    >>> bool(abs(editor.fit().displacement([5.0, 33.0]) - [-5.0, -3.0]).max() < 1e-12)
    True
    """

    _esm = joined(*_FILES)
    _css = style("editor.css")

    points = PointsTrait(2)
    density = traitlets.Int(16, min=0, max=64).tag(sync=True)
    show_net = traitlets.Bool(True).tag(sync=True)
    show_radius = traitlets.Bool(False).tag(sync=True)
    raster = traitlets.Dict().tag(sync=True)
    image = traitlets.Bytes(b"", help="the picture as PNG").tag(sync=True)

    def __init__(self, picture: Picture | None = None, points: ControlPoints | None = None, *,
                 raster: Raster | None = None, **settings: Any) -> None:
        given = ControlPoints.empty() if points is None else points
        self._previous: RBFInterpolant | None = None
        self._picture = picture
        super().__init__(points=given, **{**_of_picture(picture, raster, given), **settings})

    # ---- what is shown ----------------------------------------------------------------------------------------------

    @property
    def picture(self) -> Picture | None:
        """What is seen behind the points; setting another one keeps the points."""
        return self._picture

    @picture.setter
    def picture(self, picture: Picture | None) -> None:
        traits = _of_picture(picture, None, self.points)
        self._picture = picture
        with self.hold_sync():  # both in one message: a picture must never meet another one's raster
            for name, value in traits.items():
                setattr(self, name, value)

    def fit(self) -> RBFInterpolant:
        """The fit of the points as the core makes it: the displacement that the page shows.

        Raises
        ------
        DeformError
            If the points cannot be fitted; the page shows the same message.
        """
        points = self.points
        fit = fit_rbf(points if self.strength == 1 else points.blended(self.strength), kernel=self.kernel,
                      support=self.support or default_support(points) or self.lone_support, trend=self.trend,
                      smoothing=self.smoothing, previous=self._previous)
        self._previous = fit
        return fit

    def step(self, **options: Any) -> Step:
        """The points and settings as a step of a :class:`~deformnb.deformation.Deformation`.

        Parameters
        ----------
        options : further fields of the step, such as its rule of extrusion.
        """
        if self._picture is None:
            raise DeformError("an editor without a picture has no plane in space; give it a picture.")
        return Step((self.points,), self._picture.plane, kernel=self.kernel, support=self.support, trend=self.trend,
                    smoothing=self.smoothing, strength=self.strength, **options)

    def preview_png(self) -> bytes:
        """The deformed picture with its grid and points as a PNG: what is seen where no front end runs."""
        picture = self._picture or sheet(self.points)
        return preview_png(picture, self.points, self.fit(), self.density if self.show_net else 0)

    # ---- display ----------------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        if self._picture is None:
            return f"Editor({len(self.points)} points, no picture)"
        nv, nu = self._picture.raster.shape
        return f"Editor({len(self.points)} points, picture of {nu} x {nv})"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), self.preview_png)


def _of_picture(picture: Picture | None, raster: Raster | None, points: ControlPoints) -> dict[str, Any]:
    """The traits that follow from a picture, or from an empty sheet."""
    where = picture.raster if picture is not None else raster or sheet(points).raster
    image, channels = (b"", 1) if picture is None else picture_png(picture)
    return {"image": image, "raster": raster_json(where, channels), "lone_support": _LONE_POINT_SHARE * where.diagonal}
