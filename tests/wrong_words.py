"""Calls with one wrong word each, which mypy must find: an "ignore" that is not needed is itself an error to it.

Nothing here is run; see test_choices.py.
"""

from __future__ import annotations

import deformnb as dn
from deformnb.datasets.darcy import thompson_map
from deformnb.datasets.registry import load
from deformnb.document.transplant import transplant
from deformnb.imaging.figures import Panel
from deformnb.rbf.rigid import without_conflicts
from deformnb.registration.optimise import fit_targets
from deformnb.session.examples import apply_example
from deformnb.widgets.view.volume_view import VolumeView


def right_words(v: dn.Volume, p: dn.ControlPoints, d: dn.Deformation) -> None:
    """No error, with a kernel that a user has registered too."""
    dn.project(v, "-y", "mip", transfer="bone")
    dn.fit_points(p, kernel="gaussian", trend="rigid", direction="forward")
    dn.fit_points(p, kernel="my_own")
    dn.warp(v, d, method="cubic")
    dn.Step(maps=(p,), trend="affine", support="box_diagonal", extrusion="modulate")


def wrong_words(v: dn.Volume, p: dn.ControlPoints, d: dn.Deformation, s: dn.Session, q: dn.Picture) -> None:
    """One error a line."""
    dn.project(v, "-q", "mip")  # type: ignore[arg-type]  # ViewName
    dn.project(v, "-y", "mipp")  # type: ignore[arg-type]  # ProjectionName
    dn.project(v, "-y", transfer="bones")  # type: ignore[arg-type]  # PresetName
    dn.imaging.project_channels(v, "-y", "shaded")  # type: ignore[arg-type]  # ChannelProjectionName
    dn.fit_points(p, trend="afine")  # type: ignore[arg-type]  # TrendName
    dn.fit_points(p, direction="back")  # type: ignore[arg-type]  # FitDirection
    dn.Step(maps=(p,), support="box")  # type: ignore[arg-type]  # SupportRuleName
    dn.Step(maps=(p,), extrusion="repeat")  # type: ignore[arg-type]  # ExtrusionName
    dn.Step(maps=(p,), cut_rule="target")  # type: ignore[arg-type]  # CutRuleName
    dn.RigidPart(dn.Line(((0, 0), (1, 1))), weight="far")  # type: ignore[arg-type]  # RigidWeightName
    without_conflicts(p, (), held="drop")  # type: ignore[arg-type]  # HeldPointRule
    dn.Deformation(mode="add")  # type: ignore[arg-type]  # ModeName
    dn.Deformation(easing="slow")  # type: ignore[arg-type]  # EasingName
    dn.Deformation(loop="twice")  # type: ignore[arg-type]  # LoopName
    transplant(d, v.grid, "corner")  # type: ignore[arg-type]  # AlignmentName
    dn.Warper(v, method="quintic")  # type: ignore[arg-type]  # SamplingName
    dn.chunked.warp(v, d, "a.zarr", version="0.3")  # type: ignore[arg-type]  # OmeZarrVersion
    dn.read_volume("scan", uneven_slices="skip")  # type: ignore[arg-type]  # UnevenSlices
    dn.volume.Channels((v,), kind="rgbx")  # type: ignore[arg-type]  # ChannelKind
    dn.Picture(q.values, q.plane, q.raster, "mip", q.window, colour_map="jet")  # type: ignore[arg-type]  # ColourMapName
    fit_targets(p, q, q, measure="mse")  # type: ignore[arg-type]  # MeasureName
    dn.draw_pictures(q, style="light")  # type: ignore[arg-type]  # StyleName
    dn.draw_grids(d, q, overlay="volume")  # type: ignore[arg-type]  # GridOverlay
    Panel(q, at="start")  # type: ignore[arg-type]  # PointPlace
    dn.render_volume(v, backend="webgl")  # type: ignore[arg-type]  # RendererName
    dn.imaging.deformation_frames(v, d, shows="before")  # type: ignore[arg-type]  # FrameContent
    thompson_map(scale="none")  # type: ignore[arg-type]  # ScaleName
    thompson_map(cells="round")  # type: ignore[arg-type]  # CellRule
    thompson_map(head="up")  # type: ignore[arg-type]  # HeadSide
    load("trout")  # type: ignore[arg-type]  # DatasetName
    apply_example(s, "twist")  # type: ignore[arg-type]  # ExampleName
    dn.Studio(v, view="webgl")  # type: ignore[arg-type]  # ViewKind
    VolumeView(v, method="gpu")  # type: ignore[arg-type]  # ViewMethodName
    VolumeView(v, transport="http")  # type: ignore[arg-type]  # TransportName
