"""Outputs of objects in a notebook's cell: small pictures by Pillow and tables in HTML, and plots by Matplotlib.

An object's own text (``repr``) stays next to them, for consoles. Names and texts of users are escaped. Pillow and
Matplotlib are imported when something is drawn.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from deformnb._typing import Image
from deformnb.chunked.sources import LargeVolume
from deformnb.document.deformation import Deformation
from deformnb.imaging.projection import ProjectionName, project, project_channels
from deformnb.rbf.fields import AbstractFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.named_points import AXIS_NAMES
from deformnb.rbf.points import ControlPoints
from deformnb.volume.channels import Channels
from deformnb.volume.plane import Picture, Plane
from deformnb.volume.views import AXIS_SIDES, ViewName
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks

_PICTURE_SIZE = 480  # pixels of the longer side of a picture in a cell
_SLICE_SIZE = 160  # of the largest slice of a volume there, all to one scale
_ROWS = 12  # of a table
_GAP = 4  # pixels between two pictures
_VIEWS_OF_SLICES: tuple[ViewName, ...] = ("+z", "+y", "+x")


def as_png(picture: Picture) -> bytes:
    r"""PNG of a picture with square pixels, the longer side 480 pixels.

    Examples
    --------
    >>> as_png(project(Volume.from_array(np.eye(3)), "+z"))[:4]
    b'\x89PNG'
    """
    return _png(_sized(picture, _PICTURE_SIZE / _longest_side(picture)))


def _longest_side(picture: Picture) -> float:
    a0, a1, b0, b1 = picture.raster.box
    return max(a1 - a0, b1 - b0)


def _sized(picture: Picture, scale: float) -> Image:
    """The colours of a picture, with square pixels, so many for each unit of length."""
    from PIL import Image as Pillow

    a0, a1, b0, b1 = picture.raster.box
    size = max(1, round((a1 - a0) * scale)), max(1, round((b1 - b0) * scale))
    colours = picture.rgb8()
    step = max(1, min(colours.shape[:2]) // (4 * max(size)))  # of a huge picture
    few_colours = Pillow.fromarray(np.ascontiguousarray(colours[::step, ::step]))
    is_larger = size[0] > few_colours.width
    return np.asarray(few_colours.resize(size, Pillow.Resampling.NEAREST if is_larger else Pillow.Resampling.BOX))


def _png(image: Image) -> bytes:
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="PNG")
    return stream.getvalue()


@singledispatch
def as_html(given: Any) -> str:
    """HTML of an object: a picture or a table, or else its text.

    Examples
    --------
    >>> as_html("a < b")
    '<pre>&#x27;a &lt; b&#x27;</pre>'
    """
    return f"<pre>{html.escape(repr(given))}</pre>"


def image_html(image: Image, text: str) -> str:
    """A picture (height, width, 3) in HTML, with a text for those who do not see it."""
    data = base64.b64encode(_png(image)).decode("ascii")
    return f'<img alt="{html.escape(text)}" width="{image.shape[1]}" src="data:image/png;base64,{data}">'


def table_html(head: Sequence[str], rows: Iterable[Sequence[object]], count: int) -> str:
    """A table of the first rows of ``count``, its cells escaped."""
    lines = [_row("th", head)] + [_row("td", row) for row, _ in zip(rows, range(_ROWS), strict=False)]
    more = f"<p>... and {count - _ROWS} more</p>" if count > _ROWS else ""
    return f"<table>{''.join(lines)}</table>{more}"


def _row(tag: str, cells: Sequence[object]) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"


def _facts(facts: dict[str, str]) -> str:
    """A table of two columns; what is empty is left out."""
    lines = "".join(f"<tr><th>{name}</th><td>{html.escape(value)}</td></tr>" for name, value in facts.items() if value)
    return f"<table>{lines}</table>"


def title_html(kind: str, name: str) -> str:
    """The type of an object, and its name."""
    return f"<b>{kind}</b>{f' {html.escape(name)}' if name else ''}"


@as_html.register
def _volume_html(volume: Volume) -> str:
    """Three slices through the middle, and what a volume is."""
    low, high = volume.value_range
    voxels = f"{volume.dtype.name}{', labels' if volume.is_labels else ''}, {low:.6g} to {high:.6g}"
    facts = {**_grid_facts(volume.grid, voxels), "notes": "; ".join(volume.notes)}
    return f"<div>{title_html('Volume', volume.name)}<br>{_slices_html(volume, project)}{_facts(facts)}</div>"


@as_html.register
def _channels_html(channels: Channels) -> str:
    """Three slices in the colours of the channels, and what they are."""
    facts = {"channels": ", ".join(channels.names), **_grid_facts(channels.grid, channels.volumes[0].dtype.name)}
    image = _slices_html(channels, project_channels)
    return f"<div>{title_html('Channels', channels.name)}<br>{image}{_facts(facts)}</div>"


@as_html.register
def _grid_html(grid: Grid) -> str:
    size = " x ".join(f"{length:.6g}" for length in grid.lengths) + (grid.unit and f" {grid.unit}")
    return f"<div>{title_html('Grid', '')}{_facts({**_grid_facts(grid), 'size (x, y, z)': size})}</div>"


@as_html.register
def _large_volume_html(volume: LargeVolume) -> str:
    """Facts about a volume, of which no voxel is read for them."""
    facts = {
        **_grid_facts(volume.grid, f"{volume.dtype.name}{', labels' if volume.is_labels else ''}, read in parts"),
        "levels": str(len(volume.levels)) if len(volume.levels) > 1 else "",
        "notes": "; ".join(volume.notes),
    }
    return f"<div>{title_html('LargeVolume', volume.name)}{_facts(facts)}</div>"


def _slices_html(subject: Any, project_one: Callable[..., Picture]) -> str:
    slices = [project_one(subject, view, "slice") for view in _VIEWS_OF_SLICES]
    scale = _SLICE_SIZE / max(map(_longest_side, slices))
    row = _join_pictures([_sized(picture, scale) for picture in slices])
    return image_html(row, "slices " + ", ".join(AXIS_SIDES[view] for view in _VIEWS_OF_SLICES))


def _grid_facts(grid: Grid, voxels: str = "") -> dict[str, str]:
    unit = grid.unit and f" {grid.unit}"
    return {
        "shape (z, y, x)": " x ".join(map(str, grid.shape)),
        "voxels": voxels,
        "spacing (x, y, z)": " x ".join(f"{s:.6g}" for s in grid.spacing) + unit,
        "origin (x, y, z)": ", ".join(f"{s:.6g}" for s in grid.origin) + unit,
        "axes": grid.orientation if grid.is_anatomical else "",
    }


@as_html.register
def _mesh_html(mesh: Mesh) -> str:
    unit = mesh.unit and f" {mesh.unit}"
    low, high = (_place(end) + unit for end in mesh.box)
    facts = {
        "corners": str(len(mesh.points)),
        "triangles": str(len(mesh.faces)),
        "from (x, y, z)": low,
        "to (x, y, z)": high,
        "closed": "yes" if mesh.is_closed else "no",
        "notes": "; ".join(mesh.notes),
    }
    return f"<div>{title_html('Mesh', mesh.name)}{_facts(facts)}</div>"


def _place(coordinates: Iterable[float]) -> str:
    """Coordinates as a text; empty where there is no place."""
    given = tuple(coordinates)
    return "" if np.isnan(given).any() else ", ".join(f"{value:.6g}" for value in given)


def _where(dim: int) -> str:
    return f"({', '.join(AXIS_NAMES[dim])})"


@as_html.register
def _points_html(points: ControlPoints) -> str:
    unit, axes = points.unit and f" {points.unit}", _where(points.dim)
    lengths = np.linalg.norm(points.displacement, axis=1)
    states = [
        ", ".join(word for word, is_so in (("off", not p.active), ("locked", p.locked)) if is_so)
        for p in points[:_ROWS]
    ]
    rows = (
        (number, p.name, _place(p.source), _place(p.target), f"{length:.4g}{unit}", state)
        for number, p, length, state in zip(points.numbers, points, lengths, states, strict=False)
    )
    head = ("", "name", f"source {axes}", f"target {axes}", "moved", "")
    return f"<div>{title_html('ControlPoints', '')}{table_html(head, rows, len(points))}</div>"


@as_html.register
def _landmarks_html(landmarks: Landmarks) -> str:
    axes = _where(landmarks.points.shape[1])
    unit = f" in {landmarks.unit}" if landmarks.unit else ""
    active = np.ones(len(landmarks), bool) if landmarks.active is None else landmarks.active
    columns: list[Iterable[object]] = [range(1, len(landmarks) + 1), landmarks.names, map(_place, landmarks.points)]
    head = ["", "name", f"place {axes}{unit}"]
    if landmarks.fixed is not None:
        columns.append(map(_place, landmarks.fixed))
        head.append(f"fixed place {axes}")
    columns.append("" if is_on else "off" for is_on in active)
    table = table_html((*head, ""), zip(*columns, strict=True), len(landmarks))
    return f"<div>{title_html('Landmarks', '')}{table}</div>"


@as_html.register
def _deformation_html(deformation: Deformation) -> str:
    return f"<div>{title_html('Deformation', deformation.name)}{steps_html(deformation)}</div>"


def steps_html(deformation: Deformation, titles: Sequence[str] = ()) -> str:
    """A table of the steps of a deformation.

    Parameters
    ----------
    titles : of the steps, in place of their names.
    """
    rows = (
        (
            k + 1,
            titles[k] if titles else step.name,
            f"{len(step.points)} {'in space' if step.plane is None else 'on a picture'}",
            int((step.points.source != step.points.target).any(axis=1).sum()),
            f"{step.kernel}, {step.trend} trend",
            "" if step.plane is None else step.extrusion,
            f"{len(step.parts)} rigid" if step.parts else "",
            f"{len(step.cuts)} cut" if step.cuts else "",
            "" if step.enabled else "off",
        )
        for k, step in enumerate(deformation.steps)
    )
    head = ("", "step", "points", "moved", "fit", "extrusion", "", "", "")
    return table_html(head, rows, len(deformation.steps))


@as_html.register
def _any_fit_html(fit: AbstractFit) -> str:
    """A fit of several parts: what all fits have, and its parts as texts."""
    parts = getattr(fit, "fits", ()) or (getattr(fit, "forward", None),)
    facts = {
        "points": _points_of(fit),
        "trend": fit.trend,
        "made of": "; ".join(repr(part) for part in parts[:_ROWS] if part is not None),
        "notes": "; ".join(fit.notes),
    }
    return f"<div>{title_html(type(fit).__name__, '')}{_facts(facts)}</div>"


def _points_of(fit: AbstractFit) -> str:
    return f"{len(fit.ids)} {'in the plane' if fit.dim == 2 else 'in space'}"


@as_html.register
def _fit_html(fit: RBFInterpolant) -> str:
    facts = {
        "points": _points_of(fit),
        "kernel": fit.kernel.name,
        "support": f"{float(fit.support):.6g}{fit.unit and f' {fit.unit}'}" if fit.kernel.compact else "",
        "trend": fit.trend,
        "smoothing": "" if fit.nugget is None else "yes",
        "notes": "; ".join(fit.notes),
    }
    return f"<div>{title_html('RBFInterpolant', '')}{_facts(facts)}</div>"


def _join_pictures(pictures: Sequence[Image]) -> Image:
    """Pictures side by side on white."""
    height, width = max(p.shape[0] for p in pictures), sum(p.shape[1] + _GAP for p in pictures) - _GAP
    canvas, left = np.full((height, width, 3), 255, np.uint8), 0
    for picture in pictures:
        canvas[: picture.shape[0], left : left + picture.shape[1]] = picture
        left += picture.shape[1] + _GAP
    return canvas


def plot_volume(
    volume: Volume, view: ViewName | Plane, method: ProjectionName, *, ax: Any = None, **options: Any
) -> Any:
    """Draw a picture of a volume in axes of Matplotlib; see :meth:`deformnb.Volume.plot`."""
    picture = project(volume, view, method, **options)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure().add_subplot()
    ax.imshow(picture.rgb8(), extent=picture.extent)
    unit = volume.grid.unit and f" ({volume.grid.unit})"
    across, down = ("xyz"[int(np.abs(axis).argmax())] for axis in picture.plane.frame[:2])
    ax.set(xlabel=f"{across}{unit}", ylabel=f"{down}{unit}", title=volume.name, aspect="equal")
    return ax
