"""A scene for machines without OpenGL, which the package itself draws, and the choice between it and VTK's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deformnb.clipping import WHOLE, Clip, checked_clip
from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.exports import Seen
from deformnb.fields import AbstractField
from deformnb.render import gl_status
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Grid, Volume
from deformnb.widgets.camera import Image, checked_camera
from deformnb.widgets.shown_volume import shown_volume
from deformnb.widgets.stills import Scene, render_scene
from deformnb.widgets.vtk_folds import Folding
from deformnb.widgets.vtk_scene import VtkScene

# Voxels and pixels of a quick picture: the core takes some 0.2 s for them. Always the same, for it compiles for each.
_QUICK_VOXELS = 96**3
_QUICK_SHARE = 0.35

_LIMIT, _LARGEST = 256**3, 2048

# A still of 1600 x 1200 takes the core 1 s for 96^3 voxels, and VTK without a graphics card 5 s and 10 s more for its
# shader. The core's time grows with the voxels, that of VTK with the pixels.
_MOST_BY_CORE = 160**3


class CoreScene:
    """One volume as the core draws it; parameters and methods are those of ``VtkScene``."""

    path = "core"

    def __init__(self, volume: Volume, size: tuple[int, int] = (720, 540), *,
                 transfer: TransferFunction | str = "specimen", projection: str = "shaded",
                 background: str = "dark") -> None:
        self._size, self._projection, self._background = size, projection, background
        self._wanted_transfer, self._camera = transfer, checked_camera({})
        self._shows = "deformed"
        self._clip = WHOLE
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
        """What is shown, before the deformation."""
        return self._volume

    def set_volume(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""
        self._volume, self._shown = volume, shown_volume(volume, _LIMIT, _LARGEST)
        self._field: AbstractField | None = None
        self._output: Grid | None = None
        self.folding.set(None)
        self.set_transfer(self._wanted_transfer)

    def set_field(self, field: Deformation | AbstractField | None, output: Grid | None = None) -> None:
        """Deform what is shown."""
        wanted = field.field(output or self._volume.grid) if isinstance(field, Deformation) else field
        if wanted is not None and wanted.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._field, self._output = wanted, output
        self.folding.set(None, wanted, output or self._volume.grid)

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        """Show with other colours and opacities."""
        self._wanted_transfer = transfer
        self._transfer = preset(transfer, self._volume) if isinstance(transfer, str) else transfer

    def set_projection(self, projection: str) -> None:
        """Show shaded, as composite or mip."""
        self._projection = projection

    def set_background(self, background: str) -> None:
        """A dark or a light one."""
        self._background = background

    def set_camera(self, camera: dict[str, Any]) -> None:
        """Look from another side."""
        self._camera = checked_camera(camera)

    def set_shows(self, shows: str) -> None:
        """What is seen."""
        self._shows = shows

    def set_clip(self, clip: Clip) -> None:
        """Which part of the box is seen."""
        self._clip = checked_clip(clip)

    def set_size(self, size: tuple[int, int]) -> None:
        """Another (width, height) in pixels."""
        self._size = size

    def render(self, *, scale: float = 1.0, coarseness: float = 1.0, shows: str | None = None, bands: int = 1,
               interrupted: Callable[[], bool] | None = None,
               progress: Callable[[float], None] | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8; below full scale always the same quick one."""
        width, height = (max(16, round(n * (_QUICK_SHARE if scale < 1 else 1))) for n in self._size)
        scene = Scene(self._shown, self._field, self._output, self._camera, self._transfer, self._projection,
                      self._background, self._shows if shows is None else shows, self._clip)
        return render_scene(scene, (width, height), _QUICK_VOXELS if scale < 1 else None, progress)

    def close(self) -> None:
        """Nothing is held."""


METHODS = ("auto", "texture", "array", "core")


def make_scene(volume: Volume, size: tuple[int, int], method: str = "auto", *, map_size: int = 192,
               space_size: int = 64, **looks: Any) -> tuple[VtkScene | CoreScene, str]:
    """The best scene that works here, and what people must know about it, or an empty text.

    Parameters
    ----------
    method : "texture" deforms in VTK's shader, "array" warps the voxels, "core" draws without VTK; "auto" takes the
        first that works.
    looks : transfer, projection and background.
    """
    if method not in METHODS:
        raise DeformError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}.")
    works, found, remedy = gl_status() if method != "core" else (False, "", "")
    if works:
        return VtkScene(volume, size, method=method, map_size=map_size, space_size=space_size, **looks), ""
    notice = f"{found}. The package draws the pictures itself, which is slower. For VTK: {remedy}." if found else ""
    return CoreScene(volume, size, **looks), notice


def scene_as_seen(volume: Volume, transfer: TransferFunction, size: tuple[int, int],
                  seen: Seen, method: str = "auto") -> VtkScene | CoreScene:
    """A scene that shows a volume as a view does; used and closed by the thread that calls this."""
    scene, _ = make_scene(volume, size, method, transfer=transfer, projection=seen.projection,
                          background=seen.background)
    scene.set_camera(dict(seen.camera))
    scene.set_shows(seen.shows)
    scene.set_clip(seen.clip)
    scene.folding.show = seen.show_folds
    return scene


class StillAsSeen:
    """One picture of a volume as a view shows it that does not draw by VTK; soon there without a graphics card too.

    The core draws it, but for large volumes and where matter is red because it folds, which the core does not show.
    Parameters are those of :func:`scene_as_seen`.
    """

    def __init__(self, volume: Volume, transfer: TransferFunction, size: tuple[int, int], seen: Seen) -> None:
        self._arguments = volume, transfer, size, seen
        self.scene = scene_as_seen(*self._arguments, "core" if volume.grid.size <= _MOST_BY_CORE else "auto")

    def set_field(self, field: AbstractField | None, output: Grid | None = None) -> None:
        """Deform what is shown."""
        self.scene.set_field(field, output)
        if isinstance(self.scene, CoreScene) and self.scene.folding.remark and gl_status()[0]:
            self.scene = scene_as_seen(*self._arguments)
            self.scene.set_field(field, output)

    def render(self, *, bands: int = 1, progress: Callable[[float], None] | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8."""
        return self.scene.render(bands=bands, progress=progress)

    def close(self) -> None:
        """Give back what is held."""
        self.scene.close()
