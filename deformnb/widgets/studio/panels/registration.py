"""Registration panel: the choice of a target, and the fit of points to the similarity of the two pictures.

The fit runs in a thread, with progress and a button to stop. Its result is one edit that can be undone; if
something was edited meanwhile, that edit stays and the result is dropped.

The target is another volume, or the result of another session on this one; the panel shows it too.
"""

from __future__ import annotations

import html
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from os import PathLike
from typing import Any

import ipywidgets as ipw
import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import HAS_JAX
from deformnb.document.deformation import Deformation
from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import lone_support
from deformnb.registration.optimise import Fitted, GreyImage, fit_targets, snap_to_match
from deformnb.registration.outlines import fit_outline, outline, slide
from deformnb.registration.similarity import MEASURES
from deformnb.session.session import Session
from deformnb.volume.plane import Picture, Raster
from deformnb.volume.volume import Volume
from deformnb.warping.warper import warp_picture
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.studio.controls import WHOLE_DESCRIPTION, Guard, Panel, ProgressBar, button, error_action, slider
from deformnb.widgets.studio.panels.target import GIVEN, NO_TARGET, FitTarget
from deformnb.widgets.worker import Worker

# Pixels of each preview along the longer side.
PREVIEW = 260


def grey_pair(
    moving: Picture, fixed: Picture, map_now: AbstractField
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The deformed moving picture and the fixed one as grey values of one size, with square pixels."""
    a0, a1, b0, b1 = moving.raster.box
    d = max(a1 - a0, b1 - b0) / PREVIEW
    shape = (max(1, round((b1 - b0) / d)), max(1, round((a1 - a0) / d)))
    shown = Raster(shape, (d, d), (a0 + d / 2, b0 + d / 2))
    now = warp_picture(moving.grey(), moving.raster, map_now, output=shown, fill=0.0)
    return now.astype(np.float64), GreyImage.of(fixed).at(shown.points())


def ghost(moving: Picture, fixed: Picture) -> NDArray[np.uint8]:
    """The fixed picture on the pixels of the moving one, (nv, nu, 3), which fills the box of an editor."""
    grey = (GreyImage.of(fixed).at(moving.raster.points()) * 255 + 0.5).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def blend_pictures(now: NDArray[np.float64], fixed: NDArray[np.float64], share: float) -> NDArray[np.uint8]:
    """Both as one picture, (v, 2 u + gap, 3): faded from one to the other, and green (now) over magenta (target).

    Where the two agree the second is grey; green and magenta differ for the colour-blind too.
    """
    left = np.repeat(((1 - share) * now + share * fixed)[..., None], 3, axis=2)
    right = np.stack([fixed, now, fixed], axis=2)
    gap = np.full((len(now), 6, 3), 0.5)
    return (np.clip(np.concatenate([left, gap, right], axis=1), 0, 1) * 255 + 0.5).astype(np.uint8)


_MEASURES = {
    "ncc": "Correlation (brightness is ignored)",
    "ssd": "Squared difference (one grey scale)",
    "mi": "Mutual information (any grey scale)",
}
_HINT = "Choose the target of the volume. Lock points where the picture has no features."
_ALL = "Fit all points"
_WITHOUT_JAX = "This needs JAX, which is not installed: pip install jax"
_SNAP_TIP = "Each selected point moves to the place in the target that matches its surroundings"
_ALONG_TIP = "New points on the outline of the subject, which move to the target's outline"
_SLIDE_TIP = (
    "The selected points, or all that were put on the outline, slide along the target's outline to where the "
    "map bends least"
)
# Points that "Points along the outline" made are known by their names.
_OUTLINE = "outline "


@dataclass(frozen=True)
class Begun:
    """State of the session with which a fit began."""

    deformation: Deformation
    index: int
    key: int
    points: ControlPoints
    selected: tuple[int, ...]
    map_now: AbstractField
    options: dict[str, Any]
    settings: dict[str, Any]

    def is_overtaken(self, session: Session) -> bool:
        """Check whether there was an edit, or another step was chosen, since."""
        return (session.editing.deformation, session.editing.index, session.editing.key) != (
            self.deformation,
            self.index,
            self.key,
        )


Work = Callable[[Begun], tuple[ControlPoints, str]]


class FitPreview:
    """Pictures of the deformed volume and of the target, next to each other and overlaid.

    Parameters
    ----------
    target : gives the pictures; editors : ``editors.current`` shows the target over its own.
    request : called when a slider has been moved.

    Attributes
    ----------
    box : the sliders and the picture; over, blend : the sliders; image : the picture.
    """

    def __init__(self, target: FitTarget, editors: Any, request: Callable[[Any], None]) -> None:
        self._target, self._editors = target, editors
        self._laid_over: tuple[Any, ...] = ()
        wide = basic.layout(flex="1 1 240px", max_width="420px")
        self.over = slider(
            "Overlay", 0.0, 1.0, 0.02, "Opacity of the target over the edited picture; 0 hides it", layout=wide
        )
        self.blend = slider(
            "Blend", 0.0, 1.0, 0.02, "Left: 0 the volume as it is deformed now, 1 the target", layout=wide
        )
        for one in (self.over, self.blend):
            one.observe(request, "value")
        self.image = ipw.Image(format="png", layout=basic.layout(max_width="100%", align_self="flex-start"))
        legend = basic.HTML(
            _words("Left: now, blended with the target. Right: now in green, target in magenta; grey where they agree.")
        )
        self.box = column(row(self.over, self.blend), self.image, legend)

    def show(self) -> None:
        """Make both pictures: takes time."""
        moving, fixed = self._target.pair()
        editor = self._editors.current
        if self.over.value > 0 and self._laid_over != (editor, moving, fixed):  # sent where it is seen, and once
            editor.ghost = as_png(ghost(moving, fixed))  # type: ignore[arg-type]
            self._laid_over = (editor, moving, fixed)
        editor.ghost_opacity = self.over.value
        now, goal = grey_pair(moving, fixed, editor.fit())  # type: ignore[arg-type]
        self.image.value = as_png(blend_pictures(now, goal, self.blend.value))


class FitPanel(Panel):
    """Targets found by the pictures.

    Parameters
    ----------
    editors : ``editors.current`` is the editor of the step being edited; its selection is what "Snap" moves.
    folder : of targets.
    target : a volume that can be chosen first.

    Attributes
    ----------
    target : the selection; buttons : by their words; message : the line of text.
    progress : of the buttons' actions; preview : of the pictures.
    """

    title = "Match to another picture"

    def __init__(
        self, session: Session, guard: Guard, editors: Any, folder: str | PathLike[str], target: Volume | None = None
    ) -> None:
        super().__init__(session, guard)
        self._editors = editors
        self.target = FitTarget(session, folder, target)
        self.thread = Worker("deformnb-fit")
        self.choice = basic.Dropdown(
            options=self.target.choices(),
            description="Target",
            style=WHOLE_DESCRIPTION,
            layout=basic.layout(flex="1 1 260px", max_width="420px"),
            tooltip="Target: another volume, or a saved session",
        )
        if target is not None:
            self.target.choose(GIVEN)
            self.choice.value = GIVEN
        self.choice.observe(self._handle_choice, "value")
        self.measure = basic.Dropdown(
            options=[(_MEASURES.get(name, name), name) for name in MEASURES],
            style=WHOLE_DESCRIPTION,
            description="Measure",
            layout=basic.layout(flex="1 1 260px", max_width="420px"),
            tooltip="Similarity measure",
        )
        self.stiffness = basic.FloatLogSlider(
            min=-4,
            max=1,
            step=0.1,
            value=0.005,
            description="Stiffness",
            style=WHOLE_DESCRIPTION,
            readout_format=".1g",
            layout=basic.layout(flex="1 1 240px", max_width="420px"),
            tooltip="Weight of bending relative to similarity, when all points are fitted",
        )
        self.count = basic.BoundedIntText(
            min=3,
            max=200,
            value=16,
            style=WHOLE_DESCRIPTION,
            description="Points",
            layout=basic.layout(width="120px"),
            tooltip="How many are put on the outline",
        )
        self.buttons = {
            text: button(text, tip, partial(guard, partial(self._start, text, work)))
            for text, (tip, work) in self._works().items()
        }
        self.progress = ProgressBar("Stop", "Stop; nothing is changed", "140px")
        self.message = basic.HTML(_words(_HINT if target is None else self.target.note))
        self.preview = FitPreview(self.target, editors, self._request_preview)
        snap, fit, along, along_it = self.buttons.values()
        self.box = column(
            row(self.choice, self.measure, self.stiffness),
            row(snap, fit, self.count, along, along_it, self.progress.stop, self.progress.bar),
            self.message,
            self.preview.box,
            grid_gap="4px",
        )
        self.refresh()

    def _works(self) -> dict[str, tuple[str, Work]]:
        return {
            "Snap selected points": (_SNAP_TIP, self._snap),
            _ALL: ("Move all points that are not locked so that the pictures match", self._fit),
            "Points along the outline": (_ALONG_TIP, self._fit_outlines),
            "Slide along the outline": (_SLIDE_TIP, self._slide),
        }

    def arrange(self) -> None:
        choices = self.target.choices()
        if list(self.choice.options) != choices:
            kept = self.choice.value
            self.choice.options = choices
            self.choice.value = kept if kept in [key for _, key in choices] else NO_TARGET
        self._allow()
        self._request_preview()

    def _allow(self) -> None:
        basic.set_visible(
            self.preview.box, self.target.volume is not None and self.session.editing.step.plane is not None
        )
        idle = not self.progress.is_busy and self.target.volume is not None
        for text, made in self.buttons.items():
            made.disabled = not idle or ("outline" in text and self.session.editing.step.plane is None)
        if not HAS_JAX:  # the others compute nothing that needs it
            self.buttons[_ALL].disabled, self.buttons[_ALL].tooltip = True, _WITHOUT_JAX
        self.choice.disabled = self.progress.is_busy

    # -- the target ----------------------------------------------------------------------------------------------------

    def _handle_choice(self, change: Any) -> None:
        key = change["new"]
        if key != self.target.key and self._refreshing.depth == 0:
            self._busy(f"Reading {key} ..." if key != NO_TARGET else "")
            self.thread.call(lambda: self._finish(lambda: self._choose(key)))

    def _choose(self, key: str) -> str:
        try:
            self.target.choose(key, self._advance)
        finally:
            self.choice.value = self.target.key  # what could not be read is not chosen
            if self.target.volume is None and self.session.editing.step.plane is not None:
                self._editors.current.ghost_opacity = 0.0
        return self.target.note if key != NO_TARGET else _HINT

    def take(self, volume: Volume) -> None:
        """Make a volume the target that is chosen."""
        if self.progress.is_busy:
            raise DeformError("a fit is under way; stop it first.")
        self.target.offer(volume.to_unit(self.session.editing.grid.unit))
        self.target.choose(GIVEN)
        self.message.value = _words(self.target.note or _HINT)
        self.refresh()
        self.choice.value = GIVEN

    # -- work ----------------------------------------------------------------------------------------------------------

    def _busy(self, words: str) -> None:
        self.progress.begin()
        self.message.value = _words(words)
        self._allow()

    def _start(self, what: str, work: Work) -> None:
        if self.progress.is_busy:
            raise DeformError("a fit is under way; stop it first.")
        begun = self._begin()
        self._busy(f"{what} ...")
        self.thread.call(lambda: self._finish(lambda: self._apply_result(begun, what, work)))

    def _begin(self) -> Begun:
        session, step = self.session, self.session.editing.step
        if self.target.volume is None:
            raise DeformError("choose a target first: a volume, or the session file of another result.")
        if step.strength != 1:
            raise DeformError("points are fitted as they are dragged: set Strength to 1 first.")
        if step.direction != "backward":
            raise DeformError("points are fitted backward: set the direction of the step to Backward first.")
        editor = self._editors.current
        options = step.settings.arguments(session.editing.points, lone_support(session.editing.grid))
        settings = {"measure": self.measure.value, "energy": self.stiffness.value, "stages": step.stages}
        return Begun(
            session.editing.deformation,
            session.editing.index,
            session.editing.key,
            session.editing.points,
            tuple(editor.selected),
            editor.fit(),
            options,
            settings,
        )

    def _apply_result(self, begun: Begun, what: str, work: Work) -> str:
        points, words = work(begun)
        if begun.is_overtaken(self.session):
            return f"{what} was discarded: something was edited meanwhile, and that stays. Press the button again."
        if points != begun.points and not self.guard(lambda: self.session.editing.edit_points(points, what.lower())):
            return "The result could not be taken; nothing was changed."
        return words

    def _finish(self, action: Callable[[], str]) -> None:
        """Do it in the thread and report the result."""
        message = ""
        try:
            message = action()
        except Cancelled:
            message = "Stopped; nothing was changed."
        except Exception as error:
            reason = error
            self.guard(error_action(reason))
        finally:
            self.message.value = _words(message)  # before the next fit can show its own
            self.progress.end()
            self._allow()
            self._request_preview()

    def _advance(self, share: float) -> None:
        if self.progress.is_stopped():
            raise Cancelled("stopped in the studio.")
        self.progress.show(share)

    # -- the four buttons ----------------------------------------------------------------------------------------------

    def _snap(self, begun: Begun) -> tuple[ControlPoints, str]:
        if not begun.selected:
            raise DeformError("no point is selected; click on those that should snap, with Shift for several.")
        moving, fixed = self.target.pair()
        found = snap_to_match(
            begun.points, begun.selected, moving, fixed, map_now=begun.map_now, progress=self._advance
        )
        words = [f"{len(found.ids) - len(found.left)} of {len(found.ids)} points snapped."]
        for why in dict.fromkeys(found.left.values()):
            names = [_named(begun.points, point) for point, reason in found.left.items() if reason == why]
            words.append(f"Left because {why}: {', '.join(names[:8])}{' ...' if len(names) > 8 else ''}.")
        return found.points, " ".join(words)

    def _fit(self, begun: Begun) -> tuple[ControlPoints, str]:
        step = begun.deformation.steps[begun.index]
        if any(part.enabled for part in step.parts) or any(cut.enabled for cut in step.cuts):
            raise DeformError(
                "cuts and rigid parts are not known to the fit of all points; switch them off, or snap "
                "single points, which works with them."
            )
        moving, fixed = self.target.pair()
        start = time.perf_counter()
        found = fit_targets(begun.points, moving, fixed, progress=self._advance, **begun.options, **begun.settings)
        return found.points, _report(found, begun.points, time.perf_counter() - start)

    def _fit_outlines(self, begun: Begun) -> tuple[ControlPoints, str]:
        source, goal = (self._outline(picture) for picture in self.target.pair())
        found = fit_outline(begun.points, source, goal, count=self.count.value, progress=self._advance)
        return found.points, f"{len(found.ids)} points put on the outline. {_bending_text(found.energy)}"

    def _slide(self, begun: Begun) -> tuple[ControlPoints, str]:
        points = begun.points
        ids = begun.selected or tuple(
            i for i, name in zip(points.ids, points.names, strict=True) if name.startswith(_OUTLINE)
        )
        if not ids:
            raise DeformError(
                "no point is on the outline yet: press \u201cPoints along the outline\u201d, or select "
                "points that are on it."
            )
        found = slide(points, [self._outline(self.target.pair()[1])], ids=ids, progress=self._advance)
        return found.points, f"{len(found.ids)} points slid. {_bending_text(found.energy)}"

    def _outline(self, picture: Any) -> Any:
        found = outline(picture) if isinstance(picture, Picture) else []
        if not found:
            raise DeformError("there is no outline here; it needs a picture with something bright on dark ground.")
        return found[0]

    # -- the preview ---------------------------------------------------------------------------------------------------

    def _request_preview(self, _change: Any = None) -> None:
        if self.target.volume is not None and not self.progress.is_busy and not self.thread.is_closed:
            self.thread.latest("preview", self._show_preview)

    def _show_preview(self) -> None:
        """Both pictures; an error in making them is shown at the buttons."""
        if self.session.editing.step.plane is None:
            return
        try:
            self.preview.show()
        except DeformError as error:
            self.message.value = _words(str(error))

    def close(self) -> None:
        """Stop the fit."""
        self.progress.cancel()
        self.thread.close()


def _named(points: ControlPoints, point: int) -> str:
    name = points.names[points.index(point)]
    return f"{point} ({name})" if name else str(point)


def _report(found: Fitted, before: ControlPoints, seconds: float) -> str:
    way = np.linalg.norm(found.points.target - before.target, axis=1)
    if not way.any():
        return f"Nothing better was found; similarity {found.score_before:.3f}. {seconds:.1f} s."
    return (
        f"Similarity {found.score_before:.3f} before, {found.score_after:.3f} after. "
        f"{np.count_nonzero(way)} points moved, by {way.max():.3g} at most; min det J {found.least:.2f}. "
        f"{seconds:.1f} s."
    )


def _bending_text(energy: tuple[float, ...]) -> str:
    return f"Bending energy {energy[0]:.3g} by arc length, {energy[-1]:.3g} after {len(energy) - 1} steps."


def _words(text: str) -> str:
    return f'<div role="status" style="line-height: 1.35">{html.escape(text)}</div>' if text else ""
