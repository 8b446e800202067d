"""VTK image data (.vti): text or binary, inline or appended, compressed or not; written as appended raw zlib blocks."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import fail, human_bytes, printable
from deformnb.io.files.memory import available_memory
from deformnb.io.files.streams import LEVEL, packed_bytes
from deformnb.io.files.texts import floats, integers
from deformnb.io.files.vtk_xml import TYPES, Tag, VtkXml
from deformnb.io.volumes.headers import Geometry, Header, triple, volume_shape
from deformnb.io.volumes.voxels import BLOCK_BYTES, slabs_of_bytes, stored_dtype, stream_blocks
from deformnb.volume.volume import Grid, Matrix3, Volume

_NAMES = {dtype: name for name, dtype in TYPES.items()}

# VTK has no units; in 3D Slicer, and among the images of ITK, its lengths are millimetres.
_UNIT = "mm"

# An array of this name holds labels: VTI has no other place that VTK preserves.
_LABELS = "labels"


def read_header(path: Path) -> Header:
    """Geometry, type and place of the voxels of a VTI file."""
    file = VtkXml(path, "ImageData")
    array, notes = _choose(file)
    if integers(path, "NumberOfComponents", array.attributes.get("NumberOfComponents", "1"), 1)[0] != 1:
        raise fail(path, "its array has several components (colours or vectors); save one component.")
    dtype = file.dtype(array)
    extent, geometry = _geometry(file)
    cells = array.is_inside("CellData")
    sizes = [
        high - low + (0 if cells and high > low else 1) for low, high in zip(extent[::2], extent[1::2], strict=True)
    ]
    shape, more = volume_shape(path, sizes, dtype.itemsize)
    axes = np.asarray(geometry["direction"]) * np.asarray(geometry["spacing"])
    corner = np.array(extent[::2]) + (0.5 if cells else 0.0) * (np.array(sizes) >= 1)
    if np.isfinite(axes).all():
        geometry["origin"] = triple((np.asarray(geometry["origin"]) + axes @ corner).tolist())
    if cells:
        notes += ("the values belong to cells: voxels are at the cells' centres",)
    voxels = file.locate_array(array, math.prod(shape))
    labels = True if array.attributes.get("Name") == _LABELS else None
    return Header(
        path,
        shape,
        dtype,
        lambda: stream_blocks(path, voxels.open, shape, dtype),
        is_labels=labels,
        notes=notes + more,
        unit=_UNIT,
        geometry=Geometry(**geometry),
    )


def _choose(file: VtkXml) -> tuple[Tag, tuple[str, ...]]:
    """The array of voxels: the active scalars of the points, or the only or first array."""
    for parent in ("PointData", "CellData"):
        arrays = [tag for tag in file.tags if tag.name == "DataArray" and tag.is_inside(parent)]
        if not arrays:
            continue
        owner = file.first(parent)
        active = owner.attributes.get("Scalars") if owner else None
        chosen = next((tag for tag in arrays if active is not None and tag.attributes.get("Name") == active), arrays[0])
        others = ", ".join(printable(tag.attributes.get("Name", "?"), 30) for tag in arrays[:10] if tag is not chosen)
        taken = printable(chosen.attributes.get("Name", "?"), 30)
        notes: tuple[str, ...] = (f"of several arrays '{taken}' was taken; the others are: {others}",) if others else ()
        if active is not None and chosen.attributes.get("Name") != active:
            notes += (f"its active scalars '{printable(active, 30)}' are not there; '{taken}' was taken",)
        return chosen, notes
    raise fail(file.path, "it has no array of points or cells, so there are no voxels.")


def _geometry(file: VtkXml) -> tuple[list[int], dict[str, Any]]:
    path, image = file.path, file.first(file.kind)
    attributes = image.attributes if image else {}
    extent = integers(path, "WholeExtent", attributes.get("WholeExtent", ""), 6)
    pieces = [tag for tag in file.tags if tag.name == "Piece"]
    if len(pieces) != 1 or integers(path, "Extent", pieces[0].attributes.get("Extent", ""), 6) != extent:
        raise fail(path, f"it has {len(pieces)} pieces or a piece smaller than the whole; save it as one piece.")
    direction = floats(path, "Direction", attributes.get("Direction", "1 0 0 0 1 0 0 0 1"), 9)
    rows: Matrix3 = (triple(direction[:3]), triple(direction[3:6]), triple(direction[6:]))
    return extent, {
        "spacing": triple(floats(path, "Spacing", attributes.get("Spacing", "1 1 1"), 3)),
        "origin": triple(floats(path, "Origin", attributes.get("Origin", "0 0 0"), 3)),
        "direction": rows,
    }


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write VTI: appended raw zlib blocks of one MiB; bool becomes uint8, labels are named "labels"."""
    name = "".join(c for c in volume.name if c.isprintable())
    name = _LABELS if volume.is_labels else name if name not in ("", _LABELS) else "values"
    dtype = stored_dtype(volume)
    xml = _xml(volume.grid, "Scalars", name, dtype)
    _write(path, xml, volume.values, dtype, overwrite, progress)


def write_vectors(
    values: NDArray[Any],
    grid: Grid,
    name: str,
    remark: str,
    path: Path,
    overwrite: bool,
    progress: Progress | None = None,
) -> None:
    """Write vectors (nz, ny, nx, 3) as VTI; the remark is a comment at the start, without two hyphens side by side."""
    xml = _xml(grid, "Vectors", name, values.dtype, f"<!-- {remark} -->\n")
    _write(path, xml, values, values.dtype, overwrite, progress)


def read_vectors(path: Path) -> tuple[NDArray[Any], Grid]:
    """The vectors (nz, ny, nx, 3) of a VTI file's points: those that are active, or the first array of vectors."""
    file = VtkXml(path, "ImageData")
    arrays = [
        tag
        for tag in file.tags
        if tag.name == "DataArray" and tag.is_inside("PointData") and tag.attributes.get("NumberOfComponents") == "3"
    ]
    if not arrays:
        raise fail(path, "it has no array of three components at its points, so it is no displacement field.")
    owner = file.first("PointData")
    active = None if owner is None else owner.attributes.get("Vectors")
    array = next((tag for tag in arrays if tag.attributes.get("Name") == active), arrays[0])
    extent, geometry = _geometry(file)
    sizes = [high - low + 1 for low, high in zip(extent[::2], extent[1::2], strict=True)]
    shape, _ = volume_shape(path, sizes, 3 * file.dtype(array).itemsize)
    axes = np.asarray(geometry["direction"]) * np.asarray(geometry["spacing"])
    geometry["origin"] = triple((np.asarray(geometry["origin"]) + axes @ np.array(extent[::2], dtype=float)).tolist())
    grid, _ = Header(path, shape, file.dtype(array), lambda: iter(()), unit=_UNIT, geometry=Geometry(**geometry)).grid()
    stored = file.locate_array(array, 3 * math.prod(shape))
    if stored.size > available_memory() // 3:
        raise fail(path, f"its vectors take {human_bytes(stored.size)}, more than the memory here can hold.")
    return stored.values().reshape(*shape, 3).astype(stored.dtype.newbyteorder("=")), grid


def _write(
    path: Path, xml: bytes, values: NDArray[Any], dtype: np.dtype[Any], overwrite: bool, progress: Progress | None
) -> None:
    size = values.size * dtype.itemsize
    blocks = -(-size // BLOCK_BYTES)
    with atomic_write(path, overwrite=overwrite, needed=packed_bytes(size)) as file:
        file.write(xml)
        begin = file.tell()
        file.write(bytes(8 * (3 + blocks)))  # the packed sizes, known at the end
        counts = [file.write(zlib.compress(block, LEVEL)) for block in _blocks(values, dtype, progress)]
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
        file.seek(begin)
        file.write(np.array([blocks, BLOCK_BYTES, size % BLOCK_BYTES, *counts], dtype="<u8").tobytes())


def _blocks(values: NDArray[Any], dtype: np.dtype[Any], progress: Progress | None) -> Iterator[bytes]:
    waiting = b""
    for piece in slabs_of_bytes(values, dtype, progress):
        data = waiting + bytes(piece)
        whole = len(data) // BLOCK_BYTES * BLOCK_BYTES
        for start in range(0, whole, BLOCK_BYTES):
            yield data[start : start + BLOCK_BYTES]
        waiting = data[whole:]
    if waiting:
        yield waiting


def _xml(grid: Grid, kind: str, name: str, dtype: np.dtype[Any], comment: str = "") -> bytes:
    """All before the numbers; ``kind`` is "Scalars" or "Vectors"."""

    def words(values: Any) -> str:
        return " ".join(map(repr, values))

    nz, ny, nx = grid.shape
    extent = f"0 {nx - 1} 0 {ny - 1} 0 {nz - 1}"
    direction = words(np.ravel(grid.direction).tolist())
    places = f'Origin="{words(grid.origin)}" Spacing="{words(grid.spacing)}" Direction="{direction}"'
    header = 'byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor"'
    components = ' NumberOfComponents="3"' if kind == "Vectors" else ""
    array = f'type="{_NAMES[dtype.str[1:]]}" Name={quoteattr(name)}{components} format="appended" offset="0"'
    return f"""<?xml version="1.0"?>
{comment}<VTKFile type="ImageData" version="1.0" {header}>
  <ImageData WholeExtent="{extent}" {places}>
    <Piece Extent="{extent}">
      <PointData {kind}={quoteattr(name)}>
        <DataArray {array}/>
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _""".encode()
