"""The server behind a view's frame: a picture to turn, and nothing else that a client could request. No browser."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from running_app import connect
from waiting import PATIENCE

from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.volume_view import VolumeView
from deformnb.widgets.web.frames import TrameFrames


@pytest.fixture
def app() -> Iterator[Any]:
    view = VolumeView(Volume(np.zeros((4, 4, 4), np.uint8), Grid((4, 4, 4))), method="core")
    frames, is_ready, urls = TrameFrames(view), threading.Event(), []

    def tell(url: str) -> None:
        urls.append(url)
        is_ready.set()

    frames.open("http://notebook.example:8888", tell)
    assert is_ready.wait(PATIENCE)
    (served,) = frames.served.values()
    yield SimpleNamespace(name=urls[0].removeprefix("http://").partition("/")[0], server=served.server, view=view)
    frames.close()
    view.close()


def test_what_only_the_application_offers_is_unknown(app: Any) -> None:
    async def ask() -> list[Any]:
        async with connect(app) as page:
            return [
                (await page.call(method, *given))["message"]
                for method, *given in (
                    ("deformnb.open",),
                    ("deformnb.comm", "view", {}, "1", []),
                    ("trame.trigger", "undo", [], {}),
                )
            ]

    assert set(asyncio.run(ask())) == {"Unregistered method called"}


@pytest.mark.parametrize(
    "call",
    [
        ("trame.rca.size", "other", "", {}),
        ("trame.rca.event", "volume", "", {}),
        ("deformnb.seen", "volume", 0, "p"),
        ("deformnb.look", "sideways"),
    ],
)
def test_what_cannot_be_is_dropped(app: Any, call: tuple[Any, ...], caplog: pytest.LogCaptureFixture) -> None:
    async def ask() -> None:
        async with connect(app) as page:
            await page.call(*call)

    with caplog.at_level(logging.WARNING):
        asyncio.run(ask())
    assert "dropped" in caplog.text


def test_the_cube_turns_the_view(app: Any) -> None:
    async def ask() -> None:
        async with connect(app) as page:
            await page.call("deformnb.look", "+x")

    asyncio.run(ask())
    np.testing.assert_allclose(np.abs(app.view.camera["direction"]), [1, 0, 0], atol=1e-12)
