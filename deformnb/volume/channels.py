"""Channels: several volumes on one grid, such as the stains of a microscope or the red, green and blue of colours.

Each channel is a plain :class:`~deformnb.volume.volume.Volume`; all of them are deformed by one map.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._entrances import CONVERSIONS, AbstractCellOutput
from deformnb._typing import Float3
from deformnb.checks import check_fields, check_window, finite_array, short_value
from deformnb.errors import DeformError
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volumes

ChannelKind: TypeAlias = Literal["channels", "rgb", "rgba"]
"""Names of the meanings of several channels."""

CHANNEL_KINDS = {"channels": 0, "rgb": 3, "rgba": 4}
"""Meanings of several channels, with their number: any, or the parts of a colour."""

Colour = Float3

_PRIMARY: dict[str, Colour] = {
    "red": (1, 0, 0),
    "green": (0, 1, 0),
    "blue": (0, 0, 1),
    "cyan": (0, 1, 1),
    "magenta": (1, 0, 1),
    "yellow": (1, 1, 0),
    "grey": (1, 1, 1),
}
# Green and magenta are distinct for colour-blind readers, too.
_OF_FEW: dict[int, tuple[str, ...]] = {1: ("grey",), 2: ("green", "magenta")}

_LUMA = (0.299, 0.587, 0.114)  # ITU-R BT.601, as Pillow has them


def usual_colours(count: int) -> tuple[Colour, ...]:
    """The colours of channels whose file names none: added up they are white, as far as there are three.

    Examples
    --------
    >>> usual_colours(2)
    ((0, 1, 0), (1, 0, 1))
    """
    names = _OF_FEW.get(count, tuple(_PRIMARY))
    return tuple(_PRIMARY[names[k % len(names)]] for k in range(count))


@dataclass(frozen=True)
class ChannelDisplay:
    """Display of a channel, which is added to those of the others.

    Parameters
    ----------
    colour : (red, green, blue) from 0 to 1 of its brightest values.
    window : values shown black and in the full colour.
    visible : whether it is shown.

    Raises
    ------
    DeformError
        If the colour is none, or the window has no width.

    Examples
    --------
    >>> ChannelDisplay((0, 1, 0), (10, 200)).window
    (10.0, 200.0)
    """

    colour: Colour
    window: tuple[float, float]
    visible: bool = True

    def __post_init__(self) -> None:
        what = "a colour is three numbers (red, green, blue) from 0 to 1"
        colour = finite_array(self.colour, (3,), what)
        if not ((colour >= 0) & (colour <= 1)).all():
            raise DeformError(f"{what}, got {short_value(self.colour)}.")
        object.__setattr__(self, "colour", tuple(colour.tolist()))
        object.__setattr__(self, "window", check_window(self.window))
        check_fields(self)


@dataclass(frozen=True, eq=False)
class Channels(AbstractCellOutput):
    """Volumes on one grid, with colours in which they are shown added up; equal if all of these are.

    Parameters
    ----------
    volumes : one for each channel, named like it; of one grid and one voxel type.
    colours : (red, green, blue) from 0 to 1 of each; by default the usual ones.
    kind : a key of :data:`CHANNEL_KINDS`: "rgb" and "rgba" are the parts of a colour, and of its opacity.
    name : of all of them together, shown to people.

    Raises
    ------
    DeformError
        If there are none, or their grids or voxel types differ, or the colours or the kind do not fit.

    Examples
    --------
    >>> stained = Channels.from_array(np.zeros((4, 5, 6, 2), np.uint8), names=("nuclei", "actin"))
    >>> stained
    <Channels: nuclei, actin; 6 x 5 x 4 voxels (x, y, z), uint8>
    >>> stained["actin"].shape, stained.colours
    ((4, 5, 6), ((0, 1, 0), (1, 0, 1)))
    """

    volumes: tuple[Volume, ...]
    colours: tuple[Colour, ...] = ()
    kind: ChannelKind = "channels"
    name: str = ""

    def __post_init__(self) -> None:
        volumes = tuple(as_volumes(self.volumes))
        if not volumes:
            raise DeformError(f"channels are one or more volumes, got {short_value(self.volumes)}.")
        first = volumes[0]
        for volume in volumes[1:]:
            if volume.grid != first.grid or volume.dtype != first.dtype:
                raise DeformError(
                    f"channels have one grid and one voxel type, and {volume.name or 'one'!r} "
                    f"({volume.dtype} on {volume.grid.shape}) differs from {first.name or 'another'!r} "
                    f"({first.dtype} on {first.grid.shape})."
                )
        check_fields(self, "kind", "name")
        if self.kind not in CHANNEL_KINDS or CHANNEL_KINDS[self.kind] not in (0, len(volumes)):
            raise DeformError(f"{len(volumes)} channels cannot be of the kind {short_value(self.kind)}.")
        check_fields(self, "colours")
        colours = self.colours or usual_colours(min(3, len(volumes)) if CHANNEL_KINDS[self.kind] else len(volumes))
        colours += ((1.0, 1.0, 1.0),) * (self.kind == "rgba" and len(colours) == 3)
        if len(colours) != len(volumes):
            raise DeformError(f"{len(volumes)} channels need as many colours, got {short_value(self.colours)}.")
        object.__setattr__(self, "volumes", volumes)
        object.__setattr__(self, "colours", colours)

    def __repr__(self) -> str:
        nz, ny, nx = self.grid.shape
        names = ", ".join(name[:30] for name in self.names[:8]) + (", ..." if len(self) > 8 else "")
        return f"<Channels: {names}; {nx} x {ny} x {nz} voxels (x, y, z), {self.volumes[0].dtype.name}>"

    @classmethod
    def from_array(
        cls,
        values: NDArray[Any],
        grid: Grid | None = None,
        names: Sequence[str] = (),
        colours: Sequence[Colour] = (),
        kind: ChannelKind = "channels",
        name: str = "",
    ) -> Channels:
        """Channels of an array [z, y, x, c], or [y, x, c] for one slice; names are by default those of their kind."""
        values = np.asarray(values)
        if values.ndim not in (3, 4):
            raise DeformError(f"channels are an array [z, y, x, c] or [y, x, c], got the shape {values.shape}.")
        stack = np.moveaxis(values if values.ndim == 4 else values[None], -1, 0)
        given = tuple(names) or usual_names(len(stack), kind)
        volumes = [
            Volume.from_array(part, name=label, is_labels=False) for part, label in zip(stack, given, strict=True)
        ]
        return cls(tuple(v if grid is None else replace(v, grid=grid) for v in volumes), tuple(colours), kind, name)

    @property
    def grid(self) -> Grid:
        """Grid of all channels."""
        return self.volumes[0].grid

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(volume.name for volume in self.volumes)

    @property
    def values(self) -> NDArray[Any]:
        """A copy of all voxels: [z, y, x, c]."""
        return np.stack([volume.values for volume in self.volumes], axis=-1)

    def __len__(self) -> int:
        return len(self.volumes)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Channels):
            return NotImplemented
        same = (self.colours, self.kind, self.name, len(self)) == (other.colours, other.kind, other.name, len(other))
        return same and all(one.equals(another) for one, another in zip(self.volumes, other.volumes, strict=True))

    def __hash__(self) -> int:
        return hash((self.colours, self.kind, self.name, self.names, self.grid))

    def __contains__(self, given: object) -> bool:
        """True for the name of a channel, and for a volume that equals one."""
        return given in self.names if isinstance(given, str) else any(one.equals(given) for one in self.volumes)

    def __iter__(self) -> Iterator[Volume]:
        return iter(self.volumes)

    def __getitem__(self, which: int | str) -> Volume:
        """A channel by its number or its name."""
        if isinstance(which, str):
            if which not in self.names:
                raise DeformError(f"there is no channel {which!r}; there are {', '.join(map(repr, self.names))}.")
            return self.volumes[self.names.index(which)]
        if isinstance(which, bool) or not isinstance(which, int | np.integer) or not -len(self) <= which < len(self):
            raise DeformError(f"a channel is a number below {len(self)} or a name, got {short_value(which)}.")
        return self.volumes[which]

    def with_volumes(self, volumes: Sequence[VolumeLike]) -> Channels:
        """The same channels with other voxels, such as those that :func:`deformnb.warp` has deformed."""
        return replace(self, volumes=tuple(as_volumes(volumes)))

    def to_unit(self, unit: str) -> Channels:
        """The same channels (shared) in numbers of another unit of length; see :meth:`Grid.to_unit`."""
        volumes = [volume.to_unit(unit) for volume in self.volumes]
        return self if volumes[0] is self.volumes[0] else self.with_volumes(volumes)

    def brightness(self) -> Volume:
        """One grey volume of all channels, to project and drag on: luma of colours (ITU-R BT.601), else their largest.

        Other channels are each stretched from their own smallest to their largest value first, to 0 ... 255.
        """
        if CHANNEL_KINDS[self.kind]:
            values = luma([volume.values for volume in self.volumes[:3]])
        else:
            values = np.zeros(self.grid.shape, np.uint8)
            for volume in self.volumes:
                np.maximum(values, _bytes(volume.values, volume.value_range), out=values)
        return Volume(values, self.grid, self.name)

    @property
    def coloured_channels(self) -> tuple[Volume, ...]:
        """The channels that have a colour: all but the opacity of "rgba"."""
        return self.volumes[:3] if self.kind == "rgba" else self.volumes

    def displays(self) -> tuple[ChannelDisplay, ...]:
        """The displays of :attr:`coloured_channels`: in their colours, each from its smallest value to its largest.

        Whole numbers of colours (kind "rgb") have their own scale.
        """
        return tuple(
            ChannelDisplay(self.colours[k], self._display_range(k)) for k in range(len(self.coloured_channels))
        )

    def composite(
        self, pictures: Sequence[NDArray[Any]] | None = None, displays: Sequence[ChannelDisplay] | None = None
    ) -> NDArray[np.float32]:
        """Colours (..., 4): red, green, blue and alpha 1, the channels in their colours added up.

        Parameters
        ----------
        pictures : one array for each channel, such as a projection of each; by default their voxels.
        displays : of each of :attr:`coloured_channels`; default is :meth:`displays`.
        """
        parts = [volume.values for volume in self.volumes] if pictures is None else list(pictures)
        out = np.zeros((*np.shape(parts[0]), 4), np.float32)
        given = self.displays() if displays is None else displays
        if len(given) != len(self.coloured_channels):
            raise DeformError(f"{len(self.coloured_channels)} channels need as many displays, got {len(given)}.")
        for part, display in zip(parts, given, strict=False):
            if display.visible:
                low, high = display.window
                share = np.clip((part.astype(np.float32) - low) / (high - low), 0, 1)
                out[..., :3] += share[..., None] * np.asarray(display.colour, np.float32)
        if self.kind == "rgba":  # over black, as colours times alpha
            low, high = self._display_range(3)
            out[..., :3] *= np.clip((parts[3].astype(np.float32) - low) / (high - low), 0, 1)[..., None]
        out[..., 3] = 1
        return np.clip(out, 0, 1)

    def _display_range(self, k: int) -> tuple[float, float]:
        volume = self.volumes[k]
        if CHANNEL_KINDS[self.kind] and volume.dtype.kind in "iu":
            return 0.0, float(np.iinfo(volume.dtype).max)
        low, high = volume.value_range
        return low, high if high > low else low + 1.0


ChannelsLike: TypeAlias = Channels | VolumeLike
"""Objects that :func:`as_channels` takes where channels are required: Channels, all that a volume may be, an image
of several components, or the path of a file."""


def as_channels(given: ChannelsLike) -> Channels:
    """The channels that any accepted object is; a single volume is one channel.

    Raises
    ------
    DeformError
        As :func:`~deformnb.volume.volume.as_volume`.

    Examples
    --------
    >>> len(as_channels(Volume.from_array(np.eye(3))))
    1
    """
    if isinstance(given, Channels):
        return given
    found: Channels = CONVERSIONS["several_channels"](given)
    return found


def luma(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Grey values of red, green and blue (ITU-R BT.601), of their type; whole numbers are rounded.

    Examples
    --------
    >>> luma([np.array([255, 0], np.uint8), np.array([0, 255], np.uint8), np.array([0, 0], np.uint8)]).tolist()
    [76, 150]
    """
    dtype = parts[0].dtype
    grey = np.asarray(sum(weight * part for weight, part in zip(_LUMA, parts, strict=True)))
    return (np.floor(grey + 0.5) if dtype.kind in "iu" else grey).astype(dtype)


def usual_names(count: int, kind: ChannelKind = "channels") -> tuple[str, ...]:
    """Names of channels whose file has none.

    Examples
    --------
    >>> usual_names(2), usual_names(3, "rgb")
    (('channel 1', 'channel 2'), ('red', 'green', 'blue'))
    """
    if CHANNEL_KINDS.get(kind):
        return ("red", "green", "blue", "alpha")[:count]
    return tuple(f"channel {k + 1}" for k in range(count))


def _bytes(values: NDArray[Any], shown: tuple[float, float]) -> NDArray[np.uint8]:
    low, high = shown
    return np.asarray(np.clip((values.astype(np.float32) - low) * (255 / ((high - low) or 1.0)), 0, 255), np.uint8)
