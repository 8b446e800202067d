"""Session of one user with one volume: the edited document, its history, the view state, results and files.

A session has no widget and no thread: the notebook's studio and the application are thin front ends of it. It holds a
part for each of these, and does the tasks that need several of them. It may be called from any thread; observers are
called in the thread of the edit.
"""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformnb.document.deformation import Deformation
from deformnb.document.transplant import with_true_spacing
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.imaging.cell_output import image_html, steps_html, title_html
from deformnb.imaging.preview import draw_preview
from deformnb.io.documents import read_document
from deformnb.io.files.paths import address_of, as_path
from deformnb.rbf.points import ControlPoints
from deformnb.registration.outlines import OUTLINE_POINT, fix_outline, outline
from deformnb.session.editing import Editing
from deformnb.session.files import Files
from deformnb.session.inputs import as_deformation, as_volume_and_channels, source_of, subject_from
from deformnb.session.pictures import Pictures
from deformnb.session.results import Results
from deformnb.session.steps import Steps
from deformnb.session.view_state import ViewState
from deformnb.volume.channels import ChannelsLike, as_channels
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import levels
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Grid, VolumeLike, as_grid, empty_note
from deformnb.warping.points import Landmarks, LandmarksLike, as_landmarks

_CELL_SIZE = 360  # pixels of the longer side of the picture in a cell


class Session:
    """A volume, the deformation made of it so far, and the history of edits.

    Parameters
    ----------
    volume : to deform; never changed. Any object that is a volume, channels or a mesh is accepted, as in the studio.
    deformation : to continue, in the view state that was saved; default is one step with a point in each corner of the
        picture that holds it still.
    view : side of the first picture, one of :data:`~deformnb.volume.views.VIEWS`.
    output : grid of the result; default is the document's, and the volume's own if it has none.
    channels : that are deformed together, where the volume is their
        :meth:`~deformnb.volume.channels.Channels.brightness`.
    source : an expression that reads the volume, for scripts; default is that of a volume given as a path.
    view_state : first values of the traits of :class:`~deformnb.session.pictures.Pictures`.

    Attributes
    ----------
    editing : the document, its selected step and points, their edits, undo and redo; notices to the user.
    steps : the list of steps.
    pictures : the picture that is edited, and its view state.
    results : the deformed volume, its field and its box.
    files : where the document is saved, what may be replaced, the script.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((32, 32, 32)), view="+y")
    >>> session.editing.edit_points(session.editing.points.add([10.0, 4.0], [10.0, 6.0]))
    >>> session.editing.change(extrusion="modulate", curve="sin(pi*z)")
    >>> session.editing.history["undo"]
    'change extrusion'
    >>> session.editing.undo(), len(session.editing.points)
    ('change extrusion', 5)
    """

    def __init__(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        view: ViewName | Plane = "+y",
        output: Grid | VolumeLike | None = None,
        channels: ChannelsLike | None = None,
        source: str | None = None,
        **view_state: Any,
    ) -> None:
        source = source_of(volume) if source is None else source
        volume, own = as_volume_and_channels(subject_from(volume))
        channels = own if channels is None else as_channels(channels)
        grid = volume.finest_grid
        output = None if output is None else as_grid(output)
        deformation, stored = ViewState.split(as_deformation(deformation) or Deformation())
        deformation, laid = with_true_spacing(deformation, grid)
        if output is not None:
            deformation = replace(deformation, output=output)
        self.volume, self.channels = volume, channels
        self.editing = Editing(grid, view if isinstance(view, Plane) else Plane.from_view(grid, view), deformation)
        self.steps = Steps(self.editing)
        self.pictures = Pictures(volume, channels, self.editing, **view_state)
        self.results = Results(volume, channels, self.editing)
        self.files = Files(volume, source)
        said = volume.mark_labels(volume.is_labels).notes  # the front end asks about labels
        notes = (*dict.fromkeys([*said, *empty_note(volume.values)]), laid)
        self.editing.notice = " ".join(f"{note[:1].upper()}{note[1:].rstrip('.')}." for note in notes if note)
        made_on = deformation.volume  # whether it was this very one would take its checksum: see Files.difference
        self.pictures.restore(stored, besides=view_state, is_other=made_on is not None and made_on.shape != grid.shape)

    def __repr__(self) -> str:
        steps, (nz, ny, nx) = len(self.editing.deformation.steps), self.volume.shape
        name = f" {self.volume.name[:60]!r}" if self.volume.name else ""
        undo = self.editing.history["undo"]
        last = f", last edit {undo!r}" if undo else ""
        return (
            f"<Session on{name or ' a volume'}, {nx} x {ny} x {nz} voxels (x, y, z): "
            f"{steps} {'step' if steps == 1 else 'steps'}{last}>"
        )

    def _repr_html_(self) -> str:
        step = self.editing.step
        points = ControlPoints.empty(2) if step.plane is None else self.editing.points
        drawn = draw_preview(self.pictures.picture(), [], points, _CELL_SIZE)
        steps = steps_html(self.editing.deformation, self.steps.titles())
        return (
            f"<div>{title_html('Session', self.volume.name)}<br>{image_html(drawn, 'picture with points')}{steps}</div>"
        )

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise TypeError("a session is not copied; its document makes another one: Session(volume, session.document()).")

    # -- points --------------------------------------------------------------------------------------------------------

    def add_landmarks(self, landmarks: LandmarksLike) -> None:
        """Add control points at landmarks, dragged to their fixed places where they have any.

        Parameters
        ----------
        landmarks : places in space (LPS), which on a picture are seen from its side, or on a picture its (a, b). Where
            their unit is known they are converted to that of the volume.

        Raises
        ------
        DeformError
            If they have two coordinates and the step's points three, or the points cannot be fitted.
        """
        landmarks, plane = as_landmarks(landmarks), self.editing.step.plane
        if plane is None and landmarks.points.shape[1] == 2:
            raise DeformError(
                "these landmarks are on a picture, and the points of this step in space: choose another step."
            )
        landmarks = landmarks.to_unit(self.editing.grid.unit)
        source, points = landmarks.points, self.editing.points
        target = source if landmarks.fixed is None else np.where(np.isfinite(landmarks.fixed), landmarks.fixed, source)
        if plane is not None and source.shape[1] == 3:
            source, target = (plane.to_plane(places)[:, :2] for places in (source, target))
        assert landmarks.active is not None
        for start, end, name, active in zip(source, target, landmarks.names, landmarks.active, strict=True):
            new = points.next_id
            points = points.add(start, end, name=name)
            points = points if active else points.edit(new, active=False)
        self.editing.edit_points(points, "add landmarks")

    def landmarks(self) -> Landmarks:
        """The control points being edited as landmarks in space (LPS), with their targets as fixed places.

        Those of a picture are in its plane.
        """
        points, plane = self.editing.points, self.editing.step.plane
        ends = [points.source, points.target]
        source, target = ends if plane is None else [plane.from_plane(end) for end in ends]
        return Landmarks(source, points.names, fixed=target, active=points.active, unit=self.editing.grid.unit)

    def fix_outline(self, count: int = 16) -> None:
        """Add points that stay along the outline of the picture's subject: drags bend only the tissue around them.

        On a slice and a maximum the outline is where the values rise above air, elsewhere where dark and bright part
        best. Points that hold it already and were not moved make room.

        Parameters
        ----------
        count : places along the outline; those close to another point stay free.

        Raises
        ------
        DeformError
            For a step in space, and where nothing is seen on the picture.
        """
        if self.editing.step.plane is None:
            raise DeformError(
                "an outline is on a picture, and this step has its points in space: choose another step, or add one."
            )
        picture, level = self.pictures.automatic_picture(), None  # a window set manually may begin above air
        if self.pictures.method in ("slice", "mip"):
            low, high = picture.window
            level = min(max((levels(self.volume)[1] - low) / (high - low), 0.02), 0.98)
        lines = outline(picture, level)
        if not lines:
            raise DeformError("there is no outline on the picture: all of it has one value.")
        points = fix_outline(self.editing.points, lines[0], count=count)
        self.editing.edit_points(points, "hold the outline")
        held = points.names.count(OUTLINE_POINT)
        self.editing.notice = f"{held} points hold the outline: a drag bends only the tissue around it."

    def set_view(self, view: ViewName | Plane) -> None:
        """View from another side: back at the step made from there, or else on a new one after all others.

        So the volume is deformed on one picture, turned, and deformed on another (section 4.3 of the paper); the new
        picture shows the result of the steps before. A step without edits is turned instead.
        """
        plane = view if isinstance(view, Plane) else Plane.from_view(self.editing.grid, view)
        with self.editing.lock:
            if plane != self.editing.step.plane:
                self.pictures.depth = 0.0
                self.steps.turn(plane)

    def edit_view(self, direction: ArrayLike, up: ArrayLike | None = None) -> None:
        """Edit on the picture that a camera sees, by parallel rays: any view is a side.

        The plane goes through the middle of the volume. A camera that stands on one of the sides, or on the view of a
        step, leads there; otherwise as :meth:`set_view`, on a step that is named "view 1", "view 2", and so on.

        Parameters
        ----------
        direction : of view, (x, y, z) in space, any length.
        up : what points up; default is +z, or -y for a view along z.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> session = Session(PHANTOMS["bar"].make((8, 8, 16)))
        >>> session.edit_view((1, 1, -0.4))
        >>> session.steps.titles()
        ['view 1']
        """
        self.set_view(self.steps.plane_from(direction, up))

    def turn_view(self, *, up: float = 0.0, right: float = 0.0, roll: float = 0.0) -> None:
        """Edit on a picture that is turned by degrees about the axes of this one.

        Parameters
        ----------
        up, right, roll : how the viewer moves, as of :meth:`Plane.turned_directions
            <deformnb.volume.plane.Plane.turned_directions>`.
        """
        self.edit_view(*self.editing.plane.turned_directions(up, right, roll))

    def set_back(self) -> None:
        """Edit on the nearest of the six sides again, in place of an oblique view."""
        self.set_view(self.steps.nearest_side(self.editing.plane))

    # -- documents -----------------------------------------------------------------------------------------------------

    def document(self) -> Deformation:
        """The deformation, its view state, and the checksum of its volume, as it is saved."""
        return self.pictures.view_state.add_to(replace(self.editing.deformation, volume=self.files.reference()))

    def code(self, volume: str = "") -> str:
        """The document as a Python script; see :func:`deformnb.document.script.as_python`.

        Parameters
        ----------
        volume : expression that gives the volume; default reads the file that it came from.
        """
        return self.files.code(self.editing.deformation, volume)

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the document of this moment as JSON.

        Parameters
        ----------
        overwrite : replace any file; else only one as it was opened or saved here.

        Raises
        ------
        FileChangedError
            If the file was there before, or another program has changed it; nothing is written.
        """
        self.files.write(self.document(), path, overwrite=overwrite)

    def open(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Open a saved document; can be undone.

        Parameters
        ----------
        allow_other_volume : open it even if it was made on another volume; a notice reports it.

        Raises
        ------
        OtherVolumeError
            If it was made on another volume and that is not allowed; everything stays as it was.
        """
        document, content = read_document(path)
        self.take(document, allow_other_volume=allow_other_volume)
        # Where it was changed to fit, the file has the old one; at an address nothing is saved.
        if self.files.saved is not None and not address_of(path):
            self.files.known.remember(path, content)
            self.files.path = as_path(path)

    def take(
        self, deformation: Deformation, label: str = "open a document", *, allow_other_volume: bool = False
    ) -> None:
        """Continue with another document that is stored elsewhere; can be undone, but for colours and projection.

        See :meth:`open`.
        """
        deformation, stored = ViewState.split(deformation)
        laid = ""
        try:
            deformation, laid = with_true_spacing(deformation, self.editing.grid)
        except OtherVolumeError:
            if not allow_other_volume:
                raise
        difference = self.files.difference(deformation)
        if difference and not allow_other_volume:
            raise OtherVolumeError(f"{difference} Pass allow_other_volume=True to open it regardless.")
        with self.editing.lock:
            self.editing.edit_document(deformation, label, max(0, len(deformation.steps) - 1), key=0)
            self.files.path, self.files.saved = None, None if laid else self.editing.deformation
        self.pictures.restore(stored, is_other=bool(difference))
        if difference or laid:
            self.editing.notice = difference or laid
