"""The climb of a likeness, coarse to fine: scenes of two pictures at each level, and the best targets so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from deformnb.compilation import float64
from deformnb.errors import DeformError
from deformnb.grey_images import GreyImage
from deformnb.likeness import BLOCK, Readable, Scene, Value, least_det, valued
from deformnb.warp_plan import Progress

# Where the map is kept from folding (one block), and where that is checked after each level, along each axis.
_LATTICE, _CHECKED = {2: 64, 3: 16}, {2: 128, 3: 32}
# A target moves at most this share of the diagonal at each level, and the two pictures share at least this much.
_REACH, _LEAST_SHARED = 0.25, 0.01
# Stands for a loss that is no number: two targets on one place.
_IMPOSSIBLE = 1e10
# An iteration that gains less likeness than this is the last of its level.
_ENOUGH = 1e-7


@dataclass
class Climb:
    """One fit under way.

    Parameters
    ----------
    first : targets, sources and settings; without pictures.
    origin, support : what its lengths are relative to.
    moving, fixed : the two pictures.
    iterations : of each level, at most.
    least : det J that is kept.
    progress : told the finished share.

    Attributes
    ----------
    history : (level, likeness) of every iteration.
    """

    first: Scene
    origin: NDArray[np.float64]
    support: float
    moving: GreyImage
    fixed: GreyImage
    iterations: int
    least: float
    progress: Progress
    history: list[tuple[int, float]] = field(default_factory=list)
    _alike: float = 0.0

    def run(self, levels: Sequence[int]) -> tuple[NDArray[np.float64], float, float, float]:
        """The best relative targets, the likeness before and after, and the smallest det J."""
        checked = self._lattice(_CHECKED)
        finest = self.level(levels[-1])
        start = self.first.x
        before = _valued_at(start, finest)
        floor = min(self.least, least_det(start, self.first.fitting, checked))
        x, found = start, [(before, start)]
        for k, factor in enumerate(levels):
            scene = replace(finest if factor == levels[-1] else self.level(factor), x=x)
            x = self._unfolded(x, self._climbed(scene, factor, k / len(levels), 1 / len(levels)), checked, floor)
            found.append((_valued_at(x, finest), x))
        after, x = min((f for f in found if f[0].alike >= before.alike), key=lambda f: f[0].loss)
        least = least_det(x, self.first.fitting, checked)
        self.progress(1.0)
        return x, before.alike, after.alike, least

    # -- scenes --------------------------------------------------------------------------------------------------------

    def level(self, factor: int) -> Scene:
        """Both pictures smoothed, and compared at every ``factor``-th pixel of the moving one.

        Coarse levels are stiffer by the same factor: targets that slide along something smooth there (a bone was seen
        to take one along by 17 pixels) do not find back at the finer ones.
        """
        pixel = self.moving.pixel
        moving, fixed = (image.smoothed(factor * pixel / 2 if factor > 1 else 0.0)
                         for image in (self.moving, self.fixed))
        indices = [np.arange((n - 1) % factor // 2, n, factor, dtype=np.float64) for n in moving.values.shape]
        places = moving.points(*indices).reshape(-1, moving.dim)
        weights = fixed.covers(places).astype(np.float64)
        if weights.mean() < _LEAST_SHARED:
            raise DeformError("the two pictures do not overlap: they must lie in the same coordinates.")
        blocks = self._blocks(places)
        pad = (0, blocks.shape[0] * BLOCK - len(places))
        readable = Readable(np.pad(moving.values, 1), moving.matrix * self.support,
                            moving.matrix @ self.origin + moving.offset + 1)
        readable, read, weights = _on_device([readable, np.pad(fixed.at(places), pad), np.pad(weights, pad)])
        return replace(self.first, moving=readable, places=_on_device(blocks), fixed=read, weights=weights,
                       lattice=self._lattice(_LATTICE), energy=self.first.energy * factor,
                       unit=factor * pixel / self.support)

    def _blocks(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Relative places in whole blocks, filled up with the first of them."""
        relative = (places - self.origin) / self.support
        full = np.concatenate([relative, np.repeat(relative[:1], -len(relative) % BLOCK, axis=0)])
        return full.reshape(-1, BLOCK, relative.shape[1])

    def _lattice(self, counts: Mapping[int, int]) -> list[Any]:
        lines = [np.linspace(-0.5, n - 0.5, counts[self.moving.dim]) for n in self.moving.values.shape]
        return _on_device(self._blocks(self.moving.points(*lines).reshape(-1, self.moving.dim)))

    # -- one level -----------------------------------------------------------------------------------------------------

    def _climbed(self, scene: Scene, factor: int, done: float, share: float) -> NDArray[np.float64]:
        """The best targets that one level finds."""
        movable = scene.free[:, 0] > 0
        shape, most = scene.x.shape, 2 * self.iterations
        best, at, calls = np.inf, np.zeros(shape), 0

        def descend(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            nonlocal calls, best, at
            self.progress(done + share * min(calls / most, 1.0))
            calls += 1
            moves = np.zeros(shape)
            moves[movable] = flat.reshape(-1, shape[1])
            value = valued(moves, scene)
            if not (np.isfinite(value.loss) and np.isfinite(value.slope).all()):
                return _IMPOSSIBLE, np.zeros_like(flat)
            if value.loss < best and value.least > 0:
                best, at = value.loss, moves
                self._alike = value.alike
            return value.loss, value.slope[movable].ravel()

        reach = _REACH * self.moving.diagonal / self.support / scene.unit
        size = int(movable.sum()) * shape[1]
        optimize.minimize(descend, np.zeros(size), jac=True, method="L-BFGS-B", bounds=[(-reach, reach)] * size,
                          callback=lambda _: self.history.append((factor, self._alike)),
                          options={"maxiter": self.iterations, "maxfun": most, "ftol": _ENOUGH})
        return scene.x + at * scene.unit

    def _unfolded(self, before: NDArray[np.float64], after: NDArray[np.float64], checked: list[Any],
                  floor: float) -> NDArray[np.float64]:
        """As far on the way from one to the other as nothing folds."""
        for share in (1.0, 0.75, 0.5, 0.25, 0.1):
            x = before + share * (after - before)
            if least_det(x, self.first.fitting, checked) >= floor:
                return x
        return before


def _valued_at(x: NDArray[np.float64], scene: Scene) -> Value:
    return valued(np.zeros(x.shape), replace(scene, x=x))


def _on_device(parts: Any) -> list[Any]:
    """Each of the parts where JAX computes, in 64 bits."""
    with float64():
        return list(jax.device_put(list(parts)))
