"""The view state of a volume is saved and restored with a session, and is no edit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from document.test_json_format import as_of_1, written_in_1
from hypothesis import given
from hypothesis import strategies as st

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.errors import DeformError
from deformnb.imaging.projection import PROJECTIONS
from deformnb.rbf.points import ControlPoints
from deformnb.session.exports import Frozen
from deformnb.session.session import Session
from deformnb.session.view_state import MOST_TRANSFER_NODES, ViewState, without_view_state
from deformnb.volume.colour_maps import COLOUR_MAPS, colour_table
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import PRESETS, TransferFunction
from deformnb.volume.volume import Volume

BAR = PHANTOMS["bar"].make((16, 16, 24))
OWN = TransferFunction(((0, 0.1, 0.2, 0.3), (90, 1, 1, 0.5)), ((0, 0), (40, 0.25), (90, 1)), unit=2.5)
_value = st.floats(-1e6, 1e6)
_share = st.floats(0, 1)


@st.composite
def transfers(draw: st.DrawFn) -> TransferFunction:
    def rows(width: int) -> tuple[Any, ...]:
        values = sorted(draw(st.lists(_value, min_size=1, max_size=5)))
        return tuple((v, *(draw(_share) for _ in range(width))) for v in values)

    return TransferFunction(rows(3), rows(1), draw(st.floats(1e-3, 1e3)))


@given(
    transfer=st.none() | st.sampled_from(list(PRESETS)) | transfers(),
    method=st.none() | st.sampled_from(list(PROJECTIONS)),
    depth=st.none() | _value,
    window=st.none() | st.tuples(st.floats(-1e6, 0), st.floats(1e-3, 1e6)),
    colour_map=st.none() | st.sampled_from(COLOUR_MAPS[1:]),
)
def test_what_was_added_is_parted_again(
    transfer: Any, method: str | None, depth: float | None, window: tuple[float, float] | None, colour_map: str | None
) -> None:
    look = ViewState(transfer, method, depth, window, colour_map)
    document = Deformation(name="bent", extra={"later": [1]})
    assert ViewState.split(from_json(to_json(look.add_to(document)))) == (document, look)


POINTS = ControlPoints.from_arrays([[0, 0], [9, 0], [4, 4]], [[0, 0], [9, 0], [6.5, 4]])
SEEN = ViewState(OWN, "slice", 3.5).add_to(
    Deformation((Step((POINTS,), Plane.from_view(BAR.grid, "+y")),), name="bent")
)


def test_a_look_is_kept_to_the_letter() -> None:
    written, today = written_in_1(4)
    assert from_json(written) == as_of_1(SEEN)
    assert to_json(as_of_1(SEEN)) == today


def test_a_session_comes_back_as_it_was_seen(tmp_path: Path) -> None:
    session = Session(BAR, view="+y", transfer=OWN, method="slice")
    session.pictures.depth = 3.5
    session.save(tmp_path / "bar.json")
    for opened in (Session(BAR), Session(BAR, from_json((tmp_path / "bar.json").read_text(encoding="utf-8")))):
        opened.open(tmp_path / "bar.json")
        assert (opened.pictures.transfer, opened.pictures.method, opened.pictures.depth) == (OWN, "slice", 3.5)
        assert opened.editing.deformation.extra == {}
        assert opened.document().extra == session.document().extra
    named = Session(BAR, session.document(), transfer="bone")  # the request has priority
    assert (named.pictures.transfer, named.pictures.method) == ("bone", "slice")


def test_other_colours_are_no_edit_and_nothing_unsaved(tmp_path: Path) -> None:
    session = Session(BAR)
    session.save(tmp_path / "bar.json")
    session.pictures.transfer, session.pictures.method = "bone", "mean"
    assert session.editing.history["undo"] == ""
    assert session.files.saved is not None
    assert session.files.saved.unit == "mm"  # that of its volume
    assert replace(session.files.saved, volume=None, unit="") == session.editing.deformation


def test_a_window_set_by_hand_is_kept_exported_and_no_edit(tmp_path: Path) -> None:
    session = Session(BAR, method="slice")
    automatic = session.pictures.picture().window
    session.pictures.window = [20, 90]
    assert (session.pictures.picture().window, session.editing.history["undo"]) == ((20, 90), "")
    session.save(tmp_path / "bar.json")
    opened = Session(BAR)
    opened.open(tmp_path / "bar.json")
    assert opened.pictures.window == opened.pictures.picture().window == (20, 90)
    opened.pictures.method = "mean"
    assert opened.pictures.picture().window == (20, 90)
    assert Frozen.of(opened).window == (20, 90)
    session.pictures.window = None
    assert session.pictures.picture().window == automatic
    assert ViewState.split(session.document())[1].window is None
    other = Session(PHANTOMS["bar"].make((12, 12, 20)))
    other.take(opened.document(), allow_other_volume=True)
    assert other.pictures.window is None


def test_ambient_occlusion_is_kept_where_it_is_off(tmp_path: Path) -> None:
    session = Session(BAR)
    assert "ambient_occlusion" not in session.pictures.view_state.add_to(Deformation()).extra["look"]
    session.pictures.ambient_occlusion = False
    session.save(tmp_path / "flat.json")
    opened = Session(BAR)
    opened.open(tmp_path / "flat.json")
    assert not opened.pictures.ambient_occlusion


def test_a_colour_map_is_kept_and_colours_every_picture(tmp_path: Path) -> None:
    session = Session(BAR, method="slice", colour_map="magma")
    session.save(tmp_path / "bar.json")
    opened = Session(BAR)
    opened.open(tmp_path / "bar.json")
    assert opened.pictures.colour_map == opened.pictures.picture().colour_map == Frozen.of(opened).colour_map == "magma"
    drawn = opened.pictures.picture()
    np.testing.assert_array_equal(drawn.rgb8(), colour_table("magma")[(drawn.grey() * 255 + 0.5).astype(np.uint8)])
    with pytest.raises(DeformError, match="colour map"):
        opened.pictures.colour_map = "jet"
    assert opened.pictures.colour_map == "magma"
    newer = Deformation(extra={"look": {"colour_map": "of a later version"}})
    assert ViewState.split(newer)[1].colour_map is None


@pytest.mark.parametrize("window", [[3, 3], [1], "wide", [0, float("inf")], 5])
def test_a_window_that_is_none_is_refused(window: Any) -> None:
    session = Session(BAR, window=(1, 2))
    with pytest.raises(DeformError, match="window"):
        session.pictures.window = window
    assert session.pictures.window == (1, 2)
    with pytest.raises(DeformError, match="look"):
        ViewState.split(Deformation(extra={"look": {"window": window}}))


def test_undo_takes_an_opened_document_back_but_not_its_colours() -> None:
    session = Session(BAR)
    session.take(ViewState("bone").add_to(Deformation(name="other")))
    assert (session.pictures.transfer, session.editing.deformation.name) == ("bone", "other")
    session.editing.undo()
    assert (session.pictures.transfer, session.editing.deformation.name) == ("bone", "")


def test_colours_at_values_of_another_volume_are_not_taken() -> None:
    document = Session(PHANTOMS["bar"].make((12, 12, 20)), transfer=OWN, method="slice").document()
    opened = Session(BAR)
    opened.take(document, allow_other_volume=True)
    assert (opened.pictures.transfer, opened.pictures.method) == ("specimen", "slice")
    assert Session(BAR, document).pictures.transfer == "specimen"
    named = replace(document, extra={"look": {"transfer": "xray"}})
    assert Session(BAR, named).pictures.transfer == "xray"


def test_a_slice_lies_within_the_volume_and_belongs_to_the_last_step() -> None:
    session = Session(BAR)
    session.take(ViewState(method="slice", depth=1e300).add_to(Deformation()))
    assert session.pictures.depth == session.pictures.depth_range[1]
    assert session.pictures.view_state.depth == session.pictures.depth
    session.steps.add()
    session.editing.edit_step(0)
    session.pictures.method = "slice"
    assert session.pictures.view_state.depth is None


def test_what_a_later_version_may_know_is_passed_over() -> None:
    document = Deformation(extra={"look": {"transfer": "velvet", "method": "hologram", "haze": 3}})
    assert ViewState.split(document)[1] == ViewState()


@pytest.mark.parametrize(
    ("look", "place"),
    [
        ([], "document.look must be an object"),
        ({"transfer": 3}, "document.look.transfer"),
        ({"method": 3}, "document.look.method"),
        ({"depth": "deep"}, "document.look.depth"),
        ({"transfer": {}}, "document.look.transfer"),
        ({"transfer": {"colors": [[0, 0, 0]], "opacities": [[0, 0]], "unit": 1}}, "colors must have 4 numbers"),
        ({"transfer": {"colors": [[0, 0, 0, 0]], "opacities": [[0, 0]], "unit": 0}}, "document.look.transfer: .*unit"),
        ({"transfer": {"colors": [[5, 0, 0, 0], [1, 0, 0, 0]], "opacities": [[0, 0]], "unit": 1}}, "must rise"),
        (
            {"transfer": {"colors": [[0, 0, 0, 0]] * (MOST_TRANSFER_NODES + 1), "opacities": [[0, 0]], "unit": 1}},
            "nodes",
        ),
    ],
)
def test_a_malformed_look_is_refused_at_its_place_and_nothing_changes(look: Any, place: str) -> None:
    session = Session(BAR)
    document = from_json(json.dumps({**json.loads(to_json(Deformation(name="x"))), "look": look}))
    before = session.editing.deformation
    with pytest.raises(DeformError, match=place):
        session.take(document)
    assert session.editing.deformation is before
    assert without_view_state(document) == replace(document, extra={})


def test_a_volume_of_a_named_preset_is_fitted_anew(tmp_path: Path) -> None:
    Session(BAR, transfer="bone").save(tmp_path / "bar.json")
    brighter = Volume(BAR.values * 2.0, BAR.grid)
    opened = Session(brighter)
    opened.open(tmp_path / "bar.json", allow_other_volume=True)
    assert opened.pictures.transfer == "bone"
    assert opened.pictures.transfer_function == PRESETS["bone"](brighter)
