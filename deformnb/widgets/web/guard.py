"""Access control of the application's server: origins, hosts, passwords, and allowed remote procedures.

Without it, trame's server answers every page of the browser and every user of the machine: its password is public, it
checks neither the origin of a request nor the host name in it, and a message may have 4 GB. So each start makes a
separate password, requests that carry another name or origin get 403, and of the remote procedures only those in a
table remain, each with a check of its arguments. A wrong message is logged, without its content, and dropped.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import Any

import msgpack
from aiohttp import web
from aiohttp.http import HttpProcessingError
from wslink.websocket import LinkProtocol

from deformnb.errors import DeformError
from deformnb.widgets.web.addresses import headers_for, is_password

LONGEST_REQUEST = 2**19
"""Bytes of a message to a widget at most: an edit with 2000 points."""

LONGEST_OTHER = 65536
"""Bytes of any other message by the page."""

LONGEST_UNAUTHENTICATED = 512
"""Bytes of a message by a client that has not sent the password: only the password fits."""

MOST_OPEN_PAGES = 16
"""Connections at a time."""

LOGIN_SECONDS = 10.0
"""After which a connection without the password is closed."""

REQUEST_SECONDS = 15.0
"""That a connection may take to send a request, and may stay without one."""

FAREWELL_SECONDS = 0.5
"""That a page has to answer the end of its connection, and other requests to be finished."""

_HEADER = 12  # bytes that wslink puts before a message
_PER_SECOND = 240.0  # messages of one page that are read; a drag makes 60, a camera 60 more
_AT_ONCE = 480.0

_LOG = logging.getLogger(__name__)

Answer = Callable[..., Any]
"""A procedure that the page may call; the arguments are the page's, so it must check them."""


def access_check(names: Callable[[], frozenset[str]], handlers: Sequence[Any], framed_by: str = "'none'") -> Any:
    """A middleware that answers 403 to foreign names and origins, and 400 where a socket is no WebSocket.

    Parameters
    ----------
    names : the server's own, see :func:`own_names`; looked up at each request, for the port is chosen late.
    handlers : wslink's handlers of sockets. They hold every request as a connection until it is closed, so
        that a plain request, as of an ``<img>`` in any page, would stay for ever.
    framed_by : the one origin whose pages may show ours in a frame.
    """
    count = 0

    def refused(status: int, reason: str) -> web.Response:
        nonlocal count
        count += 1
        if _is_logged(count):
            _LOG.warning("a request was refused (%d, the %d. so far): %s", status, count, reason)
        return web.Response(status=status, text=f"refused: {reason}\n")

    @web.middleware
    async def check(request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]) -> Any:
        name, origins = request.headers.get("Host", ""), request.headers.getall("Origin", [])
        is_socket = any(request.match_info.handler == one.handleWsRequest for one in handlers)
        if name not in names() or len(request.headers.getall("Host")) != 1:
            return refused(403, "another name")
        # A browser sends the origin of its page with every socket; one without an origin is no page of ours.
        if (origins or is_socket) and origins != [f"http://{name}"]:
            return refused(403, "another origin")
        if request.method not in (("GET",) if is_socket else ("GET", "HEAD")):
            return refused(405, "another method")
        if is_socket and not web.WebSocketResponse().can_prepare(request):
            return refused(400, "no WebSocket")
        if is_socket and sum(len(one.connections) for one in handlers) >= MOST_OPEN_PAGES:
            return refused(503, "too many pages")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(headers_for(name, framed_by))
        return response

    return check


class SlowRequests:
    """Finds connections that send no whole request: a few hundred half-sent ones would use up the files of a process.

    A connection is busy until the answer to its request has been sent, a WebSocket until it ends.
    """

    def __init__(self) -> None:
        self._busy: dict[Any, asyncio.Task[Any]] = {}
        self._since: dict[Any, float] = {}

    def middleware(self) -> Any:
        """Middleware that reports when each request is whole and when it is answered; it has to be the first.

        aiohttp gives each request a task, which ends with the last byte of the answer: much later than the handler
        where a file is sent to a slow reader.
        """

        @web.middleware
        async def answered(
            request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
        ) -> web.StreamResponse:
            task = asyncio.current_task()
            assert task is not None
            self._busy[request.protocol] = task
            task.add_done_callback(lambda _: self._answer(request.protocol))
            return await handler(request)

        return answered

    def _answer(self, connection: Any) -> None:
        self._busy.pop(connection, None)
        self._since[connection] = time.monotonic()

    def disconnect_idle(self, connections: Iterable[Any]) -> None:
        """Cut off those of all connections that have been without a whole request for :data:`REQUEST_SECONDS`."""
        now = time.monotonic()
        self._since = {connection: self._since.get(connection, now) for connection in connections}
        for connection, since in self._since.items():
            transport = connection.transport
            if now - since > REQUEST_SECONDS and connection not in self._busy and transport is not None:
                transport.abort()

    async def stop_answers(self) -> None:
        """Stop the answers in progress; to be done before its connections are cut off.

        Python sends a file by the system and has no report there that its connection was cut off: the task of a reader
        who does not read would wait on, and aiohttp a minute for that.
        """
        tasks = list(self._busy.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=FAREWELL_SECONDS)


class RefusedByServer(logging.Filter):
    """Log of requests that aiohttp cannot read, as lines like those of :func:`access_check`.

    Any page can send such requests, and aiohttp logs each of them with a traceback and its content. An exception
    in what answers a request is a defect of ours and stays as it is.
    """

    LOGGERS = ("aiohttp.server", "aiohttp.websocket")

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Called by logging for each record."""
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and not isinstance(error, HttpProcessingError | web.RequestPayloadError):
            return True
        self._count += 1
        reason = "no WebSocket" if error is None else type(error).__name__
        record.msg, record.args = "a request was refused (the %d. so far): %s", (self._count, reason)
        record.levelno, record.levelname = logging.WARNING, "WARNING"
        record.exc_info = record.exc_text = None
        return _is_logged(self._count)


def _is_logged(count: int) -> bool:
    """Check whether the warning of this number is logged: 1st, 2nd, 4th, 8th ..., lest a flood become one of lines."""
    return count & (count - 1) == 0


async def part_from(sockets: Iterable[Any]) -> None:
    """Close WebSockets, all concurrently; one whose page does not answer within :data:`FAREWELL_SECONDS` is cut off."""
    closing = {asyncio.ensure_future(socket.close()) for socket in sockets if socket.prepared}
    if closing:
        _, slow = await asyncio.wait(closing, timeout=FAREWELL_SECONDS)
        for task in slow:
            task.cancel()
        await asyncio.gather(*closing, return_exceptions=True)


class PasswordCheck(LinkProtocol):  # type: ignore[misc]  # wslink has no types
    """Authentication of clients by the password of this start; also records when each connected.

    Parameters
    ----------
    token : the password.
    earlier : digests of passwords of earlier starts, whose pages are still open.
    """

    def __init__(self, token: str, earlier: Sequence[str] = ()) -> None:
        super().__init__()
        self._token, self._earlier = token, tuple(earlier)
        self._since: dict[str, float] = {}

    async def validateToken(self, token: Any, client_id: str) -> bool:  # noqa: N802  (wslink's name)
        """Called by wslink with the password that a client sent."""
        return self.accepts(token)

    def accepts(self, token: Any) -> bool:
        """Check a password."""
        return is_password(token, self._token, self._earlier)

    def onConnect(self, request: Any, client_id: str) -> None:  # noqa: N802
        """Called by wslink for a new client."""
        self._since[client_id] = time.monotonic()

    def onClose(self, client_id: str) -> None:  # noqa: N802
        """Called by wslink when a client has disconnected."""
        self._since.pop(client_id, None)

    def unauthenticated_clients(self, known: set[str]) -> list[str]:
        """Clients that have not sent the password within :data:`LOGIN_SECONDS`."""
        limit = time.monotonic() - LOGIN_SECONDS
        return [client for client, since in self._since.items() if client not in known and since < limit]


class MessageGuard:
    """Filters messages to wslink's handler of one socket route by the table.

    Parameters
    ----------
    handler : wslink's handler; its table of procedures is replaced.
    answers : procedures that the page may call, by name.
    long : of these, those that take more than :data:`LONGEST_OTHER`.
    """

    def __init__(self, handler: Any, answers: Mapping[str, Answer], long: frozenset[str] = frozenset()) -> None:
        self._handler, self._long = handler, long
        self._answers = dict(answers)
        self._buckets: dict[str, tuple[float, float]] = {}
        self.refused_count = 0
        handler.functionMap.clear()
        handler.functionMap.update({name: (self, _without_self(self._guard(name))) for name in answers})
        handler.onMessage = self.receive  # looked up at each message
        self._close = handler.onClose
        handler.onClose, handler.disconnectClients = self.leave, self.leave_all

    def _guard(self, name: str) -> Answer:
        answer = self._answers[name]

        async def call(*args: Any, **kwargs: Any) -> Any:
            try:
                if kwargs:
                    raise DeformError("it has named arguments.")
                result = answer(*args)
                return await result if inspect.isawaitable(result) else result
            except (DeformError, TypeError, ValueError, KeyError) as error:
                self._drop("%s: %s", name, _short(error))
                return None

        return call

    def _drop(self, why: str, *details: Any) -> None:
        self.refused_count += 1
        if _is_logged(self.refused_count):
            _LOG.warning(f"a message was dropped (the %d. so far): {why}", self.refused_count, *details)

    async def receive(self, is_binary: bool, message: Any, client_id: str) -> None:
        """Called by wslink with each message of a page."""
        if not self._may_send(client_id):
            self._drop("too many in a short time")
            return
        try:
            is_known = self._handler.isClientAuthenticated(client_id)
            longest = LONGEST_REQUEST if is_known else LONGEST_UNAUTHENTICATED
            call = _decode(message.data if is_binary else None, longest)
            if len(message.data) > LONGEST_OTHER and call["method"] not in self._long:
                raise ValueError("a message that is too long")
        except ValueError as error:
            self._drop("%s", _short(error))
            return
        try:
            with self._handler.network_monitor:
                await self._handler.onCompleteMessage(call, client_id)
        except (ConnectionError, RuntimeError, KeyError) as error:  # the client has left meanwhile
            self._drop("no way to answer: %s", type(error).__name__)

    async def leave(self, client_id: str) -> None:
        """Called by wslink when a connection ends, or was never made: wslink drops it only if this returns."""
        if client_id in self._handler.unchunkers:
            try:
                await self._close(client_id)
            except Exception:
                _LOG.exception("the end of a page's connection could not be reported")

    async def leave_all(self) -> None:
        """Called by wslink when the server ends."""
        await part_from(list(self._handler.connections.values()))
        self._handler.publishManager.unregisterProtocol(self._handler)

    def _may_send(self, client_id: str) -> bool:
        now = time.monotonic()
        if client_id not in self._buckets:
            here = self._handler.connections
            self._buckets = {client: bucket for client, bucket in self._buckets.items() if client in here}
        left, last = self._buckets.get(client_id, (_AT_ONCE, now))
        left = min(_AT_ONCE, left + (now - last) * _PER_SECOND)
        self._buckets[client_id] = (max(0.0, left - 1), now)
        return left >= 1


def _without_self(function: Answer) -> Answer:
    """wslink gives the object before the arguments."""

    def call(_: Any, *args: Any, **kwargs: Any) -> Any:
        return function(*args, **kwargs)

    return call


def _decode(data: Any, longest: int) -> dict[str, Any]:
    """A call of a procedure; ValueError if it is none."""
    if not isinstance(data, bytes):
        raise ValueError("a message that is text")
    if not _HEADER < len(data) <= longest + _HEADER:
        raise ValueError("a message that is too long or empty")
    offset, size = (int.from_bytes(data[k : k + 4], "little") for k in (4, 8))
    if offset or size != len(data) - _HEADER:  # no page of ours sends 4 MB, above which wslink sends pieces
        raise ValueError("a message in pieces")
    try:
        call = msgpack.unpackb(data[_HEADER:])
    except Exception as error:  # msgpack raises many kinds
        raise ValueError(f"no message: {type(error).__name__}") from None
    if not isinstance(call, dict) or not set(call) <= {"wslink", "id", "method", "args", "kwargs"}:
        raise ValueError("another form")
    named = isinstance(call.get("id"), str) and len(call["id"]) <= 200 and isinstance(call.get("method"), str)
    if not (named and isinstance(call.get("args", []), list) and isinstance(call.get("kwargs", {}), dict)):
        raise ValueError("another form")
    return call


def _short(error: Exception) -> str:
    """The first words of an error, without text of the page across several lines."""
    return " ".join(str(error).split())[:160]


class SiteGuard:
    """Access control of one web server of wslink's: passwords, messages and slow requests.

    Parameters
    ----------
    token : the password of this start.
    framed_by : the one origin whose pages may show ours in a frame, as of :func:`access_check`.
    earlier : digests of passwords that are accepted too, as of :class:`PasswordCheck`.

    Attributes
    ----------
    handlers : wslink's handlers of sockets, once the server is bound.
    """

    def __init__(self, token: str, framed_by: str, earlier: Sequence[str] = ()) -> None:
        self.password_check = PasswordCheck(token, earlier)
        self.handlers: list[Any] = []
        self._framed_by, self._slow_requests = framed_by, SlowRequests()
        self._guards: list[MessageGuard] = []
        self._served: Any = None

    def bind(
        self,
        served: Any,
        answers: Callable[[Mapping[str, Any]], Mapping[str, Answer]],
        names: Callable[[], frozenset[str]],
        long: frozenset[str],
    ) -> None:
        """Restrict a server of wslink's that does not listen yet.

        Parameters
        ----------
        answers : procedures that pages may call, by name, made of wslink's own table.
        names : the names of the server, as of :func:`access_check`; long : as of :class:`MessageGuard`.
        """
        self._served = served
        self.handlers = list(served._ws_handlers)  # noqa: SLF001  # wslink has no public name for them
        self._guards = [MessageGuard(handler, answers(handler.functionMap), long) for handler in self.handlers]
        check = access_check(names, self.handlers, self._framed_by)
        served.app.middlewares.extend([self._slow_requests.middleware(), check])

    @property
    def refused_count(self) -> int:
        """Messages that were refused."""
        return sum(guard.refused_count for guard in self._guards)

    @property
    def sites(self) -> list[str]:
        """Addresses at which the server listens."""
        return [site.name for site in self._served.runner.sites]

    @property
    def connections(self) -> list[Any]:
        """All open connections, of sockets and others."""
        return list(self._served.runner.server.connections)

    @property
    def clients(self) -> set[str]:
        """Names of the clients that have sent the password."""
        return {client for handler in self.handlers for client in handler.authentified_client_ids}

    async def disconnect_idle(self) -> None:
        """End connections without a whole request, and those of clients that have sent no password, after a while."""
        self._slow_requests.disconnect_idle(self.connections)
        late = self.password_check.unauthenticated_clients(self.clients)
        await part_from([one.connections[name] for one in self.handlers for name in late if name in one.connections])

    async def end(self, ending: asyncio.Future[Any]) -> None:
        """End all connections while the server ends: who does not answer, or does not read, cannot hold that up."""
        server = self._served.runner.server  # which its runner drops at the end
        await asyncio.wait({ending}, timeout=2 * FAREWELL_SECONDS)
        await self._slow_requests.stop_answers()
        for connection in list(server.connections):
            if connection.transport is not None:
                connection.transport.abort()
        await ending
