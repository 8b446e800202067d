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

from deformnb import devices
from deformnb._jax import as_numpy, jax, jnp
from deformnb._typing import Progress
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume import sampling
from deformnb.volume.channels import Channels
from deformnb.volume.converters import convert
from deformnb.volume.labelled import is_labelled, unstack
from deformnb.volume.plane import Raster
from deformnb.volume.sampling import METHODS
from deformnb.volume.volume import DTYPES, Grid, Volume, VolumeLike, as_grid, as_output, as_volume, as_volumes
from deformnb.warping import planning
from deformnb.warping.compositions import ComposedEvaluator, Displacements, Replacement
from deformnb.warping.map_checks import add_cautions, map_notes
from deformnb.warping.modulated_cuts import CutPlan, plan_cut


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
    share = opacity.reshape(-1)[at].reshape([-1] + [1] * (values.ndim - opacity.ndim))
    if values.flags.c_contiguous:  # one index is four times as fast as three
        values = values.reshape(opacity.size, *values.shape[opacity.ndim :])
    else:
        at = np.unravel_index(at, opacity.shape)
    some = values[at]
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
    method: str | None = None,
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
    method: str | None = None,
    step: int = 1,
    progress: Progress | None = None,
) -> Volume: ...


def warp(
    volume: Channels | VolumeLike,
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: str | None = None,
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
    step : 1 evaluates the field at every voxel. h > 1 evaluates it at every h-th voxel along each axis and interpolates
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

    What depends on the volume alone is made once: the array in JAX's memory, the coefficients of the cubic spline and,
    where :meth:`prepare` requires it, a copy with the axis of extrusion last in memory. May be called from several
    threads at once.

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
        method: str | None = None,
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
        self._index = "int64" if volume.grid.size > sampling.LARGEST_INT32 else "int32"
        self._places = planning.places(volume.grid, self.output, self.compute)
        self._near = self._places.is_near(volume.shape)
        self._tables: dict[int, Any] = {}  # of the prepared axes; None for x, whose rows are read in place

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
        if not devices.is_host() or (plan.weights is not None and plan.normal == 2):
            values = self._run_blocks(plan, progress)
        elif plan.normal == 2 or (plan.weights is None and plan.normal in self._tables and self._is_whole(plan.normal)):
            values = self._rows(plan, progress)
            values = values if plan.normal in self._tables else _writable(values)
        else:
            values = self._run_extrusion(plan, progress)
        if plan.opacity is None:
            return values
        rows = np.moveaxis(values, plan.normal, 2)  # which fade as a whole
        return np.moveaxis(self._fade(rows, plan.opacity), 2, plan.normal)

    def prepare(self, axis: int) -> None:
        """Make replicated edits along an array axis (0, 1, 2 for z, y, x) as fast as they can be.

        Costs one copy of the volume. Along x it costs nothing, and saves a copy of the result; a GPU needs none.
        """
        if devices.is_host() and axis not in self._tables:
            rows = np.moveaxis(self._voxels, axis, 2)
            with self._arithmetic():
                self._tables[axis] = None if axis == 2 else sampling.to_device(rows, (-1, rows.shape[2]))

    @property
    def _voxels(self) -> NDArray[Any]:
        values = self.volume.finite_values
        return values.view(np.uint8) if values.dtype == np.bool_ else values

    def _is_whole(self, axis: int) -> bool:
        return self.output.shape[axis] == self.volume.shape[axis]

    def _first(self, axis: int) -> int:
        """The volume's slice along an axis that is the output's first one, where both have the same."""
        return int(self._places.whole[axis][axis, 0])

    def _arithmetic(self) -> Any:
        return sampling.arithmetic(self.volume.dtype, self.volume.grid.size)

    @cached_property
    def _flat(self) -> Any:
        """The voxels, or the spline's coefficients, in JAX's memory."""
        values = self._voxels
        if METHODS[self.method].is_spline:
            values = sampling.spline_coefficients(values, self.compute)
        return sampling.share_with_jax(values)

    def _fade(self, values: NDArray[Any], opacity: NDArray[np.float32]) -> NDArray[Any]:
        return apply_opacity(values, opacity, self._fill, discrete=not METHODS[self.method].blends)

    def load(self) -> None:
        """Prepare the samples, before threads share them."""
        with self._arithmetic():
            _ = self._flat

    def empty(self) -> NDArray[Any]:
        """An array for the result."""
        return np.empty(self.output.shape, self._voxels.dtype)

    def sample_block(self, own: Displacements, block: tuple[slice, slice], step: int) -> NDArray[Any]:
        """The voxels of a block, whose displacements are known at every ``step``-th of them."""
        at = self._places
        with self._arithmetic():
            result = as_numpy(
                sampling.general(
                    self._flat,
                    own.d,
                    at.matrix,
                    *at.block(block),
                    self._fill,
                    own.nodes,
                    step=step,
                    straight=at.is_straight,
                    **self._settings(),
                )
            )
        return result if own.opacity is None else self._fade(result, own.opacity)

    def sample_voxels(self, known: Replacement) -> NDArray[Any]:
        """Single voxels, whose displacements are known."""
        voxels, d, opacity = known
        at = self._places
        with self._arithmetic():
            result = as_numpy(
                sampling.listed(self._flat, d, voxels, at.matrix, at.whole, at.part, self._fill, **self._settings())
            )
        return result if opacity is None else self._fade(result, opacity)

    def replace_near_cut(
        self, out: NDArray[Any], cut: CutPlan, part: tuple[slice, NDArray[np.intp]], d: Any, opacity: Any
    ) -> None:
        """Put in a result the voxels of a part of those so near a cut that it may open."""
        normal, depth, pixels = cut.apart.normal, part[0], cut.pixels[:, part[1]]
        with self._arithmetic():
            result = as_numpy(
                sampling.extruded(
                    self._flat,
                    (d,),
                    np.ones((1, d.shape[normal + 1]), np.float32),
                    cut.apart.matrix,
                    *self._places.select(normal, depth, pixels),
                    self._fill,
                    normal=normal,
                    **self._settings(),
                )
            )
        np.moveaxis(out, normal, 2)[*pixels, depth] = np.moveaxis(self._fade(result, opacity), normal, 2)[0]

    def _settings(self) -> dict[str, Any]:
        return {
            "shape": self.volume.shape,
            "method": self.method,
            "compute": self.compute,
            "index": self._index,
            "near": self._near,
        }

    def _run_extrusion(self, plan: planning.Extruded, progress: Progress | None) -> NDArray[Any]:
        """A few slices along the normal at a time: they need nothing of the other slices, so no copy of all is made."""
        axis, n = plan.normal, self.output.shape[plan.normal]
        out = np.empty(self.output.shape, self._voxels.dtype)
        before, first = (slice(None),) * axis, self._first(axis)
        # Transposed parts cost a call each way. Those read as words take 29 ms in 16 calls, 25 in 4, but hold more
        # memory.
        blocks = (2 if self._is_crowded(axis) else 4) if plan.weights is None else 2 if self._has_words(axis) else 1
        most = planning.BLOCK_VOXELS * blocks * n // self.output.size
        most = min(most, -(-n // planning.processors()))  # a part for each processor
        parts = planning.parts(n, most)
        move = self._replicate_slices(plan) if plan.weights is None else self._modulate_slices(plan, parts[0].stop)

        def work(part: slice) -> None:
            voxels = self._voxels[*before, slice(first + part.start, first + part.stop)]
            with self._arithmetic():
                out[*before, part] = move(voxels, part)

        _share([self], parts, work, progress)
        return out

    def _replicate_slices(self, plan: planning.Extruded) -> Callable[[NDArray[Any], slice], NDArray[Any]]:
        """Slices under one map: a few, transposed so that voxels of one displacement are contiguous, and back."""
        normal, axes = plan.normal, [axis for axis in range(3) if axis != plan.normal]
        at = self._places.along(axes, plan.matrix)
        settings = self._settings() | {"shape": tuple(self.volume.shape[axis] for axis in axes)}
        count, gap = plan.maps.shape[2], int(self._is_crowded(normal))
        maps = np.pad(plan.maps[0], ((0, 0), (0, gap), (0, 0)), mode="edge")  # one more row behind each slice
        with self._arithmetic():
            taps, ok = sampling.row_taps(maps, at.matrix, *at.block((slice(0, count + gap),)), **settings)

        def move(voxels: NDArray[Any], _part: slice) -> NDArray[Any]:
            rows = sampling.rows_by(
                sampling.move_axis(sampling.add_row_gaps(voxels) if gap else voxels, normal, 2),
                taps,
                ok,
                self._fill,
                method=self.method,
                compute=self.compute,
            )
            slices = np.asarray(sampling.move_axis(np.asarray(rows), 2, normal))
            return slices[:, :count] if gap else slices

        return move

    def _is_crowded(self, axis: int) -> bool:
        """Check whether slices along an axis begin whole pages apart, so that they evict each other from the cache."""
        return axis == 0 and self._voxels[0].nbytes % 4096 == 0

    def _modulate_slices(self, plan: planning.Extruded, count: int) -> Callable[[NDArray[Any], slice], NDArray[Any]]:
        """``count`` slices under maps whose weights change from one to the next."""
        normal, weights = plan.normal, plan.weights
        assert weights is not None
        if self._has_words(normal):
            return self._modulate_words(plan, weights)
        whole, fraction = list(self._places.whole), list(self._places.part)
        whole[normal] = np.zeros((3, count), np.int32)
        whole[normal][normal] = np.arange(count)
        fraction[normal] = np.zeros((3, count), self.compute)
        with self._arithmetic():  # on JAX's side once, and not again for every part
            fixed = jnp.asarray(plan.maps[*[slice(None)] * (normal + 2), None]), plan.matrix, whole, fraction
            maps, matrix, whole, fraction = jax.tree.map(jnp.asarray, fixed)

        def move(voxels: NDArray[Any], part: slice) -> NDArray[Any]:
            return as_numpy(
                sampling.extruded(
                    sampling.share_with_jax(voxels),
                    maps,
                    weights[:, part],
                    matrix,
                    whole,
                    fraction,
                    self._fill,
                    normal=normal,
                    **self._settings() | {"shape": voxels.shape},
                )
            )

        return move

    def _has_words(self, normal: int) -> bool:
        """Check whether slices along ``normal`` hold small integers, read as words, of which most are read."""
        source, output = (np.delete(shape, normal) for shape in (self.volume.shape, self.output.shape))
        return (
            normal != 2
            and self._voxels.dtype.kind in "iu"
            and self._voxels.dtype.itemsize <= 2
            and self.method == "linear"
            and devices.is_host()
            and self._near
            and min(source) > 1
            and bool(np.prod(source) <= min(2 * np.prod(output), sampling.MOST_WORDS))
        )

    def _modulate_words(
        self, plan: planning.Extruded, weights: NDArray[np.float32]
    ) -> Callable[[NDArray[Any], slice], NDArray[Any]]:
        """:meth:`_modulate_slices` for small integers. NumPy computes what the parts share: it compiles nothing."""
        normal = plan.normal
        at = self._places.along([axis for axis in range(3) if axis != normal], plan.matrix)
        m = at.matrix[:, :, None, None]
        moves = [m[:, 0] * one[0] + m[:, 1] * one[1] for one in plan.maps]
        fixed = moves, *([_outer_sum(rows[a], columns[a]) for a in range(2)] for rows, columns in (at.whole, at.part))
        with self._arithmetic():
            moves, whole, part = jax.tree.map(jnp.asarray, fixed)

        def move(voxels: NDArray[Any], some: slice) -> NDArray[Any]:
            slices = np.moveaxis(voxels, normal, 0)
            result = sampling.slices_in_words(
                sampling.share_with_jax(slices),
                moves,
                weights[:, some],
                whole,
                part,
                self._fill,
                shape=slices.shape[1:],
            )
            return np.moveaxis(as_numpy(result), 0, normal)

        return move

    def _run_blocks(self, plan: planning.Extruded, progress: Progress | None) -> NDArray[Any]:
        """Parts along z and y: of maps that change along x, for slices would have to be cut out of every row; and of
        any map on a GPU, which holds the whole volume.
        """
        normal, outs = plan.normal, [np.empty(self.output.shape, self._voxels.dtype)]
        with self._arithmetic():
            flat = self._flat
        maps = plan.maps.reshape(*plan.maps.shape[: 2 + normal], 1, *plan.maps.shape[2 + normal :])

        def work(block: tuple[slice, slice]) -> None:
            of_map = [slice(None) if axis == normal else part for axis, part in enumerate(block)]
            weights = None if plan.weights is None else plan.weights[:, (*block, slice(None))[normal]]
            with self._arithmetic():
                result = sampling.extruded(
                    flat,
                    maps[:, :, *of_map],
                    weights,
                    plan.matrix,
                    *self._places.block(block),
                    self._fill,
                    normal=normal,
                    **self._settings(),
                )
            _store(outs, 0, block, as_numpy(result))

        _share([self], planning.blocks(self.output.shape, 1), work, progress)
        return outs[0]

    def _rows(self, plan: planning.Extruded, progress: Progress | None) -> NDArray[Any]:
        axes = [axis for axis in range(3) if axis != plan.normal]
        shape = tuple(self.volume.shape[axis] for axis in axes)
        at = self._places.along(axes, plan.matrix)
        settings = self._settings() | {"shape": shape}
        with self._arithmetic():
            first = np.asarray(self._first(2), self._index)
            table = (
                self._tables[plan.normal]
                if plan.normal != 2
                else sampling.Rows(self._flat, first, self.output.shape[2])
            )
        out = _move_rows(table, plan.maps[0], at, self._fill, settings, progress)
        return np.moveaxis(out, 2, plan.normal)


def _outer_sum(rows: NDArray[Any], columns: NDArray[Any]) -> NDArray[np.float32]:
    """``rows[:, None] + columns``, of extent 1 along an axis that brings nothing to it."""
    some = rows[:, None] if rows.any() else np.zeros((1, 1), rows.dtype)
    return (some + columns if columns.any() else some).astype(np.float32)


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
    step = 1 if field.has_cuts else warpers[0].step  # no displacement is interpolated across a cut

    chain = ComposedEvaluator(field, grid)
    by_lattice = chain.is_single or step > 1
    ends = (0.0, 1.0, 1.0) if by_lattice else _ENDS
    if not by_lattice:
        chain.prepare(_progress_range(progress, 0.0, ends[0]))

    def work(block: tuple[slice, slice]) -> None:
        own = (
            _lattice_displacements(field, planning.lattice(grid, block, step), step)
            if by_lattice
            else chain.block(block)
        )
        for k, warper in enumerate(warpers):
            _store(outs, k, block, warper.sample_block(own, block, step), is_final=by_lattice)
        for known in own.exact:
            replace(known)

    def replace(known: Replacement) -> None:
        for warper, out in zip(warpers, outs, strict=True):
            out[known[0]] = warper.sample_voxels(known)

    parts = planning.blocks(grid.shape, step) if by_lattice else planning.square_blocks(grid.shape)
    _share(warpers, parts, work, _progress_range(progress, *ends[:2]))
    if not by_lattice:
        _share(warpers, chain.replacements(), lambda find: replace(find()), _progress_range(progress, *ends[1:]))
    return outs


def _store(
    outs: list[NDArray[Any]], k: int, block: tuple[slice, slice], result: NDArray[Any], *, is_final: bool = True
) -> None:
    """Put a block of the k-th result in its place; what ends beyond it is cut off.

    One that comes from a GPU, is the whole result and is final, so that it may be read-only, is not copied once more:
    that would take longer than the warp.
    """
    target = outs[k][block]
    if is_final and not devices.is_host() and target.shape == outs[k].shape == result.shape:
        outs[k] = result
    else:
        target[...] = result[: target.shape[0], : target.shape[1]]


def _lattice_displacements(field: AbstractField, lattice: Grid, step: int) -> Displacements:
    """Stored samples as they are, anything else evaluated at every node of a lattice."""
    stored = planning.interpolation_tables(field, lattice) if step == 1 else None
    if stored is not None:
        return Displacements(*stored)
    d, opacity = planning.displacements_and_opacity(field, lattice, step)
    return Displacements(d, opacity=opacity)


def _warp_near_cuts(warpers: Sequence[Warper], cut: CutPlan, progress: Progress | None) -> list[NDArray[Any]]:
    """Cuts that open with depth: first every region separately, then voxels so near a cut that it may open."""
    outs = [_writable(warper.run_plan(cut.apart, None)) for warper in warpers]
    for warper in warpers:
        warper.load()

    def work(part: tuple[slice, NDArray[np.intp]]) -> None:
        d, opacity = cut.displacement_and_opacity(*part)
        for warper, out in zip(warpers, outs, strict=True):
            warper.replace_near_cut(out, cut, part, d, opacity)

    _share(warpers, cut.parts(), work, progress)
    return outs


def warp_all(
    volumes: Sequence[VolumeLike],
    field: AbstractField | HasField,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: str | None = None,
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


def _move_rows(
    table: Any,
    maps: NDArray[np.float32],
    at: planning.Places,
    fill: Any,
    settings: dict[str, Any],
    progress: Progress | None = None,
) -> NDArray[Any]:
    """Rows of voxels or the channels of pixels, moved as a whole: (rows, columns, n)."""
    shape = (*maps.shape[1:], table.shape[-1])

    def move(chunk: slice) -> NDArray[Any]:
        with sampling.arithmetic(fill.dtype, table.size):
            done = sampling.rows(table, maps[:, chunk], at.matrix, *at.block((chunk,)), fill, **settings)
        return as_numpy(done)

    chunks = planning.chunks(shape[0], shape[1] * shape[2] * fill.dtype.itemsize)
    if len(chunks) == 1:  # the kernel's own memory, not copied
        whole = move(chunks[0])
        if progress:
            progress(1.0)
        return whole
    out = np.empty(shape, fill.dtype)

    def work(chunk: slice) -> None:
        out[chunk] = move(chunk)

    planning.run_parts(chunks, work, progress)
    return out


def warp_picture(
    values: NDArray[Any],
    raster: Raster,
    field: AbstractField,
    *,
    output: Raster | None = None,
    fill: float | None = None,
    method: str | None = None,
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
    if METHODS[method].is_spline:
        pixels = sampling.spline_coefficients(pixels, compute, axes=(0, 1))
    with sampling.arithmetic(values.dtype, 0):
        # The channels of a pixel are what a row of voxels is to a replicated map: they move together.
        table = sampling.to_device(pixels.reshape(raster.shape[0] * raster.shape[1], -1))
    at = planning.picture_places(raster, output, compute)
    settings = {
        "shape": raster.shape,
        "method": method,
        "compute": compute,
        "index": "int32",
        "near": at.is_near(raster.shape),
    }
    d, opacity = planning.raster_with_opacity(field, output)
    result = _move_rows(table, d, at, lowest, settings)
    if opacity is not None:
        result = apply_opacity(result, opacity, lowest, discrete=not METHODS[method].blends)
    return result.view(values.dtype).reshape(*output.shape, *values.shape[2:])


def _finite_pixels(values: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Pixels with NaN and infinity replaced by the smallest finite value, and that value; bool as 0 and 1."""
    if values.dtype == np.bool_:
        values = values.view(np.uint8)
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros_like(values), 0.0
    background = values[finite].min()
    return values if finite.all() else np.where(finite, values, background), float(background)
