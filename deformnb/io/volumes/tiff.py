"""TIFF stacks: a file of many pages, or a folder of single pages in the natural order of their names.

Files are written as OME-TIFF by tifffile: axes, voxel size with its unit, names and colours of channels. OME has no
place for the origin and the directions of a grid, nor for labels: these are annotations of deformnb, of the kind
that OME has for that (MapAnnotation), which other programs show as such.

Pages are read by :mod:`deformnb.io.volumes.tiff_pages`. Source: the descriptions that ImageJ, OME and tifffile put into
the first page.
"""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, BinaryIO
from uuid import UUID, uuid4

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Progress
from deformnb.checks import optional_package
from deformnb.errors import DeformError
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.paths import regular_file
from deformnb.io.volumes.headers import SINGLE, Geometry, Header, Layout, VoxelBlocks, check_layout, volume_shape
from deformnb.io.volumes.tiff_pages import (
    DESCRIPTION,
    HEIGHT,
    MOST_PAGES,
    RESOLUTION_UNIT,
    SAMPLES,
    WIDTH_TAG,
    XRES,
    YRES,
    Page,
    Tags,
    directories,
    is_preview,
    one_number,
    parse_page,
    whole_numbers,
)
from deformnb.io.volumes.voxels import stored_dtype
from deformnb.volume.units import common_unit, parse_unit, ratio
from deformnb.volume.volume import IDENTITY, Grid, Volume, voxel_checksum

TIFF_SUFFIXES = (".ome.tif", ".ome.tiff", ".tif", ".tiff")

_MOST_TABLES = 2**26  # bytes of the places of parts of all pages, where these must be sorted: damaged ones share them

_Pages = Iterator[tuple[Page | None, BinaryIO]]


def read_header(path: Path) -> Header:
    """Geometry and type of a TIFF file with one or many pages."""
    text, found = _description(path)
    header = _header(path, lambda: _pages(path, found), found)
    return _annotate(header, text) if "<OME" in text[:2000] else header


def list_pages(path: Path) -> list[Page]:
    """The pages of a file in their order, to read parts of them."""
    found, tables = list[Page](), 0
    with closing(_pages(path, _description(path)[1])) as pages:  # type: ignore[type-var]  # generators can be closed
        for page, _ in pages:
            if page is None:
                continue
            found.append(page)
            _require_same(path, page, found[0], len(found) - 1)
            tables += page.offsets.nbytes + page.counts.nbytes
            if tables > _MOST_TABLES:
                raise fail(path, f"the tables of its pages take more than {_MOST_TABLES} bytes; save it uncompressed.")
    return found


def _description(path: Path) -> tuple[str, _Described]:
    """The text in the first page, and its content."""
    with regular_file(path).open("rb") as file:
        _, tags = next(directories(path, file))
    description = tags.get(DESCRIPTION, b"")
    text = description.split(b"\0")[0].decode("utf-8", "replace") if isinstance(description, bytes) else ""
    return text, _describe(path, text, tags)


def read_folder_header(folder: Path) -> Header:
    """Geometry and type of a folder of TIFF files with one page each."""
    found = (file for file in folder.iterdir() if file.suffix.lower() in TIFF_SUFFIXES)
    files = [regular_file(file) for file in sorted(found, key=_natural)]  # a pipe in the place of a slice is no slice
    order = f"{len(files)} files in the order {printable(files[0].name, 40)} ... {printable(files[-1].name, 40)}"
    return _header(folder, lambda: _single_pages(files), _Described(notes=(order,)))


def _single_pages(files: Iterable[Path]) -> _Pages:
    for file in files:
        pages = _pages(file, _Described())
        yield next(pages)
        more = sum(page is not None for page, _ in pages)
        if more:
            raise fail(file, f"it has {1 + more} pages; in a folder of slices every file has one. Read it separately.")


def _natural(path: Path) -> tuple[list[Any], str]:
    """Sort slice2 before slice10."""
    words = re.split(r"([0-9]+)", path.name.lower())
    return [(int(word[:1000]), "") if word.isdecimal() else (-1, word) for word in words], path.name


def _header(path: Path, pages: Callable[[], _Pages], found: _Described) -> Header:
    """Header common to all pages; only the first is stored, because each may have a table of half a million strips."""
    first, count, previews, working_bytes = None, 0, 0, 0
    for page, _ in pages():
        if page is None:
            previews += 1
            continue
        first = first or page
        _require_same(path, page, first, count)
        count, working_bytes = count + 1, max(working_bytes, page.working_bytes)
    if first is None:
        raise fail(path, "it has no pages.")
    (height, width), spacing, notes = first.shape, found.spacing, found.notes
    _check_plane(path, found, first)
    layout, slices = _layout(path, found, first, count)
    shape, _ = volume_shape(path, [width, height, slices], first.pixel_bytes)
    if spacing is None:
        notes += (_NO_DISTANCE,)
    if found.images > 1:
        notes += (f"the file holds {found.images} images, of which the first was read",)
    if previews:
        notes += (f"{previews} pages that are smaller copies or masks of others were left out",)
    if first.codec.photometric == 0:
        notes += ("the file shows small values as white; the values are unchanged",)
    if first.codec.photometric == 3:
        notes += ("the file has a colour table; the voxels are its indices",)
    blocks: VoxelBlocks = lambda: _blocks(path, pages(), first, count)  # noqa: E731
    planes = layout.channels // first.samples
    if layout.frames * planes > 1:
        blocks = lambda: _sorted_blocks(path, pages(), found.order, (layout.frames, planes, slices))  # noqa: E731
    return Header(
        path,
        shape,
        first.dtype,
        blocks,
        Geometry(spacing or (1.0, 1.0, 1.0)),
        notes=notes,
        working_bytes=working_bytes,
        layout=layout,
        unit=found.unit,
    )


# OME's names of types that are others than NumPy's.
_TYPES = {"float": "float32", "double": "float64", "bit": "bool"}


def _check_plane(path: Path, found: _Described, page: Page) -> None:
    """Refuse a description of other pixels than the pages have."""
    columns, rows, kind = found.plane
    has = (str(page.shape[1]), str(page.shape[0]), page.dtype.name)
    states = (
        has[0] if columns is None else columns,
        has[1] if rows is None else rows,
        has[2] if kind is None else _TYPES.get(kind, kind),
    )
    if states != has:
        raise fail(
            path,
            f"its description states {' x '.join(printable(n, 20) for n in states[:2])} pixels of "
            f"{printable(states[2], 20)}, and its pages have {' x '.join(has[:2])} of {has[2]}.",
        )


def _layout(path: Path, found: _Described, page: Page, count: int) -> tuple[Layout, int]:
    """Channels and moments of so many pages, and the number of slices of each."""
    layout, samples = found.layout, page.samples
    planes = layout.channels
    if samples > 1:
        if planes not in (1, samples):
            raise fail(path, f"it has {planes} channels of pages in colours; save the channels separately.")
        kind = {3: "rgb", 4: "rgba"}.get(samples, "channels") if page.codec.photometric in (2, 6) else "channels"
        named = layout if kind == "channels" and planes == samples else replace(layout, names=(), colours=())
        layout = replace(named, channels=samples, kind=kind, interleaved=True)
        planes = 1
    layout = check_layout(path, layout)
    slices, rest = divmod(count, planes * layout.frames)
    if rest or not slices or found.slices not in (None, slices):
        depth = "" if found.slices is None else f" of {found.slices} slices"
        raise fail(
            path,
            f"its description claims {layout.frames} moments of {planes} channels{depth}, into which its "
            f"{count} pages cannot be divided; it is damaged, or one part of a set of files.",
        )
    if samples > 1 and layout.frames > 1 and found.order.index("T") < found.order.index("Z"):
        raise fail(
            path, "its moments are stored between its slices, which is not supported in colours; save one moment."
        )
    return layout, slices


def _sorted_blocks(path: Path, pages: _Pages, order: str, counts: tuple[int, int, int]) -> Iterator[NDArray[Any]]:
    """The pages moment by moment, channel by channel and slice by slice, which may be stored in another order.

    Parameters
    ----------
    order : the axes Z, C and T, the one that changes fastest first.
    counts : of moments, channels and slices.
    """
    found, tables = [], 0
    with closing(pages):  # type: ignore[type-var]  # generators can be closed
        for page, _ in pages:
            if page is None:
                continue
            found.append(page)
            tables += page.offsets.nbytes + page.counts.nbytes
            if tables > _MOST_TABLES:
                raise fail(path, f"the tables of its pages take more than {_MOST_TABLES} bytes; save it uncompressed.")
    if len(found) != math.prod(counts):
        raise fail(
            path,
            f"it had {math.prod(counts)} pages and now has {len(found)}: another program is writing it. Read it again.",
        )
    size = dict(zip("TCZ", counts, strict=True))
    with path.open("rb") as file:
        for t, c, z in product(*map(range, counts)):
            at, step, place = 0, 1, {"T": t, "C": c, "Z": z}
            for axis in order:
                at, step = at + step * place[axis], step * size[axis]
            yield found[at].read(file)[None]


def _require_same(path: Path, page: Page, first: Page, number: int) -> None:
    if (page.shape, page.dtype, page.samples, page.codec.photometric) != (
        first.shape,
        first.dtype,
        first.samples,
        first.codec.photometric,
    ):
        raise fail(
            path,
            f"page {number + 1} has {page.shape} pixels of {page.dtype.name} but the first has "
            f"{first.shape} of {first.dtype.name}; all slices must be equal in both.",
        )


def _blocks(path: Path, pages: _Pages, first: Page, count: int) -> Iterator[NDArray[Any]]:
    number = 0
    with closing(pages):  # type: ignore[type-var]  # generators can be closed
        for page, file in pages:
            if page is None:
                continue
            _require_same(path, page, first, number)
            yield page.read(file)[None]
            number += 1
    if number != count:
        raise fail(path, f"it had {count} pages and now has {number}: another program is writing it. Read it again.")


def _pages(path: Path, found: _Described) -> _Pages:
    """The pages in order and the open file, each checked when its turn comes; None for a smaller copy or a mask.

    A file of one page whose description claims more has their voxels one after another behind it. Of several images the
    pages of the first are the first ones.
    """
    with path.open("rb") as file:
        number, wanted = 0, found.count
        for order, tags in directories(path, file):
            if number and is_preview(path, tags):
                yield None, file
                continue
            page = parse_page(path, order, tags)
            if number == 0 and wanted is not None and page.samples > 1 and found.layout.channels == page.samples:
                wanted //= page.samples  # OME counts the parts of a colour as channels
            if number == wanted and found.images > 1:
                return
            number += 1
            yield page, file
        if wanted is not None and number not in (1, wanted):
            raise fail(
                path,
                f"its description claims {wanted} slices but it has {number} pages; it is damaged, or one "
                "part of a set of files.",
            )
        if wanted is not None and number < wanted:
            yield from ((behind, file) for behind in _contiguous(path, page, wanted))


def _contiguous(path: Path, page: Page, count: int) -> Iterator[Page]:
    """The slices after the first: ImageJ writes large stacks as one page and the voxels of all after one another."""
    size = page.codec.packed_bytes(page.shape[0])
    begin = int(page.offsets[0])
    present = path.stat().st_size - begin
    if page.codec.compression != 1 or page.is_planar or page.is_tiled or count > MOST_PAGES or count * size > present:
        raise fail(
            path,
            f"its description claims {count} slices of {size} bytes but the file has {present} bytes of "
            "voxels: it is cut short or damaged, or one part of a set of files.",
        )
    for number in range(1, count):
        yield replace(page, part=page.shape, offsets=np.array([begin + number * size]), counts=np.array([size]))


@dataclass(frozen=True)
class _Described:
    """Contents of the description of ImageJ, OME or tifffile in the first page.

    Parameters
    ----------
    unit : of the spacing; "" where it is not known.
    count : pages that the file has, which may follow one another behind a single one; None if it is not stated.
    layout : its channels, still those in colours too, and moments.
    order : of the pages, the axis that changes fastest first.
    slices : number of slices; None if it is not stated.
    images : how many images the file has, of which the first is read.
    plane : columns, rows and type of the pixels that OME states; None for those that it does not.
    """

    spacing: Float3 | None = None
    unit: str = ""
    count: int | None = None
    notes: tuple[str, ...] = ()
    layout: Layout = SINGLE
    order: str = "ZCT"
    slices: int | None = None
    images: int = 1
    plane: tuple[str | None, str | None, str | None] = (None, None, None)


_CHANNEL = re.compile(r"<Channel\b([^>]{0,2000})>")
_ATTRIBUTE = re.compile(r'([A-Za-z]+)="([^"]{0,60})"')
_NO_DISTANCE = "the file does not state the distance of slices; spacing 1 was taken"


def _describe(path: Path, text: str, tags: Tags) -> _Described:
    """Spacing, number of slices, channels, moments and remarks of the description in the first page."""
    if text.startswith("ImageJ="):
        return _from_imagej(path, text, tags)
    if "<OME" in text[:2000]:
        return _from_ome(path, text)
    if text.lstrip()[:1] == "{" and '"shape"' in text:
        return _from_tifffile(path, text, tags)
    return _Described(notes=_unused_resolution(path, tags))


def _unused_resolution(path: Path, tags: Tags) -> tuple[str, ...]:
    """A remark on a resolution in pixels per inch or centimetre, which cannot be used without a distance of slices."""
    unit = {2: "inch", 3: "centimetre"}.get(one_number(path, tags, RESOLUTION_UNIT, 1))
    across, down = _ratio(tags, XRES), _ratio(tags, YRES)
    if unit is None or across is None or down is None:
        return ()
    note = (
        f"the resolution in the file, {1 / across:.6g} x {1 / down:.6g} pixels per {unit}, is not used: it does "
        "not state the distance of slices"
    )
    return (note,)


def _ratio(tags: Tags, tag: int) -> float | None:
    """The length of a pixel of a resolution in the fields; None where it states none."""
    value = whole_numbers(tags, tag)[:3].tolist()
    if len(value) != 2 or min(value) <= 0:
        return None
    return float(value[1] / value[0])


def _counts(path: Path, fields: Mapping[str, Any], names: tuple[str, ...]) -> list[int]:
    """Numbers of a description, 1 where one is absent."""
    found = []
    for name in names:
        text = str(fields.get(name, "1")).strip()
        if not (text.isascii() and text.isdecimal() and len(text) < 10 and int(text) > 0):
            raise fail(path, f"its description has '{name}' = '{printable(text, 40)}', which is no number of pages.")
        found.append(int(text))
    return found


def _from_imagej(path: Path, text: str, tags: Tags) -> _Described:
    fields = {key.strip(): value for key, value in (line.split("=", 1) for line in text.splitlines() if "=" in line)}
    images, channels, slices, frames = _counts(path, fields, ("images", "channels", "slices", "frames"))
    named = {"channels", "slices", "frames"} & fields.keys()
    if named and "images" in fields and images != channels * slices * frames:
        raise fail(
            path,
            f"its description has {images} images, but {channels} channels of {slices} slices at {frames} "
            "moments; it is damaged.",
        )
    notes: tuple[str, ...] = ()
    duration = _number(fields.get("finterval", ""))
    if "finterval" in fields and (duration is None or duration < 0) and frames > 1:
        notes += (f"its finterval '{printable(fields['finterval'], 20)}' is no time between moments, and is not used",)
    # ImageJ stores colours of RGB in the pixels, and its other channels in pages that change fastest.
    layout = Layout(frames, channels, duration=max(0.0, duration or 0.0))
    spacing, unit, more = _imagej_lengths(path, fields, tags)
    count = images if "images" in fields else channels * slices * frames if named else None
    return _Described(spacing, unit, count, notes + more, layout, "CZT", slices if named else None)


def _from_ome(path: Path, text: str) -> _Described:
    pixels = re.search(r"<Pixels[^>]*>", text)
    found = dict(_ATTRIBUTE.findall(pixels[0])) if pixels else {}
    layout, notes = _ome_layout(path, found, text)
    order = found.get("DimensionOrder", "XYZCT")[2:]
    if sorted(order) != ["C", "T", "Z"] or found.get("DimensionOrder", "XY")[:2] != "XY":
        raise fail(path, f"its DimensionOrder is {printable(found['DimensionOrder'], 20)}, which OME does not define.")
    slices, channels, frames = _counts(path, found, ("SizeZ", "SizeC", "SizeT"))
    known = {"SizeZ", "SizeC", "SizeT"} & found.keys()
    spacing, unit, more = _ome_lengths(found)
    images = max(1, len(re.findall(r"<Pixels\b", text)))
    return _Described(
        spacing,
        unit,
        slices * channels * frames if known else None,
        notes + more,
        layout,
        order,
        slices if "SizeZ" in known else None,
        images,
        (found.get("SizeX"), found.get("SizeY"), found.get("Type")),
    )


def _ome_lengths(pixels: dict[str, str]) -> tuple[Float3 | None, str, tuple[str, ...]]:
    """Spacing, unit and notes of OME's sizes; what an axis lacks is the size along x, or 1, with a note."""
    stated = {axis: pixels.get(f"PhysicalSize{axis}") for axis in "XYZ"}
    if not any(value is not None for value in stated.values()):
        alone = {value for axis in "XYZ" if (value := pixels.get(f"PhysicalSize{axis}Unit"))}
        return (
            None,
            "",
            tuple(f"the file states the unit {printable(unit, 20)} and no length" for unit in sorted(alone)),
        )
    units = [html.unescape(pixels.get(f"PhysicalSize{axis}Unit", "\u00b5m")) for axis in "XYZ"]
    lengths, notes = _usable_lengths({axis.lower(): value for axis, value in stated.items()})
    used = [unit if _number(value or "") else units[0] for unit, value in zip(units, stated.values(), strict=True)]
    spacing, unit, more = _to_common_unit(lengths, used)
    return spacing, unit, notes + more


def _usable_lengths(stated: dict[str, str | None]) -> tuple[Float3, tuple[str, ...]]:
    """Lengths along x, y and z from those that a file states; with notes for each that is turned, or made up."""
    lengths, notes = [], []
    for axis, text in stated.items():
        number = _number(text or "")
        if number:
            lengths.append(abs(number))
            if number < 0:
                notes.append(f"the length {printable(text, 20)} along {axis} is negative in the file; its size is used")
            continue
        lengths.append(lengths[0] if axis == "y" and lengths else 1.0)
        named = "distance of slices" if axis == "z" else f"length of pixels along {axis}"
        why = "does not state" if text is None else f"has '{printable(text, 20)}' for"
        notes.append(f"the file {why} the {named}; spacing {lengths[-1]:g} was taken")
    return (lengths[0], lengths[1], lengths[2]), tuple(notes)


def _from_tifffile(path: Path, text: str, tags: Tags) -> _Described:
    """The description of tifffile: the shape of the array, and perhaps the names of its axes."""
    try:
        found = json.loads(text)
        shape = [int(n) for n in found["shape"]]
        if min(shape) < 1 or len(shape) > 8:
            raise ValueError
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise fail(path, "its description of a shape is damaged.") from error
    planes = _planes(path, shape, tags)
    axes = found.get("axes")
    if not isinstance(axes, str) or len(axes) != len(shape):
        axes = ""
    named, notes = _pages_axes(path, planes, axes[: len(planes)])
    size = dict(named)
    layout = Layout(size.get("T", 1), size.get("C", 1))
    order = "".join(axis for axis, _ in reversed(named))
    order += "".join(axis for axis in "ZCT" if axis not in order)
    spacing, unit = found.get("spacing"), found.get("unit")
    if spacing is not None or unit is not None:
        lengths, unit, more = _imagej_lengths(
            path, {"spacing": str(spacing) if spacing is not None else "", "unit": str(unit or "")}, tags
        )
        return _Described(lengths, unit, math.prod(planes), notes + more, layout, order, size.get("Z", 1))
    notes += _unused_resolution(path, tags)
    return _Described(None, "", math.prod(planes), notes, layout, order, size.get("Z", 1))


def _planes(path: Path, shape: list[int], tags: Tags) -> list[int]:
    """The sizes of the axes of pages: those of a shape before the ones of a page."""
    (height,), (width,) = (whole_numbers(tags, tag)[:1].tolist() or [0] for tag in (HEIGHT, WIDTH_TAG))
    samples = (*whole_numbers(tags, SAMPLES)[:1].tolist(), 1)[0]
    for plane in ([height, width], [height, width, samples], [samples, height, width]):
        if shape[-len(plane) :] == plane and (samples > 1) == (len(plane) == 3):
            return shape[: -len(plane)]
    raise fail(
        path,
        f"its description has the shape {shape}, and its pages have {height} x {width} pixels of "
        f"{samples} samples; it is damaged.",
    )


def _pages_axes(path: Path, sizes: list[int], names: str) -> tuple[list[tuple[str, int]], tuple[str, ...]]:
    """Axes of the pages, the slowest first: slices, channels or moments."""
    real = [(names[k : k + 1], size) for k, size in enumerate(sizes) if size > 1]
    if len(real) > 3:
        raise fail(path, f"its pages have {len(real)} axes ({sizes}); a volume has slices, channels and moments.")
    free = [axis for axis in "ZTC" if axis not in [name for name, _ in real]]
    found, guessed = [], False
    for name, size in reversed(real):
        known = name in ("Z", "C", "T")
        found.append((name if known else free.pop(0), size))
        guessed = guessed or not known
    axes = [axis for axis, _ in found]
    if len(set(axes)) < len(axes):
        raise fail(path, f"its description names the axes {printable(names, 20)}; one of Z, C and T is there twice.")
    taken = {"Z": "slices", "C": "channels", "T": "moments"}
    if not guessed or len(real) < 2:
        return found[::-1], ()
    sizes_of, words = " x ".join(str(size) for _, size in real), ", ".join(taken[axis] for axis in reversed(axes))
    return found[::-1], (f"its axes of {sizes_of} pages, of no name, were taken as {words}",)


def _to_common_unit(lengths: Float3, units: list[str]) -> tuple[Float3, str, tuple[str, ...]]:
    """Lengths along x, y and z in the unit of x, with that unit and notes."""
    stated = [parse_unit(unit) for unit in units]
    unit, (a, b, c), notes = common_unit([one for one, _ in stated])
    x, y, z = lengths
    return (x * a, y * b, z * c), unit, tuple(dict.fromkeys(note for _, one in stated for note in one)) + notes


def _ome_layout(path: Path, pixels: dict[str, str], text: str) -> tuple[Layout, tuple[str, ...]]:
    """Channels with their names and colours (red, green, blue, alpha in 32 bits, with a sign) and moments of OME."""
    frames, size = _counts(path, pixels, ("SizeT", "SizeC"))
    channels = [dict(_ATTRIBUTE.findall(found)) for found in _CHANNEL.findall(text.partition("</Pixels>")[0])]
    names = tuple(printable(html.unescape(channel.get("Name", ""))) for channel in channels)
    codes = [channel.get("Color", "") for channel in channels]
    colours = tuple(
        ((int(code) >> 24 & 255) / 255, (int(code) >> 16 & 255) / 255, (int(code) >> 8 & 255) / 255)
        for code in codes
        if re.fullmatch(r"-?[0-9]{1,10}", code)
    )
    increment = pixels.get("TimeIncrement", "0")
    duration, notes = _number(increment), tuple[str, ...]()
    if frames > 1 and (duration is None or duration < 0):
        notes = (f"its TimeIncrement '{printable(increment, 20)}' is no time between moments, and is not used",)
    return Layout(
        frames,
        size,
        names=names if len(names) == size and all(names) else (),
        colours=colours if len(colours) == size else (),
        duration=max(0.0, duration or 0.0),
    ), notes


_ANNOTATION = re.compile(r'<M K="deformnb ([a-z]+)">([^<]{1,400})</M>')


def _annotate(header: Header, text: str) -> Header:
    """The header with origin, directions and labels of the annotations of :func:`write`, where there are any."""
    found = {key: value.split() for key, value in _ANNOTATION.findall(text)}
    try:
        origin = tuple(map(float, found.get("origin", ("0", "0", "0"))))
        rows = np.reshape(list(map(float, found["direction"])), (3, 3)).tolist() if "direction" in found else IDENTITY
        frame = Grid((1, 1, 1), (1.0, 1.0, 1.0), origin, rows)  # type: ignore[arg-type]
    except (DeformError, ValueError) as error:
        raise fail(header.path, f"its annotations of deformnb are damaged: {printable(error, 200)}") from error
    return replace(
        header,
        geometry=replace(
            header.geometry, origin=frame.origin, direction=frame.direction, is_anatomical=frame.direction != IDENTITY
        ),
        is_labels=True if found.get("labels") == ["yes"] else header.is_labels,
    )


def _number(text: str) -> float | None:
    """The finite number of a text, of which ImageJ writes some with a decimal comma; None for any other text."""
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _imagej_lengths(path: Path, fields: dict[str, str], tags: Tags) -> tuple[Float3 | None, str, tuple[str, ...]]:
    """Spacing, unit and notes of ImageJ's description, which has yunit and zunit only where they are others."""
    unit = fields.get("unit", "")
    if not unit and "spacing" not in fields:
        return None, "", _unused_resolution(path, tags)
    across, down = _ratio(tags, XRES), _ratio(tags, YRES)
    depth = fields.get("spacing") or None
    lengths, notes = _usable_lengths(
        {"x": None if across is None else repr(across), "y": None if down is None else repr(down), "z": depth}
    )
    spacing, unit, more = _to_common_unit(lengths, [unit, fields.get("yunit", unit), fields.get("zunit", unit)])
    return spacing, unit, notes + more


# -- writing ---------------------------------------------------------------------------------------------------------

_MOST_RATIONAL = 1e9

# Without one OME means micrometres; this is its word for lengths whose unit is not known.
_NO_UNIT = "reference frame"

# A classic TIFF has room for 4 GiB; its tables and its description take some of that.
_MOST_CLASSIC = 2**32 - 2**25


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a volume as OME-TIFF, a page for each slice."""

    def pages() -> Iterator[NDArray[Any]]:
        for number, page in enumerate(volume.values):
            yield page.astype(stored_dtype(volume), copy=False)
            if progress is not None:
                progress((number + 1) / len(volume.values))

    checksum = voxel_checksum(volume.dtype, volume.shape, volume.values)  # equal volumes give equal files
    write_pages(pages(), path, volume, SINGLE, overwrite=overwrite, identity=UUID(checksum[:32]))


def write_pages(
    pages: Iterator[NDArray[Any]],
    path: Path,
    like: Volume,
    layout: Layout,
    *,
    overwrite: bool,
    identity: UUID | None = None,
) -> None:
    """Write pages [y, x], or [y, x, part] of colours, as OME-TIFF: of each moment all channels, of these all slices.

    Parameters
    ----------
    like : a channel, with the name and the grid of all of them.
    layout : number of moments, and of channels with their names and colours.
    identity : of the file; default is a random one.

    Raises
    ------
    MissingPackageError
        If tifffile is not installed.
    """
    tifffile = optional_package("tifffile")
    grid, dtype = like.grid, stored_dtype(like)
    is_colour = layout.kind in ("rgb", "rgba")
    inner, planes = (layout.channels, 1) if is_colour else (1, layout.channels)
    shape = (layout.frames, planes, *grid.shape, *([inner] if is_colour else []))
    size = math.prod(shape) * dtype.itemsize
    colour: dict[str, Any] = {"photometric": "rgb" if is_colour else "minisblack"}
    if layout.kind == "rgba":
        colour["extrasamples"] = ["unassalpha"]
    with (
        atomic_write(path, overwrite=overwrite, needed=size) as file,
        tifffile.TiffWriter(file, bigtiff=size > _MOST_CLASSIC, ome=True, byteorder="<") as writer,
    ):
        writer.write(
            pages,
            shape=shape,
            dtype=dtype,
            software="deformnb",
            **_resolution(grid),
            metadata=_ome_metadata(like, layout, identity or uuid4(), is_colour),
            **colour,
        )


def _resolution(grid: Grid) -> dict[str, Any]:
    """Pixels of a centimetre, as tifffile takes them; nothing where a rational of 32 bits cannot hold their number.

    Programs that do not know OME, such as ITK, have the lengths of pixels from here; TIFF has no field for the distance
    of slices. Lengths of an unknown unit count as millimetres.
    """
    across = tuple(ratio("cm", grid.unit or "mm") / length for length in grid.spacing[:2])
    held = all(1 / _MOST_RATIONAL < count < _MOST_RATIONAL for count in across)
    return {"resolution": across, "resolutionunit": "CENTIMETER"} if held else {}


def _ome_metadata(like: Volume, layout: Layout, identity: UUID, is_colour: bool) -> dict[str, Any]:
    """Metadata as tifffile takes them for the description of the first page."""
    grid = like.grid
    about: dict[str, Any] = {
        "axes": "TCZYXS" if is_colour else "TCZYX",
        "Name": like.name,
        "Creator": "deformnb",
        "UUID": str(identity),
    }
    for axis, length in zip("XYZ", grid.spacing, strict=True):
        about |= {f"PhysicalSize{axis}": length, f"PhysicalSize{axis}Unit": grid.unit or _NO_UNIT}
    if layout.duration:
        about |= {"TimeIncrement": layout.duration, "TimeIncrementUnit": "s"}
    if layout.channels > 1 and not is_colour:
        about["Channel"] = {"Name": list(layout.names), "Color": [_colour_code(colour) for colour in layout.colours]}
    own = {
        "deformnb origin": " ".join(map(repr, grid.origin)),
        "deformnb direction": " ".join(repr(value) for row in grid.direction for value in row),
    }
    return about | {"MapAnnotation": own | ({"deformnb labels": "yes"} if like.is_labels else {})}


def _colour_code(colour: Float3) -> int:
    """Red, green, blue and alpha in 32 bits, with a sign.

    Examples
    --------
    >>> _colour_code((0.0, 1.0, 0.0)), _colour_code((1.0, 0.0, 1.0))
    (16711935, -16711681)
    """
    red, green, blue = (round(255 * part) for part in colour)
    code = red << 24 | green << 16 | blue << 8 | 255
    return code - 2**32 if code >= 2**31 else code
