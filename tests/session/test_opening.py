"""The look in which an opening is seen."""

from __future__ import annotations

import pytest

from deformnb.datasets.phantoms import PHANTOMS
from deformnb.session.examples import apply_example
from deformnb.session.opening import show_opening
from deformnb.session.session import Session
from deformnb.volume.transfer import preset


@pytest.mark.parametrize("name", ["abdomen", "fish", "lobster"])
def test_after_cut_it_open_the_skin_is_opaque(name: str) -> None:
    session = Session(PHANTOMS[name].make((24, 24, 24)))
    apply_example(session, "open")
    assert session.pictures.transfer == "surface"
    assert "opening" in session.editing.notice
    assert session.editing.undo().startswith("example")


def test_other_examples_leave_the_look() -> None:
    session = Session(PHANTOMS["fish"].make((24, 24, 24)))
    apply_example(session, "bend")
    assert session.pictures.transfer == "specimen"


def test_a_look_of_the_user_and_an_opaque_one_stay() -> None:
    volume = PHANTOMS["abdomen"].make((24, 24, 24))
    session = Session(volume)
    own = preset("muscle", volume)
    session.pictures.set_trait("transfer", own)
    assert not show_opening(session)
    assert session.pictures.transfer == own
    session.pictures.set_trait("transfer", "surface")
    assert not show_opening(session)
