"""The server of `smarts-bench view`: the page, recorded episodes, and what simulations send. Read-only."""

from __future__ import annotations

import socket
from contextlib import closing

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from smarts.envision.episode_library import EpisodeLibrary, as_json
from smarts.envision.live import LiveHub
from smarts.envision.viewer_page import policy_of, viewer_page
from smarts.errors import SmartsError
from smarts.stream.container import MOST_BYTES
from smarts_agent_kit.server import keep_alive

DEFAULT_PORT = 8081
LOOPBACK = ("127.0.0.1", "::1", "localhost")
_STANDSTILL = 60_000
"""A connection that takes nothing for so long is ended [ms]."""
_READING = 2.0
"""Time for reading episodes before they are listed; the page asks again for the rest [s]."""
_FRAMES = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*"
"""Notebooks show the page in a frame, from another port."""


class Guard:
    """Decides which requests are answered, and adds the headers that browsers are to obey.

    A request must name a loopback host, so that no other site's name leads here. A request from another
    site's page is refused.

    Args:
        app: What answers.
        policy: The page's content security policy.
    """

    def __init__(self, app: ASGIApp, policy: str) -> None:
        self._app = app
        self._headers = {
            "content-security-policy": f"{policy}; connect-src 'self'; {_FRAMES}",
            "x-content-type-options": "nosniff",
            "referrer-policy": "no-referrer",
            "cache-control": "no-store",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it with a reason."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        problem = _problem(HTTPConnection(scope))
        if problem is None:
            await self._app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            # Closed before it was accepted: the client gets 403.
            await send({"type": "websocket.close", "code": 1008, "reason": problem[1]})
        else:
            status, text = problem
            answer = JSONResponse({"error": text}, status_code=status)
            await answer(scope, receive, self._with_headers(send))

    def _with_headers(self, send: Send) -> Send:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                more = [(name.encode(), value.encode()) for name, value in self._headers.items()]
                message["headers"] = [*message["headers"], *(each for each in more if each[0] not in given)]
            await send(message)

        return send_with_headers


def _problem(request: HTTPConnection) -> tuple[int, str] | None:
    """Return status and text of a refusal, None if the request is to be answered."""
    host = request.headers.get("host", "")
    if _name_of(host) not in LOOPBACK:
        return 421, "this server answers on localhost only; open the address that it printed"
    origin = request.headers.get("origin")
    if origin is not None and origin.partition("://")[2] != host:
        return 403, "a page of another site may not use this server"
    if request.scope["type"] == "websocket" and origin is None and request.url.path != "/publish":
        return 403, "only the page may open this"
    return None


class ViewServer:
    """Serves the page and episodes.

    Args:
        library: The recorded episodes; None: none.
        live: Whether to show running simulations.
        port: 0: any that is free.
        page: The page; "": the built one.

    Raises:
        SmartsError: The port is taken.
    """

    def __init__(
        self,
        library: EpisodeLibrary | None,
        *,
        live: bool = False,
        port: int = DEFAULT_PORT,
        page: str = "",
    ) -> None:
        self._library = library
        self._hub = LiveHub() if live else None
        self.page = page or viewer_page()
        self._socket = _listen(port)
        self.port = int(self._socket.getsockname()[1])
        self._guard = Guard(Starlette(routes=self._routes()), policy_of(self.page))
        config = uvicorn.Config(
            self._guard,
            log_config=None,  # uvicorn's own closes the handlers of all others in the process
            log_level="error",
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=MOST_BYTES,
            ws_per_message_deflate=True,
            # The answer to a ping waits behind all that a slow viewer is to get first.
            ws_ping_timeout=None,
            timeout_graceful_shutdown=1,
            lifespan="off",
            proxy_headers=False,
            server_header=False,
        )
        self._server = uvicorn.Server(config)

    @property
    def url(self) -> str:
        """The address that a browser is to open."""
        return f"http://{LOOPBACK[0]}:{self.port}/"

    def run(self) -> None:
        """Serve until interrupted or stopped."""
        with closing(self._socket):
            self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """Have `run` return; may be called from another thread."""
        self._server.should_exit = True

    def _routes(self) -> list[BaseRoute]:
        hub = self._hub
        sockets = [("/live", hub.watch), ("/publish", hub.publish)] if hub else []
        return [
            *(WebSocketRoute(path, endpoint) for path, endpoint in sockets),
            Route("/", self._show_page),
            Route("/api/info", self._info),
            Route("/api/episodes", self._list),
            Route("/api/episodes/{number}", self._episode),
        ]

    async def _show_page(self, request: Request) -> Response:
        return HTMLResponse(self.page)

    async def _info(self, request: Request) -> Response:
        return JSONResponse({"live": self._hub is not None})

    async def _list(self, request: Request) -> Response:
        entries = [] if self._library is None else await run_in_threadpool(self._library.entries, _READING)
        return JSONResponse(as_json(entries))

    async def _episode(self, request: Request) -> Response:
        number = request.path_params["number"]
        try:
            data = None if self._library is None else await run_in_threadpool(self._library.compact, number)
        except SmartsError as error:
            return JSONResponse({"error": error.problem}, status_code=422)
        except OSError as error:
            return JSONResponse({"error": f"it cannot be read: {error.strerror}"}, status_code=422)
        if data is None:
            return PlainTextResponse("there is no such episode", status_code=404)
        return Response(data, media_type="application/octet-stream")


def _name_of(host: str) -> str:
    """Return the name in a header `Host`, without the port."""
    return host[1 : host.find("]")] if host.startswith("[") else host.partition(":")[0]


def _listen(port: int) -> socket.socket:
    try:
        listener = socket.create_server((LOOPBACK[0], port), backlog=64)
    except OSError as error:
        raise SmartsError(
            f"the server cannot listen: {error.strerror}",
            place=f"{LOOPBACK[0]}:{port}",
            remedy="give another port with --port, or 0 for any that is free",
        ) from error
    # Connections have both, too: one that takes nothing is not kept for what it was to get, nor a publisher
    # in the list whose machine is gone.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _STANDSTILL)
    keep_alive(listener)
    return listener
