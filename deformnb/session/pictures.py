"""The pictures of a session: projection, slice, window, colours and opacities, and their sources."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import traitlets

from deformnb._typing import Floats, Progress
from deformnb.checks import check_choice, check_window
from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.imaging.projection import OF_CHANNELS, PROJECTIONS, ProjectionName, project, project_channels
from deformnb.rbf.fields import AbstractField
from deformnb.session.editing import Editing
from deformnb.session.latest import Latest
from deformnb.session.view_state import ViewState
from deformnb.volume.channels import ChannelDisplay, Channels
from deformnb.volume.clip import Clip, framed_box
from deformnb.volume.colour_maps import COLOUR_MAPS, ColourMapName
from deformnb.volume.plane import Picture, Plane, Slices
from deformnb.volume.transfer import PresetName, TransferFunction, preset
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import coarse_tissue, foreground_shares
from deformnb.warping.warper import warp_all

_SUBJECT_VOXELS = 32  # along an axis at most, of the foreground that is projected on an oblique picture


@dataclass(frozen=True)
class PictureSettings:
    """All that a picture in its automatic window depends on but the voxels.

    Parameters
    ----------
    method : projection, a name of :data:`~deformnb.imaging.projection.PROJECTIONS`.
    depth : of a "slice"; None for other projections.
    transfer : colours and opacities of the projections that have them; else None.
    displays : of the channels, where the picture shows them in colours; else empty.
    """

    plane: Plane
    method: ProjectionName
    depth: float | None = None
    transfer: TransferFunction | None = None
    displays: tuple[ChannelDisplay, ...] = ()

    def picture(self, volume: Volume, progress: Progress | None = None) -> Picture:
        """The picture of a volume."""
        return project(volume, self.plane, self.method, transfer=self.transfer, depth=self.depth, progress=progress)

    def picture_of_channels(self, channels: Channels, progress: Progress | None = None) -> Picture:
        """The picture of channels in their colours."""
        method: Any = self.method
        return project_channels(
            channels, self.plane, method, displays=self.displays, depth=self.depth, progress=progress
        )


class _Drawn(NamedTuple):
    """Values on which a picture depends."""

    earlier: Deformation
    settings: PictureSettings


class _Styled(NamedTuple):
    """Values on which the colours of a grey picture depend."""

    picture: Picture
    window: tuple[float, float]
    colour_map: ColourMapName


@dataclass(frozen=True)
class _Made:
    """The last of each thing that was made for the pictures."""

    base: Latest[Deformation, Volume] = field(default_factory=Latest)
    base_channels: Latest[Deformation, Channels] = field(default_factory=Latest)
    picture: Latest[_Drawn, Picture] = field(default_factory=Latest)
    deformed: Latest[_Drawn, Picture] = field(default_factory=Latest)
    styled: Latest[_Styled, Picture] = field(default_factory=Latest)
    transfer: Latest[PresetName | TransferFunction, TransferFunction] = field(default_factory=Latest)


def _drags(step: Step) -> bool:
    return any(bool(points.displacement[points.active].any()) for points in step.maps)


class Pictures(traitlets.HasTraits):
    """The picture on which a document is edited, and its view state.

    Parameters
    ----------
    volume, channels : that are shown; channels None where there are none.
    editing : the document.
    view_state : first values of the traits below.

    Attributes
    ----------
    method : projection of the picture, a name of :data:`~deformnb.imaging.projection.PROJECTIONS`.
    depth : position of a "slice" along the normal, from the middle of the volume.
    window : values shown as black and white in grey pictures, set manually; None for the automatic window of each.
    colour_map : of grey pictures, a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`.
    channel_displays : colour, window and visibility of each of the channels, a
        :class:`~deformnb.volume.channels.ChannelDisplay`; empty where there are none.
    ambient_occlusion : whether hollows of the volume are darker in a live view.
    transfer : colours and opacities, a :class:`~deformnb.volume.transfer.TransferFunction` or the name of a preset.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> from deformnb.session import Session
    >>> pictures = Session(PHANTOMS["bar"].make((8, 8, 16)), view="+y").pictures
    >>> pictures.method = "slice"
    >>> pictures.picture().raster.shape, pictures.slices.count
    ((8, 16), 8)
    """

    method: ProjectionName = traitlets.Enum(list(PROJECTIONS), "mip")  # type: ignore[assignment]
    depth = traitlets.Float(0.0)
    window = traitlets.Any(None)
    colour_map: ColourMapName = traitlets.Unicode(COLOUR_MAPS[0])  # type: ignore[assignment]
    channel_displays = traitlets.Tuple()
    ambient_occlusion = traitlets.Bool(True)
    transfer = traitlets.Any("specimen")

    def __init__(self, volume: Volume, channels: Channels | None, editing: Editing, **view_state: Any) -> None:
        self._volume, self._channels, self._editing = volume, channels, editing
        self._made = _Made()
        if channels is not None:
            view_state.setdefault("channel_displays", channels.displays())
        super().__init__(**view_state)

    # -- sources of the pictures ---------------------------------------------------------------------------------------

    def base(self) -> Volume:
        """The volume after the steps before the one being edited: the content of the picture."""
        return self._base_of(self._editing.state.earlier)

    def _base_of(self, earlier: Deformation) -> Volume:
        if not earlier.steps:
            return self._volume
        grid = self._editing.grid
        return self._made.base.of(lambda: earlier, lambda steps: warp_all([self._volume], steps.field(grid))[0])

    def _base_channels_of(self, earlier: Deformation) -> Channels:
        channels, grid = self._channels, self._editing.grid
        assert channels is not None
        if not earlier.steps:
            return channels
        return self._made.base_channels.of(
            lambda: earlier, lambda steps: channels.with_volumes(warp_all(channels.volumes, steps.field(grid)))
        )

    def before(self) -> AbstractField | None:
        """The backward displacement of the steps before the one being edited; None if there are none."""
        earlier = self._editing.state.earlier
        return earlier.field(self._editing.grid) if earlier.steps else None

    # -- the picture ---------------------------------------------------------------------------------------------------

    def picture(self, progress: Progress | None = None) -> Picture:
        """The picture that is being edited, before the step that is edited; cached until something else is requested.

        A grey one is in the colour map of the session, and in the window that was set manually, if one was.
        """
        picture = self.automatic_picture(progress)
        style = _Styled(picture, self.window or picture.window, self.colour_map)
        if (picture.window, picture.colour_map) == style[1:]:
            return picture
        return self._made.styled.of(
            lambda: style, lambda _: replace(picture, window=style.window, colour_map=style.colour_map)
        )

    def automatic_picture(self, progress: Progress | None = None) -> Picture:
        """The picture that is being edited, in its automatic window; cached until something else is requested."""

        def draw(wanted: _Drawn) -> Picture:
            if wanted.settings.displays:
                return wanted.settings.picture_of_channels(self._base_channels_of(wanted.earlier), progress)
            return wanted.settings.picture(self._base_of(wanted.earlier), progress)

        return self._made.picture.of(lambda: _Drawn(self._editing.state.earlier, self.settings), draw)

    @property
    def changes_with_depth(self) -> bool:
        """True if the picture of the deformed volume is not the picture, deformed: the edited step depends on depth."""
        step = self._editing.step
        return (
            step.plane is not None
            and step.enabled
            and step.extrusion != "replicate"
            and (bool(step.cut_regions) or any(part.motion is not None for part in step.parts) or _drags(step))
        )

    def deformed_picture(self, progress: Progress | None = None) -> Picture | None:
        """The picture of the volume after the edited step, in the window of :meth:`picture`; cached.

        None where the map is the same at every depth: then it is the picture itself, deformed by the map of the plane.
        """
        edited = self._editing.state
        if not self.changes_with_depth:
            return None
        now = replace(
            edited.deformation,
            steps=(*edited.earlier.steps, edited.step),
            keyframes=(),
        )

        def draw(wanted: _Drawn) -> Picture:
            box = wanted.earlier.output
            output = None if box is None else self._volume.to_own_resolution(box)
            displacement = wanted.earlier.field(self._editing.grid)
            if wanted.settings.displays and self._channels is not None:
                channels = self._channels.with_volumes(warp_all(self._channels.volumes, displacement, output=output))
                return wanted.settings.picture_of_channels(channels, progress)
            return wanted.settings.picture(warp_all([self._volume], displacement, output=output)[0], progress)

        found = self._made.deformed.of(lambda: _Drawn(now, self.settings), draw)
        own = self.picture(progress)
        return found if found.values.ndim == 3 else replace(found, window=own.window, colour_map=own.colour_map)

    @property
    def settings(self) -> PictureSettings:
        """The settings on which the picture depends."""
        return PictureSettings(
            self._editing.plane,
            self.method,
            self.depth if self.method == "slice" else None,
            self.transfer_function if self.method in ("composite", "shaded") else None,
            self.channel_displays if self.shows_channels else (),
        )

    @property
    def depth_range(self) -> tuple[float, float]:
        """Range of slice depths, from the middle of the volume."""
        return self._editing.plane.depth_range(self._editing.grid)

    @property
    def slices(self) -> Slices:
        """The slices that the picture can show, by their depths."""
        return self._editing.plane.slices(self._volume.grid)

    @cached_property
    def frame(self) -> Clip:
        """The part of the volume's box that holds what is seen of it, by which views are framed; found once."""
        return foreground_shares(self._volume)

    @property
    def subject_box(self) -> tuple[float, float, float, float]:
        """The box (a0, a1, b0, b1) on the picture of the part of the volume that holds its foreground.

        The corners of that part lie outside the foreground: on a picture along no axis of the volume, far outside.
        There the foreground itself is projected.
        """
        plane, grid = self._editing.plane, self._volume.grid
        is_along_an_axis = np.abs(np.asarray(grid.direction).T @ plane.normal).max() > 1 - 1e-6
        places = framed_box(grid, None, self.frame).corners() if is_along_an_axis else self._framed_tissue
        on_plane = plane.to_plane(places)[:, :2]
        (a0, b0), (a1, b1) = on_plane.min(axis=0), on_plane.max(axis=0)
        return float(a0), float(a1), float(b0), float(b1)

    @cached_property
    def _framed_tissue(self) -> Floats:
        """Corners (n, 3) of the coarse foreground's voxels in the framed part, or of that part where there are none."""
        box, tissue = framed_box(self._volume.grid, None, self.frame), coarse_tissue(self._volume, _SUBJECT_VOXELS)
        index = np.argwhere(tissue.values)[:, ::-1] + np.indices((2, 2, 2)).reshape(3, 8, 1).transpose(1, 2, 0) - 0.5
        assert isinstance(tissue.lattice, Grid)
        places = tissue.lattice.index_to_point(index.reshape(-1, 3))
        at = box.point_to_index(places)
        places = places[((at >= -0.5) & (at <= np.array(box.shape[::-1]) - 0.5)).all(axis=1)]
        return places if len(places) else box.corners()

    # -- channels ------------------------------------------------------------------------------------------------------

    @property
    def shows_channels(self) -> bool:
        """True where the picture shows channels in their colours."""
        return self._channels is not None and self.method in OF_CHANNELS

    def show_channel(self, index: int, **changes: Any) -> None:
        """Change colour, window or visibility of a channel.

        Parameters
        ----------
        index : of the channel, from 0.
        changes : fields of :class:`~deformnb.volume.channels.ChannelDisplay`.
        """
        displays = list(self.channel_displays)
        if not 0 <= index < len(displays):
            raise DeformError(f"there is no channel {index}; there are {len(displays)} that have a colour.")
        displays[index] = replace(displays[index], **changes)
        self.channel_displays = tuple(displays)

    # -- the view state ------------------------------------------------------------------------------------------------

    @property
    def transfer_function(self) -> TransferFunction:
        """Colours and opacities, a preset fitted to the volume."""
        return self._made.transfer.of(
            lambda: self.transfer, lambda chosen: preset(chosen, self._volume) if isinstance(chosen, str) else chosen
        )

    @property
    def view_state(self) -> ViewState:
        """View state at this moment; the depth only where it is the slice of the last step."""
        state = self._editing.state
        is_slice = self.method == "slice" and state.index == len(state.deformation.steps) - 1
        return ViewState(
            self.transfer,
            self.method,
            self.depth if is_slice else None,
            self.window,
            self.colour_map,
            self.ambient_occlusion,
        )

    def restore(self, stored: ViewState, *, besides: Container[str] = (), is_other: bool = False) -> None:
        """Take over the view state of a document, as far as it is stored.

        Parameters
        ----------
        besides : names of traits that stay unchanged.
        is_other : the document was made on another volume.
        """
        for name, value in stored.traits(is_other=is_other).items():
            if name not in besides:
                self.set_trait(name, float(np.clip(value, *self.depth_range)) if name == "depth" else value)

    @traitlets.validate("transfer")
    def _valid_transfer(self, proposal: Any) -> Any:
        value: Any = proposal["value"]
        if isinstance(value, str):
            preset(proposal["value"], self._volume)
        elif not isinstance(value, TransferFunction):
            raise DeformError(f"transfer must be a TransferFunction or the name of a preset, got {value!r:.60}.")
        return value

    @traitlets.validate("window")
    def _valid_window(self, proposal: Any) -> tuple[float, float] | None:
        return None if proposal["value"] is None else check_window(proposal["value"])

    @traitlets.validate("colour_map")
    def _valid_colour_map(self, proposal: Any) -> str:
        return check_choice(proposal["value"], COLOUR_MAPS, "colour map")

    @traitlets.validate("channel_displays")
    def _valid_displays(self, proposal: Any) -> tuple[ChannelDisplay, ...]:
        given, count = tuple(proposal["value"]), 0 if self._channels is None else len(self._channels.coloured_channels)
        if len(given) != count or not all(isinstance(one, ChannelDisplay) for one in given):
            raise DeformError(
                f"channel_displays are a ChannelDisplay for each of the {count} channels that have a "
                f"colour, got {given!r:.60}."
            )
        return given
