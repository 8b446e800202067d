"""Still pictures of a view by the ray caster in Python: for browsers without WebGL2, for scripts and for tests.

A still is also the picture that a widget leaves in a notebook, for GitHub, nbviewer and PDF, where no front end runs.
For machines without OpenGL there is a scene that the package itself draws, and the choice between it and VTK's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from deformnb._typing import Image, Progress
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.core_volume import color_bytes, draw_core, draw_core_mip
from deformnb.imaging.display import DisplaySettings
from deformnb.imaging.occlusion import AMBIENT_CELL, ambient_light
from deformnb.imaging.vtk_volume import gl_status
from deformnb.rbf.fields import AbstractField
from deformnb.volume.clip import WHOLE, Clip, ClipBox, check_clip, framed_box
from deformnb.volume.coarsening import block_means, coarser
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import Warper
from deformnb.widgets.camera import (
    BACKGROUNDS,
    COMPARISONS,
    INKS,
    camera_of,
    checked_camera,
    comparison_image,
    partial_progress,
)
from deformnb.widgets.image_encoding import PREVIEW_SHARE, PREVIEW_SIZE, as_png
from deformnb.widgets.packed_volume import MOST_VOXELS_SENT, PackedVolume, factors_of, packed_volume
from deformnb.widgets.textures import MAP_SIZE
from deformnb.widgets.vtk.folds import Folding
from deformnb.widgets.vtk.scene import VtkScene

_PREVIEW_VOXELS = 128**3  # take a processor 0.15 to 0.3 s, with this share of the pixels: a cell waits for its preview


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """All that a picture of a view follows from; equal where the picture is.

    Parameters
    ----------
    shown : the content, before the deformation.
    output : grid whose box is seen.
    camera : as in :class:`~deformnb.widgets.camera.CameraTrait`.
    background : a name of :data:`BACKGROUNDS`.
    shows : a name of :data:`~deformnb.widgets.camera.SHOWS`.
    clip : the part of the box that is seen.
    ambient_occlusion : whether hollows are darker in the projection "shaded".
    frame : the part of the volume's box that the camera frames, see :func:`~deformnb.widgets.camera.framed_box`.
    """

    shown: PackedVolume
    field: AbstractField | None
    output: Grid | None
    camera: dict[str, Any]
    transfer: TransferFunction
    projection: str
    background: str
    shows: str
    clip: Clip = WHOLE
    ambient_occlusion: bool = False
    frame: Clip = WHOLE

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SceneDescription):
            return NotImplemented
        mine, others = vars(self), vars(other)
        # Fields are compared by identity: they never change, and comparing their values costs as much as a picture.
        return all(mine[name] is others[name] or (name in _PLAIN and mine[name] == others[name]) for name in mine)

    __hash__ = None  # type: ignore[assignment]

    def voxel_field(self, is_original: bool) -> AbstractField | None:
        """The field that the voxels go through; None where they stay as they are."""
        return None if is_original or self.field is None or self.field.is_identity else self.field


_PLAIN = ("output", "camera", "transfer", "projection", "background", "shows", "clip", "ambient_occlusion", "frame")


def render_scene(
    scene: SceneDescription, size: tuple[int, int], most: int | None = None, progress: Progress | None = None
) -> Image:
    """A picture of a scene, (height, width, 3); original and deformed share it in the modes that show both.

    Parameters
    ----------
    most : voxels at most, each sampled once instead of twice along an axis; default is as many as there are.
    progress : called with the finished share from 0 to 1.
    """

    def draw(size: tuple[int, int], is_original: bool, start: float, end: float) -> Image:
        return _render(scene, size, is_original, most, partial_progress(progress, start, end))

    return _compose(scene.shows, size, draw)


def _compose(shows: str, size: tuple[int, int], draw: Callable[[tuple[int, int], bool, float, float], Image]) -> Image:
    """A picture, or two, of a display mode; ``draw`` takes size, whether original, and its share of the progress."""
    if shows not in ("side_by_side", *COMPARISONS):
        return draw(size, shows == "original", 0.0, 1.0)
    (width, height), is_whole = size, shows in COMPARISONS
    left = width if is_whole else width // 2
    return comparison_image(
        shows,
        draw((left, height), True, 0.0, 0.5),
        draw((width if is_whole else width - left, height), False, 0.5, 1.0),
    )


def _render(
    scene: SceneDescription,
    size: tuple[int, int],
    is_original: bool,
    most: int | None,
    progress: Progress | None = None,
) -> Image:
    box = scene.output or scene.shown.volume.grid
    field = scene.voxel_field(is_original)
    warped = 0.0 if field is None else 0.3
    seen = _warped_volume(scene, field, box, most, partial_progress(progress, 0.0, warped))
    frame = framed_box(scene.shown.original, scene.output, scene.frame) if scene.frame != WHOLE else box
    camera, part = camera_of(scene.camera, frame, size[0] / size[1]), _part(scene)
    background, rest = BACKGROUNDS[scene.background], partial_progress(progress, warped, 1.0)
    if scene.projection == "mip":
        return draw_core_mip(
            seen, camera, size, 255 * scene.shown.white, INKS[scene.background], background, part=part, progress=rest
        )
    # Bytes instead of the volume's own values: the front end has those too, and a colour is looked up by value.
    transfer = scene.transfer.quantize(*scene.shown.window)
    projection: Any = scene.projection
    return draw_core(
        seen,
        camera,
        size,
        transfer,
        background,
        projection=projection,
        spacing=None if most is None else camera.sample_distance(seen.grid, size[1], per_voxel=1),
        part=part,
        ambience=_ambience(scene.shown.volume, transfer, field, box) if scene.ambient_occlusion else None,
        progress=rest,
    )


def _warped_volume(
    scene: SceneDescription, field: AbstractField | None, box: Grid, most: int | None, progress: Progress | None
) -> Volume:
    """The voxels of a scene, deformed or as they are; if there are too many, means of some or fewer ones."""
    volume = scene.shown.volume
    factors = (1, 1, 1) if most is None else factors_of(volume.grid if field is None else box, most, most)
    if field is not None:
        return Warper(volume, output=coarser(box, factors))(field, progress=progress)
    if max(factors) == 1:
        return volume
    values = (
        volume.values[tuple(slice(None, None, factor) for factor in factors[::-1])]
        if volume.is_labels
        else (block_means(volume.values, factors) + 0.5).astype(np.uint8)
    )
    return replace(volume, values=values, grid=coarser(volume.grid, factors))


def _part(scene: SceneDescription) -> ClipBox | None:
    return ClipBox.of(scene.shown.volume.grid, scene.clip, scene.output or scene.shown.original)


def _ambience(volume: Volume, transfer: TransferFunction, field: AbstractField | None, box: Grid) -> Volume:
    """The light that reaches each place, taken from the origin of its tissue, as the live view does."""
    light = ambient_light(volume, transfer)
    if field is None:
        return light
    return Warper(light, output=coarser(box, (AMBIENT_CELL,) * 3), fill=1.0)(field)


def preview_png(scene: SceneDescription) -> bytes:
    """A small picture with captions as a PNG, quickly: from few voxels and pixels, and without ambient occlusion."""
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    pixels = round(PREVIEW_SHARE * PREVIEW_SIZE[0]), round(PREVIEW_SHARE * PREVIEW_SIZE[1])
    drawn = render_scene(replace(scene, ambient_occlusion=False), pixels, _PREVIEW_VOXELS)
    canvas = Pillow.fromarray(drawn).resize(PREVIEW_SIZE, Pillow.Resampling.BICUBIC)
    both = ["original", "deformed"]
    captions = {"original": both[:1], "side_by_side": both, "wipe": both, "fade": ["original over deformed"]}.get(
        scene.shows, []
    )
    draw, ink = ImageDraw.Draw(canvas), color_bytes(INKS[scene.background])
    for k, caption in enumerate(captions):
        draw.text((10 + k * canvas.width / len(captions), 8), caption, fill=ink, font=ImageFont.load_default(14))
    return as_png(np.asarray(canvas))


# Voxels and pixels of a quick picture: the ray caster takes some 0.2 s. Always the same, for it compiles for each.
_QUICK_VOXELS = 96**3
_QUICK_SHARE = 0.35

_LIMIT, _LARGEST = MOST_VOXELS_SENT, 2048

# A still of 1600 x 1200 takes the ray caster 1 s for 96^3 voxels, and VTK without a GPU 5 s and 10 s more for its
# shader. The time of the ray caster grows with the voxels, that of VTK with the pixels.
_MOST_BY_CORE = 160**3


class CoreScene:
    """One volume as the ray caster draws it; parameters and methods are those of ``VtkScene``."""

    path = "core"

    def __init__(
        self,
        volume: Volume,
        size: tuple[int, int] = (720, 540),
        *,
        transfer: TransferFunction | PresetName = "specimen",
        projection: str = "shaded",
        background: str = "dark",
    ) -> None:
        self._size, self._projection, self._background = size, projection, background
        self._wanted_transfer, self._camera = transfer, checked_camera({})
        self._shows = "deformed"
        self._parts = {"clip": WHOLE, "frame": WHOLE}  # of the box: what is seen, and what the camera frames
        self._has_occlusion = False
        self.folding = Folding()
        self.set_volume(volume)

    @property
    def plotter(self) -> Any:
        """There is none."""
        raise DeformError("there is no plotter: VTK cannot draw here. Install libegl1 and libgl1, then restart.")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture in pixels."""
        return self._size

    @property
    def volume(self) -> Volume:
        """Volume before the deformation."""
        return self._volume

    def set_volume(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""
        self._volume, self._shown = volume, packed_volume(volume, _LIMIT, _LARGEST)
        self._field: AbstractField | None = None
        self._output: Grid | None = None
        self.folding.set(None)
        self.set_transfer(self._wanted_transfer)

    def set_field(self, field: Deformation | AbstractField | None, output: Grid | None = None) -> None:
        """Set the field that deforms the volume."""
        wanted = field.field(output or self._volume.grid) if isinstance(field, Deformation) else field
        if wanted is not None and wanted.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._field, self._output = wanted, output
        self.folding.set(None, wanted, output or self._volume.grid)

    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        """Show with other colours and opacities."""
        self._wanted_transfer = transfer
        self._transfer = as_transfer(transfer, self._volume)

    def set_projection(self, projection: str) -> None:
        """Show shaded, as composite or mip."""
        self._projection = projection

    def set_background(self, background: str) -> None:
        """A dark or a light one."""
        self._background = background

    def set_camera(self, camera: dict[str, Any]) -> None:
        """Set the camera."""
        self._camera = checked_camera(camera)

    def set_shows(self, shows: str) -> None:
        """Set the display mode."""
        self._shows = shows

    def set_clip(self, clip: Clip) -> None:
        """Clip the box."""
        self._parts["clip"] = check_clip(clip)

    def set_frame(self, frame: Clip) -> None:
        """Frame a part of the volume's box, as a view's ``frame``."""
        self._parts["frame"] = check_clip(frame)

    def set_ambient_occlusion(self, is_on: bool) -> None:
        """Darken hollows, which VTK cannot: off from the start, so that both draw the same."""
        self._has_occlusion = is_on

    def set_size(self, size: tuple[int, int]) -> None:
        """Another (width, height) in pixels."""
        self._size = size

    def render(
        self,
        *,
        scale: float = 1.0,
        coarseness: float = 1.0,
        shows: str | None = None,
        bands: int = 1,
        interrupted: Callable[[], bool] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Image | None:
        """The picture, (height, width, 3) uint8; below full scale always the same quick one."""
        width, height = (max(16, round(n * (_QUICK_SHARE if scale < 1 else 1))) for n in self._size)
        scene = SceneDescription(
            self._shown,
            self._field,
            self._output,
            self._camera,
            self._transfer,
            self._projection,
            self._background,
            self._shows if shows is None else shows,
            self._parts["clip"],
            self._has_occlusion,
            self._parts["frame"],
        )
        return render_scene(scene, (width, height), _QUICK_VOXELS if scale < 1 else None, progress)

    def close(self) -> None:
        """Nothing is held."""


ViewMethodName: TypeAlias = Literal["auto", "texture", "array", "core"]
"""Names of the ways to draw a view in Python."""

VIEW_METHODS: tuple[ViewMethodName, ...] = get_args(ViewMethodName)


def make_scene(
    volume: Volume,
    size: tuple[int, int],
    method: str = "auto",
    *,
    map_size: int = MAP_SIZE,
    space_size: int = 64,
    **looks: Any,
) -> tuple[VtkScene | CoreScene, str]:
    """The best scene that works here, and a notice for users, or an empty text.

    Parameters
    ----------
    method : "texture" deforms in VTK's shader, "array" warps the voxels, "core" draws without VTK; "auto" takes the
        first that works.
    looks : transfer, projection and background.
    """
    if method not in VIEW_METHODS:
        raise DeformError(f"unknown method {method!r}; choose one of {', '.join(VIEW_METHODS)}.")
    works, found, remedy = gl_status() if method != "core" else (False, "", "")
    if works:
        return VtkScene(volume, size, method=method, map_size=map_size, space_size=space_size, **looks), ""
    notice = f"{found}. The package draws the pictures itself, which is slower. For VTK: {remedy}." if found else ""
    return CoreScene(volume, size, **looks), notice


def display_scene(
    volume: Volume, transfer: TransferFunction, size: tuple[int, int], seen: DisplaySettings, method: str = "auto"
) -> VtkScene | CoreScene:
    """A scene that shows a volume as a view does; used and closed by the thread that calls this."""
    scene, _ = make_scene(
        volume, size, method, transfer=transfer, projection=seen.projection, background=seen.background
    )
    scene.set_camera(dict(seen.camera))
    scene.set_shows(seen.shows)
    scene.set_clip(seen.clip)
    scene.set_frame(seen.frame)
    scene.folding.show = seen.show_folds
    if isinstance(scene, CoreScene):
        scene.set_ambient_occlusion(seen.ambient_occlusion)
    return scene


class StillAsSeen:
    """One picture of a volume as a view shows it that does not draw by VTK; soon there without a GPU too.

    The ray caster draws it, except large volumes and folds in red, which it does not show.
    Parameters are those of :func:`display_scene`.
    """

    def __init__(
        self, volume: Volume, transfer: TransferFunction, size: tuple[int, int], seen: DisplaySettings
    ) -> None:
        self._arguments = volume, transfer, size, seen
        self.scene = display_scene(*self._arguments, "core" if volume.grid.size <= _MOST_BY_CORE else "auto")

    def set_field(self, field: AbstractField | None, output: Grid | None = None) -> None:
        """Set the field that deforms the volume."""
        self.scene.set_field(field, output)
        if isinstance(self.scene, CoreScene) and self.scene.folding.remark and gl_status()[0]:
            self.scene = display_scene(*self._arguments)
            self.scene.set_field(field, output)

    def render(self, *, bands: int = 1, progress: Callable[[float], None] | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8."""
        return self.scene.render(bands=bands, progress=progress)

    def close(self) -> None:
        """Release the scene."""
        self.scene.close()
