"""Export of one HTML file in which a volume deforms: no kernel, no server, no network.

The file holds the front ends of an :class:`~deformnb.widgets.Editor` and a :class:`~deformnb.widgets.LiveView` as they
are, the packed voxels, and a script that sends to both the messages of Python (standalone.js). The front end fits and
warps by itself, so nothing is missing but the kernel. A policy in the file forbids every access to the network, and
allows each script by its digest: no text of a volume or a title can become one.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.document.deformation import Deformation, Step, VolumeReference
from deformnb.document.json_format import to_json
from deformnb.errors import DeformError
from deformnb.io.files.atomic import atomic_write, check_target
from deformnb.io.files.paths import as_path
from deformnb.rbf.extrusion import Extrusion, extrude
from deformnb.rbf.fields import AbstractField, Composed, Identity
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import cut_off_text, foreground_level, leaving_voxels, side_names
from deformnb.widgets.bundle import bundle
from deformnb.widgets.camera import PICTURE_SHOWS
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.outlines import outline_of_picture, outline_of_volume
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.kernel_table import table_for_client
from deformnb.widgets.messages.views import FieldMaps, FollowData
from deformnb.widgets.packed_volume import PackedVolume, packed_volume
from deformnb.widgets.page_html import (
    PROMISE,
    as_base64,
    compress,
    escape,
    inline_script,
    pack,
    page_html,
    plain_traits,
)
from deformnb.widgets.parameters import PAGE_CONTROLS, as_json
from deformnb.widgets.textures import MOST_MAPS, FieldTextures, cut_plane, field_textures
from deformnb.widgets.view.base import with_map
from deformnb.widgets.view.live_view import LiveView, Snapshot
from deformnb.widgets.view.stills import render_scene
from deformnb.words import language as chosen_language
from deformnb.words import translate, word_table

LIMIT = 256**3
"""Voxels in a file at most, by default."""

MOST_BYTES = 9_000_000
"""Bytes that the voxels take in a file by default, as text: with scripts and pictures it stays below 10 MB."""

# A GPU shows at least 256 along an axis, every one of today 1024; a file cannot query it.
_LARGEST = 1024
_SPACE_SIZE = 48  # samples of a displacement that is no extrusion: 64 as in a live view would be twice the file

_STILL = (640, 480)
_SIDES = "%"  # the place of the sides in the warning of the page

# Displacements are rounded to this share of a voxel, which is invisible and packs far better.
_EXACTNESS = 1 / 64


def standalone_html(
    editor: Editor,
    view: LiveView | None = None,
    *,
    title: str = "",
    about: str = "",
    limit: int | None = None,
    controls: Iterable[str] = tuple(PAGE_CONTROLS),
    language: str | None = None,
    progress: Progress | None = None,
) -> str:
    """A web page for a browser alone, in which points are dragged and picture and volume follow.

    Parameters
    ----------
    editor : its picture, points and settings are in the page.
    view : its volume, colours and camera are in the page; None for the picture alone. If it follows the editor, its
        content stays; else the editor's displacement is replicated through the volume.
    title : of the page; default is the volume's name.
    about : a line under the title.
    limit : voxels in the page at most; a larger volume is averaged, which the page reports. Default is 256^3, and
        fewer where these would take more than 10 MB.
    controls : names of :data:`PAGE_CONTROLS` that the page has; none leaves picture and volume alone.
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the chosen one.
    progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    str
        The page. It takes 0.55 MB for the scripts, 0.1 to 0.3 MB for the two pictures, and the packed voxels,
        a third more for being text: 2.2 MB for the carp, 2.8 MB for a CT of a head with 12 million voxels.

    Raises
    ------
    DeformError
        If the view shows no volume or follows another editor, the points cannot be fitted, or there is no such
        control.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> page = standalone_html(Editor(None, ControlPoints.from_arrays([[0, 0], [9, 0], [4, 8]])), title="A < B")
    >>> "<title>A &lt; B</title>" in page
    True
    """
    report = progress or silent
    wanted = _checked_controls(controls)
    part = None if view is None else view_part(editor, view, _checked_limit(limit), report)
    name = title or (part.volume.name if part else "") or "Deformation"
    code = chosen_language(language)
    data = page_data(editor, part, name, wanted, code)
    scripts = [
        inline_script(bundle("editor.js"), "editor"),
        *([inline_script(bundle("live_view.js"), "view")] if part else []),
        bundle("standalone.js"),
    ]
    styles = [bundle("editor.css"), *([bundle("live_view.css")] if part else []), bundle("standalone.css")]
    facts = translate(f"{part.about}. {PROMISE}" if part else PROMISE, code)
    texts = {"title": name, "about": about, "facts": facts}
    image = base64.b64encode(part.still if part else editor.preview_png()).decode("ascii")
    still = f'<img class="dnb-page-still" alt="{escape(name)}" src="data:image/png;base64,{image}">'
    page = page_html(texts, {"opening": "", "hidden": "", "still": still}, data, scripts, styles, code)
    report(1.0)
    return page


def page_data(
    editor: Editor, part: ExportedView | None, name: str, controls: Iterable[str], code: str
) -> dict[str, Any]:
    """Data of a page for its scripts."""
    return {
        "language": code,
        "words": word_table(code),
        "editor": {**plain_traits(editor), **_OF_PYTHON, "outline": _outline(editor, part)},
        "view": part.traits if part else None,
        "chunks": part.chunks if part else [],
        "field": part.field if part else None,
        "still_background": part.background if part else None,
        "kernels": {k.name: k.order for k in KERNELS.values()},
        "kernel_tables": {kernel: table for kernel in KERNELS if (table := table_for_client(kernel))},
        "trends": {t.name: t.order for t in TRENDS.values()},
        "controls": list(controls),
        "cut_off": part.cut_off if part else None,
        "parameters": as_json(("strength", "kernel", "shows", "density")),
        "picture_shows": PICTURE_SHOWS,
        "document": _document(editor, part, name),
    }


_OF_PYTHON = {"uid": "standalone", "live": False, "seen": {}, "history": {}, "cut_off": {}, "enlarges": False}


def _outline(editor: Editor, part: ExportedView | None) -> dict[str, Any]:
    """The tissue on the picture, for the page to report where it leaves the box; {} where the view finds that."""
    if part is not None:
        return part.outline
    return {} if editor.picture is None else outline_of_picture(editor.picture)


def _checked_controls(controls: Iterable[str]) -> list[str]:
    given = list(controls)
    for name in given:
        if name not in PAGE_CONTROLS:
            raise DeformError(f"a page has no control {name!r:.40}; there are {', '.join(PAGE_CONTROLS)}.")
    return [name for name in PAGE_CONTROLS if name in given]


def _checked_limit(limit: int | None) -> int | None:
    if limit is None:
        return None
    if isinstance(limit, bool) or not isinstance(limit, int | np.integer) or limit < 1:
        raise DeformError(f"the limit of a page is a whole number of voxels, at least 1, got {limit!r:.40}.")
    return int(limit)


def silent(_share: float) -> None:
    """Progress that is not shown."""


def write_standalone(
    path: str | os.PathLike[str],
    editor: Editor,
    view: LiveView | None = None,
    *,
    overwrite: bool = True,
    **options: Any,
) -> None:
    """Write the page of :func:`standalone_html` to a file, atomically.

    Parameters
    ----------
    path : the file to write.
    editor, view, options : as in :func:`standalone_html`.
    overwrite : whether an existing file may be replaced.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from deformnb.rbf.points import ControlPoints
    >>> file = Path(tempfile.mkdtemp()) / "sheet.html"
    >>> write_standalone(file, Editor(None, ControlPoints.from_arrays([[0, 0], [9, 0], [4, 8]])), title="a sheet")
    >>> file.is_file()
    True
    """
    check_page_path(path, overwrite=overwrite)  # before the work
    text = standalone_html(editor, view, **options).encode("utf-8")
    with atomic_write(path, overwrite=overwrite, needed=len(text)) as stream:
        stream.write(text)


def check_page_path(path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Refuse a path without .html, or one that cannot be written."""
    place = as_path(path)
    if place.suffix.lower() not in (".html", ".htm"):
        raise DeformError(f"{place.name}: a page is written as HTML; name it {place.stem}.html.")
    check_target(path, overwrite=overwrite)


# -- the volume and its displacement ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ExportedView:
    """The part of a live view that goes into the page."""

    volume: Volume
    shown: PackedVolume
    step: Step | None
    traits: dict[str, Any]
    chunks: list[dict[str, Any]]
    field: dict[str, Any]
    background: str
    still: bytes
    outline: dict[str, Any]
    cut_off: dict[str, Any]

    @property
    def about(self) -> str:
        """Size of the volume, and its size before a reduction."""
        now, before = ((" x ".join(map(str, g.shape[::-1]))) for g in (self.shown.volume.grid, self.volume.grid))
        return f"{now} voxels" + ("" if now == before else f", reduced from {before}")


def view_part(editor: Editor, view: LiveView, limit: int | None, report: Progress) -> ExportedView:
    """The part of a live view that goes into a page, with at most so many voxels."""
    snapshot = view.snapshot()
    volume, output = snapshot.volume, snapshot.scene.output
    field, index = _link(editor, view, snapshot)
    report(0.05)
    # The same bytes: the colours of the page are of them.
    shown, chunks = _packed_chunks(volume, limit, snapshot.scene.shown, report)
    maps = field_textures(field, shown, output, snapshot.map_size, min(snapshot.space_size, _SPACE_SIZE))
    box, plane = output or volume.grid, _replicated_plane(field)
    traits = {
        **plain_traits(view),
        "volume_info": shown.info(),
        "editor": "IPY_MODEL_editor",
        "editor_map": index,
        "tissue_check": _tissue_check(volume, shown, box) if plane is None else None,
    }
    scene = replace(snapshot.scene, shown=shown, field=field)
    still = as_png(render_scene(scene, _STILL))
    report(0.9)
    return ExportedView(
        volume,
        shown,
        _step_of(editor, _extrusion(field)),
        traits,
        chunks,
        _message(maps, shown, index),
        scene.background,
        still,
        {} if plane is None else outline_of_volume(volume, plane, output),
        {"sides": side_names(box), "text": cut_off_text((_SIDES,))},
    )


def _packed_chunks(
    volume: Volume, limit: int | None, seen: PackedVolume, report: Progress
) -> tuple[PackedVolume, list[dict[str, Any]]]:
    """The voxels and their pieces; without a limit as many voxels as :data:`MOST_BYTES` hold."""
    most = LIMIT if limit is None else limit
    while True:
        shown = packed_volume(volume, most, _LARGEST, seen.window)
        shown = replace(shown, share=seen.share, id=_digest(shown))
        report(0.1)
        chunks = []
        for k in range(shown.chunks):
            chunks.append(_chunk(shown, k))
            report(0.1 + 0.6 * (k + 1) / shown.chunks)
        size = sum(len(chunk["packed"]["base64"]) for chunk in chunks)
        if limit is not None or size <= MOST_BYTES:
            return shown, chunks
        most = int(shown.volume.grid.size * min(0.9, MOST_BYTES / size))


def _tissue_check(volume: Volume, shown: PackedVolume, box: Grid) -> dict[str, Any]:
    """Values above which bytes, from 0 to 1, are foreground, and how far beyond the box it has left it, in shares."""
    low, high = shown.window
    level = (foreground_level(volume) - low) / (high - low)
    return {
        "tissue": float(np.clip(level, 0.0, 254 / 255)),
        "beyond": (leaving_voxels(box) / np.array(box.shape[::-1])).tolist(),
    }


def _link(editor: Editor, view: LiveView, snapshot: Snapshot) -> tuple[AbstractField, int]:
    """Field of the view with the current points, and the index of the map that they make."""
    if view.editor is not None and view.editor is not editor:
        raise DeformError("the view follows another editor; give that one, or call follow() with this one first.")
    fit = editor.fit()
    if view.editor is None or snapshot.field is None:
        step = editor.step()
        assert step.plane is not None
        return with_map(extrude(step.plane, snapshot.volume.finest_grid, (Identity(2),), step.weights()), 0, fit), 0
    index = int(view.editor_map)
    _extrusion(snapshot.field)
    return with_map(snapshot.field, index, fit), index


def _extrusion(field: AbstractField) -> Extrusion:
    """The last step; of a cut one the extrusion of one of its regions, which has the same plane and depths."""
    last = cut_plane(field.then if isinstance(field, Composed) else field, MOST_MAPS)
    if last is None:
        raise DeformError("the view was shown another deformation since it follows the editor; call follow() again.")
    return last.first


def _replicated_plane(field: AbstractField) -> Plane | None:
    """The picture on which all of a field is seen: it moves every depth equally; None where it does not."""
    last = None if isinstance(field, Composed) else _extrusion(field)
    return last.plane if last is not None and last.is_replication and len(last.maps) == 1 else None


def _step_of(editor: Editor, field: Extrusion) -> Step | None:
    """The step that makes this field of the editor's points; None where other points are needed too."""
    if editor.picture is None or len(field.maps) > 1:
        return None
    weights = np.asarray(field.weights)[0]
    if bool((weights == 1).all()):
        return editor.step()
    curve = np.interp(np.linspace(0.0, 1.0, max(2, len(weights))), field.knots, weights)
    return editor.step(extrusion="modulate", curve=tuple(curve.tolist()))


def _digest(shown: PackedVolume) -> str:
    """A name of the content instead of a random one: the same page for the same input."""
    about = f"{shown.volume.shape} {shown.window} {shown.factors} "
    return hashlib.sha256(about.encode() + np.ascontiguousarray(shown.volume.values).tobytes()).hexdigest()[:32]


def _chunk(shown: PackedVolume, index: int) -> dict[str, Any]:
    """A piece of the voxels, or of the differences from slice to slice where these take less."""
    first, (_, ny, nx) = index * shown.slices, shown.volume.shape
    voxels = np.ascontiguousarray(shown.volume.values[first : first + shown.slices])
    differences = voxels.copy()
    differences[1:] -= voxels[:-1]  # modulo 256
    plain, lagged = (compress(v.tobytes()) for v in (voxels, differences))
    lag = ny * nx if len(lagged) < len(plain) else 0
    return {"start": first * ny * nx, "lag": lag, "packed": as_base64(lagged if lag else plain)}


def _message(maps: FieldTextures, shown: PackedVolume, index: int) -> dict[str, Any]:
    """The message ``field``; the map that the page fits by itself is left empty, as that of no points."""
    step = min(shown.volume.grid.spacing) * _EXACTNESS
    half = ("space", "depths") if maps.content.space is not None and maps.content.space.get("cut") else ()
    buffers: dict[str, NDArray[Any]] = {
        name: np.frombuffer(maps.buffer(name), "<f2" if name in half else "<f4") for name in maps.content.buffers
    }
    planar = maps.content.planar
    if planar is not None:
        layers, cut = planar["shape"][0], planar["cut"]
        count = layers // len(cut["sides"]) if cut else layers
        own = buffers["maps"].reshape(layers, -1).copy()
        own[index::count] = 0
        if cut and count == 1:  # the page divides its only map by itself, and measures the distances
            own, planar = own[:1], {**planar, "shape": [1, *planar["shape"][1:]], "cut": None}
            del buffers["distances"]
        buffers["maps"] = _round(own, step)
    for name in ("space", "distances"):
        if name in buffers and name not in half:
            buffers[name] = _round(buffers[name], step)
    follow: FollowData = {"index": index, "points": []}
    message = FieldMaps(
        **{**maps.fields(), "planar": planar, "buffers": list(buffers)}, seq=0, follow=follow, moved=None
    )
    return {"content": message.content(), "buffers": [pack(b.tobytes()) for b in buffers.values()]}


def _round(values: NDArray[np.float32], step: float) -> NDArray[np.float32]:
    unit = 2.0 ** np.floor(np.log2(step))  # a power of two: the last digits of every number are then zero
    return (np.round(values / unit) * unit).astype("<f4")


def _document(editor: Editor, part: ExportedView | None, name: str) -> dict[str, Any] | None:
    """The document that the page fills with its points; None where there is none that these points make alone."""
    step = part.step if part else editor.step() if editor.picture is not None else None
    if step is None:
        return None
    volume = VolumeReference.of(part.volume) if part else None
    document: dict[str, Any] = json.loads(to_json(Deformation((step,), name, volume)))
    return document
