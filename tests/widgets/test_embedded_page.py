"""The page of a studio in its place in a saved notebook: what the frame is, and when a studio is saved as one."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.widgets import embedded_page
from deformnb.widgets.embedded_page import EMBED_VARIABLE, EMBEDDED_LIMIT, EmbeddedPage
from deformnb.widgets.studio.studio import Studio

MOST_BYTES = 1_200_000


@pytest.fixture
def studio() -> Iterator[Studio]:
    made = Studio(PHANTOMS["fish"].make((16, 32, 16)), side="-x")
    yield made
    made.close()


def test_the_frame_contains_the_page_and_may_do_nothing_but_run_it(studio: Studio) -> None:
    page = studio.embed(title='A "carp" <one>')
    markup = page.markup()
    found = re.fullmatch(r'<iframe ([^>]*) srcdoc="([^"]*)"></iframe>', markup)
    assert found is not None
    assert html.unescape(found[2]) == page.page
    assert 'sandbox="allow-scripts allow-downloads" loading="lazy"' in found[1]
    assert 'title="A &quot;carp&quot; &lt;one&gt;"' in found[1]
    bundle = page._repr_mimebundle_()
    assert bundle["text/html"] == page.output()
    assert base64.b64decode(bundle["image/png"]).startswith(b"\x89PNG")
    assert 'id="dnb-data"' in page.page


def test_a_page_beside_is_written_and_named(studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = studio.embed("carp.html", height=400)
    assert (tmp_path / "carp.html").read_text("utf-8") == page.page
    assert page.markup().endswith('style="width: 100%; height: 400px; border: 0" src="carp.html"></iframe>')
    (tmp_path / "other.html").write_text("of somebody else", encoding="utf-8")
    with pytest.raises(DeformError):
        studio.embed("other.html")
    studio.embed("other.html", overwrite=True)
    assert "deformnb" in (tmp_path / "other.html").read_text("utf-8")


def test_a_page_takes_about_a_megabyte(studio: Studio) -> None:
    small = len(studio.embed().page)
    assert small < MOST_BYTES
    studio.open_volume(PHANTOMS["fish"].make((128, 256, 128)))
    assert studio.volume.grid.size > EMBEDDED_LIMIT
    assert len(studio.embed().page) < MOST_BYTES + EMBEDDED_LIMIT / 2
    assert len(studio.embed(limit=10_000).page) < MOST_BYTES


@pytest.mark.parametrize(
    ("variable", "is_run", "embedded"),
    [("1", True, True), ("1", False, False), ("0", True, False), (None, True, False)],
)
def test_a_studio_is_saved_as_its_page_where_that_was_requested_and_nobody_is_at_the_notebook(
    studio: Studio, monkeypatch: pytest.MonkeyPatch, variable: str | None, is_run: bool, embedded: bool
) -> None:
    monkeypatch.delenv(EMBED_VARIABLE, raising=False)
    if variable is not None:
        monkeypatch.setenv(EMBED_VARIABLE, variable)
    monkeypatch.setattr(embedded_page, "runs_for_later_readers", lambda: is_run)
    bundle = studio._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert ("<iframe" in data.get("text/html", "")) is embedded
    assert ("application/vnd.jupyter.widget-view+json" in data) is not embedded
    assert "image/png" in data


def test_a_frame_says_what_it_is() -> None:
    assert repr(EmbeddedPage("<p>é</p>", "A leaf")) == "EmbeddedPage('A leaf', 9 bytes)"
