"""The server behind a view's frame: what a desk's offers and it does not is refused, not an error. No browser."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, connected, status_of

from deformnb.app.notebook import TrameFrames
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.volume_view import VolumeView


@pytest.fixture
def app() -> Iterator[Any]:
    view = VolumeView(Volume(np.zeros((4, 4, 4), np.uint8), Grid((4, 4, 4))), method="core")
    frames, is_ready, urls = TrameFrames(view), threading.Event(), []

    def tell(url: str) -> None:
        urls.append(url)
        is_ready.set()

    frames.open("http://notebook.example:8888", tell)
    assert is_ready.wait(PATIENCE)
    (served,) = frames._served.values()
    yield SimpleNamespace(name=urls[0].removeprefix("http://").partition("/")[0], server=served._server)
    frames.close()
    view.close()


def test_there_are_no_files(app: Any) -> None:
    with status_of(app, "/deformnb/file/x") as (status, _, _text):
        assert status == 404


def test_what_only_a_desk_offers_is_refused(app: Any, caplog: pytest.LogCaptureFixture) -> None:
    async def ask() -> None:
        async with connected(app) as page:
            for method, *given in (("deformnb.write", "script", "p"), ("deformnb.take", "{}"),
                                   ("trame.trigger", "undo", [], {})):
                await page.call(method, *given)
            await asyncio.wrap_future(app.server.desk.thread.call(lambda: None))

    with caplog.at_level(logging.WARNING):
        asyncio.run(ask())
    assert [record.levelname for record in caplog.records] == ["WARNING"] * 3, caplog.text
