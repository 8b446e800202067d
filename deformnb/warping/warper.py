"""Warping of volumes and pictures by backward sampling.

Points move forwards, see :mod:`deformnb.warping.points`.

``output(x) = input(x + D(x))``. The kernel is chosen by the kind of field: one replicated map moves whole
rows of voxels, an extruded map moves nothing along its normal, anything else is computed block by block from the
field's values on the output's lattice. All three give the same voxels.

The paper's transparency map A is applied to voxels too: those that a cut hides become the background.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, DisplacementField, HasField, as_field
from deformnb.volume import sampling
from deformnb.volume.channels import Channels
from deformnb.volume.converters import convert
from deformnb.volume.labelled import is_labelled, unstack
from deformnb.volume.plane import Raster
from deformnb.volume.sampling import METHODS, SamplingName
from deformnb.volume.volume import DTYPES, Grid, Volume, VolumeLike, as_grid, as_output, as_volume, as_volumes
from deformnb.warping import planning
from deformnb.warping.compositions import ComposedEvaluator, Displacements, Patch, Replacement
from deformnb.warping.map_checks import add_cautions, map_notes
from deformnb.warping.modulated_cuts import CutPlan, plan_cut
from deformnb.warping.result_memory import ResultMemory
from deformnb.warping.voxel_readers import VoxelInput, VoxelReader, make_reader, store


def apply_opacity(values: NDArray[Any], opacity: NDArray[Any], fill: Any, *, discrete: bool) -> NDArray[Any]:
    """``fill + A (value - fill)``; what has nothing in between is shown from A = 1/2 on: labels, bool, a fill of NaN.

    Parameters
    ----------
    values : voxels; changed in place where they may be, else copied.
    discrete : nothing in between may be made up.
    opacity : A from 0 to 1, of the shape of the first axes of ``values``.
    fill : the background, of the type of the voxels.

    Examples
    --------
    >>> apply_opacity(np.array([10, 20, 30], np.uint8), np.array([1.0, 0.5, 0.0]), np.uint8(1), discrete=False).tolist()
    [10, 11, 1]
    """
    at: Any = np.flatnonzero(opacity < 1)  # along the cuts only
    if not len(at):
        return values
    whole = values = _writable(values)
    shares = opacity.reshape(-1)[at]
    is_seen = shares > 0
    hidden, at, shares = at[~is_seen], at[is_seen], shares[is_seen]
    if values.flags.c_contiguous:  # one index is four times as fast as three
        values = values.reshape(opacity.size, *values.shape[opacity.ndim :])
    else:
        hidden, at = (np.unravel_index(places, opacity.shape) for places in (hidden, at))
    values[hidden] = fill
    share, some = shares.reshape([-1] + [1] * (whole.ndim - opacity.ndim)), values[at]
    if discrete or not np.isfinite(fill):
        values[at] = np.where(share < 0.5, fill, some)
        return whole
    mixed = float(fill) + share * (some.astype(np.float64) - float(fill))
    values[at] = np.floor(mixed + 0.5) if values.dtype.kind in "iu" else mixed
    return whole


def _writable(values: NDArray[Any]) -> NDArray[Any]:
    return values if values.flags.writeable else values.copy(order="K")


_Part = TypeVar("_Part")

# The share of the work that is done when the nodes are evaluated, when the blocks are read from them, and when voxels
# near cuts and parts are replaced.
_ENDS = 0.25, 0.75, 1.0


@overload
def warp(
    volume: Channels,
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
    step: int = 1,
    progress: Progress | None = None,
) -> Channels: ...


@overload
def warp(
    volume: VolumeLike,
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
    step: int = 1,
    progress: Progress | None = None,
) -> Volume: ...


def warp(
    volume: Channels | VolumeLike,
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
    step: int = 1,
    progress: Progress | None = None,
) -> Any:
    """The deformed volume: ``output(x) = input(x + D(x))``.

    Parameters
    ----------
    volume : the voxels to deform; NaN and infinity count as background. Any volume is accepted
        (:data:`~deformnb.volume.volume.VolumeLike`). Channels are deformed by one map, and the result is Channels too.
        So is an ``xarray.DataArray``, whose result has its dimensions, coordinates and attributes: the axes of its
        other dimensions (channels, time) are deformed by the same map.
    field : backward displacements in space, of dimension 3; or a Deformation, which is applied.
    output : the grid of the result (field of view and resolution); default is the volume's.
    fill : value of places more than half a voxel outside the volume; default is the volume's background.
    method : a name of :data:`METHODS`: "nearest", "linear" or "cubic" (B-spline, mirrored at the
        edges). Default is linear, and nearest for labels and bool.
    step : 1 evaluates the field at every voxel; a single fit of many points is interpolated where it is smooth, at most
        a thousandth of a voxel from that. h > 1 evaluates it at every h-th voxel along each axis and interpolates
        linearly; the error of the displacement is at most ``h^2/8 (|D_xx| + |D_yy| + |D_zz|)``, derivatives by voxel.
        Extruded fields along an axis of the grid are exact and fast at any step, and with cuts every voxel counts.
        Compositions and stages are interpolated where they are smooth, at most a hundredth of a voxel
        (:data:`deformnb.warping.compositions.ERROR`) from the displacement at every voxel.
    progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    Volume of the same voxel type, with the notes of the one that was given; Channels of Channels, and a DataArray of
    one. Integers are rounded to the nearest, halves upwards, and clipped to their type.

    Raises
    ------
    DeformError
        If the field is not one in space, is not finite, or the options do not fit the voxels; in a process made by
        ``fork`` after its parent has deformed something, where JAX would wait for ever.

    Notes
    -----
    All processors are used already. To share work among processes all the same, start them with "spawn":
    ``ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))``.

    See Also
    --------
    Warper : the same for many edits of one volume.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> volume = Volume(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), Grid((2, 3, 4)))
    >>> bool((warp(volume, Identity()).values == volume.values).all())
    True
    """
    options: dict[str, Any] = {"fill": fill, "method": method, "step": step}
    if output is not None:  # else a deformation has its own
        options["output"] = as_grid(output)
    volumes, made_of = volumes_of(volume)
    return made_of(deform_volumes(volumes, field, **options, progress=progress))


def volumes_of(given: Any) -> tuple[list[Volume], Callable[[Sequence[Volume]], Any]]:
    """The volumes of one grid that an object consists of, and a function that makes one of its kind of their results.

    Channels make channels, an array of xarray makes one, and all else that is a volume makes a Volume.

    Examples
    --------
    >>> volumes, made_of = volumes_of(np.zeros((2, 3, 4)))
    >>> len(volumes), made_of(volumes) is volumes[0]
    (1, True)
    """
    if is_labelled(given):
        return unstack(given)
    subject = convert(given)
    if isinstance(subject, Channels):
        return list(subject), subject.with_volumes
    return [subject], lambda results: results[0]


def deform_volumes(volumes: list[Volume], field: Any, **options: Any) -> list[Volume]:
    """Volumes on one grid through a field, or a Deformation, whose result may have another grid.

    Parameters
    ----------
    options : those of :func:`warp_all`.
    """
    apply_all = getattr(field, "apply_all", None)
    if callable(apply_all) and not isinstance(field, AbstractField | type):
        done: list[Volume] = apply_all(volumes, **options)
        return done
    first, output = volumes[0], options.get("output")
    results = warp_all(volumes, field, **options)
    box = first.grid if output is None else as_grid(output)
    cautions = map_notes(first, as_field(field, first), box, options.get("fill"))
    return add_cautions(volumes, results, (), cautions)


class Warper:
    """A volume made ready for many edits; call it with a field. Parameters are those of :func:`warp`.

    What depends on the volume alone is made once: on a GPU the array in its memory, the coefficients of the cubic
    spline and, where :meth:`prepare` requires it, a copy with the axis of extrusion last in memory. May be called from
    several threads at once.

    Notes
    -----
    Along a prepared axis z or y the result's values are a view of an array in another order: right in every respect,
    but not C-contiguous. Pass ``np.ascontiguousarray(values)`` to code that needs that. Values may be read-only.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.volume.volume import Volume
    >>> warper = Warper(Volume.from_array(np.arange(8, dtype=np.uint8).reshape(2, 2, 2)))
    >>> warper(Identity(3)).values.ravel().tolist()
    [0, 1, 2, 3, 4, 5, 6, 7]
    """

    def __init__(
        self,
        volume: VolumeLike,
        *,
        output: Grid | VolumeLike | None = None,
        fill: float | None = None,
        method: SamplingName | None = None,
        step: int = 1,
    ) -> None:
        volume = as_volume(volume)
        discrete = volume.is_labels or volume.dtype == np.bool_
        self.volume = volume
        self.output = volume.grid if output is None else as_output(output, volume.grid)
        self.method = planning.check_method(method, discrete=discrete)
        self.fill = volume.background if fill is None else fill
        if not (isinstance(step, int | np.integer) and 1 <= step < 2**31):
            raise DeformError(f"step must be a whole number of voxels, at least 1, got {short_value(step)}.")
        self.step = int(step)
        self._fill = planning.as_voxel(self.fill, volume.dtype)
        self.compute = sampling.compute_type(volume.dtype)
        self._places = planning.places(volume.grid, self.output, self.compute)
        self._memory = ResultMemory()

    def __call__(self, field: AbstractField | HasField, *, progress: Progress | None = None) -> Volume:
        """The volume deformed by ``field``; see :func:`warp`."""
        return _together([self], field, progress)[0]

    def to_volume(self, values: NDArray[Any]) -> Volume:
        """The result as a volume."""
        if self.volume.dtype == np.bool_:
            values = values.view(np.bool_)
        return Volume(values, self.output, self.volume.name, self.volume.is_labels, self.volume.notes)

    def run_plan(self, plan: planning.Extruded, progress: Progress | None) -> NDArray[Any]:
        """The voxels under an extruded map, in the quickest way."""
        values = self._reader.read_extruded(plan, lambda parts, work: _share([self], parts, work, progress))
        if plan.opacity is None:
            return values
        rows = np.moveaxis(values, plan.normal, 2)  # which fade as a whole
        return np.moveaxis(self._fade(rows, plan.opacity), 2, plan.normal)

    def prepare(self, axis: int) -> None:
        """Make replicated edits along an array axis (0, 1, 2 for z, y, x) as fast as they can be.

        Costs one copy of the volume. Along x it costs nothing; a GPU needs none.
        """
        self._reader.prepare(axis)

    @cached_property
    def _reader(self) -> VoxelReader:
        values = _small_values(self.volume.finite_values)
        return make_reader(VoxelInput(values, self._places, self.method, self._fill, self._memory))

    def _fade(self, values: NDArray[Any], opacity: NDArray[np.float32]) -> NDArray[Any]:
        return apply_opacity(values, opacity, self._fill, discrete=not METHODS[self.method].blends)

    def load(self) -> None:
        """Prepare the samples, before threads share them."""
        self._reader.load()

    def empty(self) -> NDArray[Any]:
        """An array for the result."""
        return self._memory.empty(self.output.shape, self._fill.dtype)

    def read_block(self, out: NDArray[Any], own: Displacements, block: planning.BlockSlices) -> NDArray[Any]:
        """The voxels of a block, whose displacements are known; in ``out`` or elsewhere."""
        result = self._reader.read_block(out, block, own.d, own.nodes)
        return result if own.opacity is None else self._fade(result, own.opacity[: len(out), : out.shape[1]])

    def read_patch(self, out: NDArray[Any], patch: Patch) -> None:
        """Those voxels of a box that read other nodes, in ``out``."""
        found = self._fill
        if not patch.is_hidden:
            found = self._reader.read_block(np.empty(out.shape, out.dtype), patch.box, patch.d, patch.nodes)
        np.copyto(out, found, where=patch.is_own)

    def read_voxels(self, known: Replacement, matrix: NDArray[Any] | None = None) -> NDArray[Any]:
        """Single voxels, whose displacements are known."""
        result = self._reader.read_voxels(known.voxels, known.d, matrix)
        return result if known.opacity is None else self._fade(result, known.opacity)


def _small_values(values: NDArray[Any]) -> NDArray[Any]:
    """Bool as uint8."""
    return values.view(np.uint8) if values.dtype == np.bool_ else values


def _together(warpers: Sequence[Warper], field: AbstractField | HasField, progress: Progress | None) -> list[Volume]:
    """The volumes of several warpers, of one grid and one output, deformed by one field that is evaluated once."""
    first = warpers[0]
    field, grid, output = as_field(field, first.volume), first.volume.grid, first.output
    if field.dim != 3:
        raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
    for warper in warpers:
        _ = warper.volume.values  # raises where its file has changed
    plan, cut = None, None
    if not METHODS[first.method].is_spline:  # its coefficients hold the value along the normal in three taps
        plan = planning.plan_extrusion(field, grid, output, first.compute)
        cut = None if plan else plan_cut(field, grid, output, first.compute)
    try:
        if cut:
            values = _warp_near_cuts(warpers, cut, progress)
        elif plan:
            values = [warper.run_plan(plan, _portion(progress, k, len(warpers))) for k, warper in enumerate(warpers)]
        else:
            values = _general(warpers, field, progress)
    except MemoryError:
        nz, ny, nx = output.shape
        raise DeformError(
            f"there is not enough memory for a result of {nx} x {ny} x {nz} voxels; make its box "
            "smaller or its spacing larger (output)."
        ) from None
    return [warper.to_volume(result) for warper, result in zip(warpers, values, strict=True)]


def _portion(progress: Progress | None, k: int, count: int) -> Progress | None:
    """The progress of the k-th of several pieces of work that take equally long."""
    return _progress_range(progress, k / count, (k + 1) / count)


def _progress_range(progress: Progress | None, first: float, last: float) -> Progress | None:
    """The progress of a piece of work that takes the whole from one share to another."""
    return None if progress is None else lambda share: progress(first + share * (last - first))


def _share(
    warpers: Sequence[Warper], parts: Sequence[_Part], work: Callable[[_Part], None], progress: Progress | None
) -> None:
    """Do all parts; the file of a memory map is checked before each, for JAX reads from the map itself."""

    def checked(part: _Part) -> None:
        for warper in warpers:
            _ = warper.volume.values
        work(part)

    planning.run_parts(parts, checked, progress)


def _general(warpers: Sequence[Warper], field: AbstractField, progress: Progress | None) -> list[NDArray[Any]]:
    """Any field, block by block: its displacements in a block are found once, and all volumes are read there."""
    grid = warpers[0].output
    outs = [warper.empty() for warper in warpers]
    for warper in warpers:
        warper.load()
    # No displacement is interpolated across a cut, and stored ones need not be evaluated.
    step = 1 if field.has_cuts or isinstance(field, DisplacementField) else warpers[0].step

    chain = ComposedEvaluator(field, grid)
    by_lattice = chain.is_single or step > 1
    ends = (0.0, 1.0, 1.0) if by_lattice else _ENDS
    if not by_lattice:
        chain.prepare(_progress_range(progress, 0.0, ends[0]))

    stored = planning.samples_at_voxels(field, grid)

    def work(block: tuple[slice, slice]) -> None:
        if stored is not None:
            own = Displacements(tuple(component[block] for component in stored))
        elif by_lattice:
            own = _lattice_displacements(field, grid, block, step)
        else:
            own = chain.block(block)
        for k, warper in enumerate(warpers):
            store(outs, k, block, warper.read_block(outs[k][block], own, block), is_final=by_lattice)
            for patch in own.patches:
                warper.read_patch(outs[k][patch.box], patch)
        for known in own.exact:
            replace(known)

    def replace(known: Replacement) -> None:
        for warper, out in zip(warpers, outs, strict=True):
            out[known.voxels] = warper.read_voxels(known)

    parts = planning.blocks(grid.shape, step) if by_lattice else planning.square_blocks(grid.shape)
    _share(warpers, parts, work, _progress_range(progress, *ends[:2]))
    if not by_lattice:
        _share(warpers, chain.replacements(), lambda find: replace(find()), _progress_range(progress, *ends[1:]))
    return outs


def _lattice_displacements(field: AbstractField, grid: Grid, block: planning.BlockSlices, step: int) -> Displacements:
    """Stored samples as they are, anything else evaluated at every node of the lattice of a block."""
    lattice = planning.lattice(grid, block, step)
    stored = planning.interpolation_tables(field, lattice) if step == 1 else None
    if stored is not None:
        return Displacements(*stored)
    d, opacity = planning.displacements_and_opacity(field, lattice)
    lengths = [part.stop - part.start for part in block] + [grid.shape[2]]
    return Displacements(d, planning.step_tables(lengths, step) if step > 1 else None, opacity)


def _warp_near_cuts(warpers: Sequence[Warper], cut: CutPlan, progress: Progress | None) -> list[NDArray[Any]]:
    """Cuts that open with depth: first every region separately, then voxels so near a cut that it may open."""
    outs = [_writable(warper.run_plan(cut.apart, None)) for warper in warpers]
    for warper in warpers:
        warper.load()

    def work(part: tuple[slice, NDArray[np.intp]]) -> None:
        known, matrix = cut.replacement(*part), cut.matrix
        for warper, out in zip(warpers, outs, strict=True):
            out[known.voxels] = warper.read_voxels(known, matrix)

    _share(warpers, cut.parts(), work, progress)
    return outs


def warp_all(
    volumes: Sequence[VolumeLike],
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
    step: int = 1,
    progress: Progress | None = None,
) -> list[Volume]:
    """Several volumes on one grid, such as channels, deformed by one map, whose displacements are computed once.

    Parameters
    ----------
    volumes : on one grid, of any voxel types.
    field, output, fill, method, step, progress : as in :func:`warp`; the default of fill and method is each volume's
        own.

    Raises
    ------
    DeformError
        If the volumes are not on one grid, or as :func:`warp`.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> red, green = Volume.from_array(np.eye(3)), Volume.from_array(np.ones((3, 3)))
    >>> [volume.values.sum() for volume in warp_all([red, green], Identity())]
    [np.float64(3.0), np.float64(9.0)]
    """
    volumes = as_volumes(volumes)
    if not volumes:
        raise DeformError("there are no volumes to deform.")
    grid = volumes[0].grid
    for volume in volumes:
        if volume.grid != grid:
            raise DeformError(
                f"the volumes {volumes[0].name!r} and {volume.name!r} do not lie on one grid, so that "
                "one map cannot move both; deform each by itself."
            )
    warpers = [Warper(volume, output=output, fill=fill, method=method, step=step) for volume in volumes]
    groups: dict[tuple[str, bool], list[int]] = {}
    for k, warper in enumerate(warpers):  # a map is planned in the precision of the voxels
        groups.setdefault((warper.compute, METHODS[warper.method].is_spline), []).append(k)
    results: dict[int, Volume] = {}
    for number, members in enumerate(groups.values()):
        done = _together([warpers[k] for k in members], field, _portion(progress, number, len(groups)))
        results.update(zip(members, done, strict=True))
    return [results[k] for k in range(len(volumes))]


def warp_picture(
    values: NDArray[Any],
    raster: Raster,
    field: AbstractField,
    *,
    output: Raster | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
) -> NDArray[Any]:
    """The deformed picture: ``output(a, b) = input((a, b) + D(a, b))``.

    Parameters
    ----------
    values : pixels [v, u], or [v, u, channels] (all channels move together); any voxel type.
    raster : places of the pixels.
    field : backward displacements on the plane, of dimension 2.
    output : the raster of the result; default is the picture's.
    fill : value of places more than half a pixel outside; default is the smallest finite value.
    method : a name of :data:`~deformnb.volume.sampling.METHODS`; default is linear, and nearest for bool.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> raster = Raster((2, 3), (1.0, 1.0), (0.0, 0.0))
    >>> warp_picture(np.eye(2, 3), raster, Identity(2)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    field = as_field(field)
    if not isinstance(raster, Raster):
        raise DeformError(
            f"the pixels of a picture lie on a Raster, got {short_value(raster)}; a Picture has one: picture.raster."
        )
    values = np.asarray(values)
    if field.dim != 2:
        raise DeformError("a picture needs a field on its plane, of dimension 2; this one is in space.")
    if values.ndim not in (2, 3) or values.shape[:2] != raster.shape:
        raise DeformError(f"the picture has shape {values.shape} but its raster has {raster.shape}.")
    if values.dtype.name not in DTYPES:
        raise DeformError(f"pixels of type {values.dtype} cannot be sampled; use one of {', '.join(DTYPES)}.")
    method = planning.check_method(method, discrete=values.dtype == np.bool_)
    compute = sampling.compute_type(values.dtype)
    output = output or raster
    pixels, background = _finite_pixels(values)
    lowest = planning.as_voxel(background if fill is None else fill, values.dtype)
    at = planning.picture_places(raster, output, compute)
    d, opacity = planning.raster_with_opacity(field, output)
    channels = [
        _warp_channel(pixels.reshape(*raster.shape, -1)[..., c], at, method, lowest, d)
        for c in range(pixels[0, 0].size)
    ]
    result = channels[0][..., None] if len(channels) == 1 else np.stack(channels, axis=-1)
    if opacity is not None:
        result = apply_opacity(result, opacity, lowest, discrete=not METHODS[method].blends)
    return result.view(values.dtype).reshape(*output.shape, *values.shape[2:])


def _warp_channel(
    pixels: NDArray[Any], at: planning.Places, method: str, fill: Any, d: NDArray[np.float32]
) -> NDArray[Any]:
    """A picture of one value a pixel: a volume of one slice."""
    reader = make_reader(VoxelInput(pixels[None], at.with_slices(), method, fill))
    plan = planning.Extruded(0, d[None], None, np.concatenate([np.zeros((1, 2), at.matrix.dtype), at.matrix]))
    return reader.read_extruded(plan, lambda parts, work: planning.run_parts(parts, work, None))[0]


def _finite_pixels(values: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Pixels with NaN and infinity replaced by the smallest finite value, and that value; bool as 0 and 1."""
    if values.dtype == np.bool_:
        values = values.view(np.uint8)
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros_like(values), 0.0
    background = values[finite].min()
    return values if finite.all() else np.where(finite, values, background), float(background)
