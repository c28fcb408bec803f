"""The server of `smarts-bench view`: the page, recorded episodes, and what simulations send. Read-only."""

from __future__ import annotations

import errno
import hashlib
import hmac
import json
import secrets
import socket
from collections.abc import Mapping
from contextlib import closing
from typing import Any

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
_MOST_TOKEN_BYTES = 1024
_STANDSTILL = 60_000
"""A connection that takes nothing for so long is ended [ms]."""
_READING = 2.0
"""Time for reading episodes before they are listed; the page asks again for the rest [s]."""
_FRAMES = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*"
"""Notebooks show the page in a frame, from another port."""


class Guard:
    """Decides which requests are answered, and adds the headers that browsers are to obey.

    On loopback, a request must name a loopback host, so that no other site's name leads here. Elsewhere it
    must carry the token, as a cookie or as `Authorization: Bearer`. A request from another site's page is
    refused anywhere.

    Args:
        app: What answers.
        token: "" on loopback.
        port: The server's; cookies know no ports, so their names have it.
        policy: The page's content security policy.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, policy: str) -> None:
        self._app, self._token = app, token
        self.cookie = f"envision_{port}"
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
        problem = self._problem(HTTPConnection(scope))
        if problem is None:
            await self._app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            # Closed before it was accepted: the client gets 403.
            await send({"type": "websocket.close", "code": 1008, "reason": problem[1]})
        else:
            status, text = problem
            answer = JSONResponse({"error": text}, status_code=status)
            await answer(scope, receive, self._with_headers(send))

    def is_token(self, given: str) -> bool:
        """Return whether a text is the token, in a time that does not tell how much of it is right."""
        return hmac.compare_digest(given.encode(errors="replace"), self._token.encode())

    def cookie_value(self) -> str:
        """Return what the cookie holds in place of the token."""
        return hashlib.sha256(f"envision {self._token}".encode()).hexdigest()

    def _problem(self, request: HTTPConnection) -> tuple[int, str] | None:
        """Return status and text of a refusal, None if the request is to be answered."""
        host = request.headers.get("host", "")
        if not self._token and _name_of(host) not in LOOPBACK:
            return 421, "this server answers on localhost only; open the address that it printed"
        origin = request.headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return 403, "a page of another site may not use this server"
        is_socket = request.scope["type"] == "websocket"
        if self._token and (is_socket or request.url.path.startswith("/api/")):
            if request.url.path != "/api/token" and not self._has_token(request):
                return 401, "the token is missing or wrong; open the address that smarts-bench view printed"
        elif is_socket and origin is None and request.url.path != "/publish":
            return 403, "only the page may open this"
        return None

    def _has_token(self, request: HTTPConnection) -> bool:
        cookie = request.cookies.get(self.cookie, "")
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        return hmac.compare_digest(
            cookie.encode(errors="replace"), self.cookie_value().encode()
        ) or self.is_token(bearer)

    def _with_headers(self, send: Send) -> Send:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name.lower() for name, _ in message["headers"]}
                more = [(name.encode(), value.encode()) for name, value in self._headers.items()]
                message["headers"] = [*message["headers"], *(each for each in more if each[0] not in given)]
            await send(message)

        return send_with_headers


class ViewServer:
    """Serves the page and episodes.

    Args:
        library: The recorded episodes; None: none.
        live: Whether to show running simulations.
        host: Address to listen at.
        port: 0: any that is free.
        token: What viewers elsewhere must show; "" makes one where it is needed.
        page: The page; "": the built one.

    Raises:
        SmartsError: The port is taken, or the address is not this machine's.
    """

    def __init__(
        self,
        library: EpisodeLibrary | None,
        *,
        live: bool = False,
        host: str = LOOPBACK[0],
        port: int = DEFAULT_PORT,
        token: str = "",
        page: str = "",
    ) -> None:
        self._library = library
        self._hub = LiveHub() if live else None
        self.page = page or viewer_page()
        self._socket = _listen(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        self.token = "" if host in LOOPBACK else token or secrets.token_urlsafe(24)
        """What viewers must show, "" on loopback."""
        self._guard = Guard(Starlette(routes=self._routes()), self.token, self.port, policy_of(self.page))
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
        """The address that a browser is to open; a token is behind the `#`, which browsers do not send."""
        name = socket.gethostname() if self.host in ("0.0.0.0", "::") else self.host
        shown = f"[{name}]" if ":" in name else name
        return f"http://{shown}:{self.port}/{f'#token={self.token}' if self.token else ''}"

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
            Route("/api/token", self._take_token, methods=["POST"]),
            Route("/api/episodes", self._list),
            Route("/api/episodes/{number}", self._episode),
        ]

    async def _show_page(self, request: Request) -> Response:
        return HTMLResponse(self.page)

    async def _info(self, request: Request) -> Response:
        return JSONResponse({"live": self._hub is not None})

    async def _take_token(self, request: Request) -> Response:
        """Give a viewer that has the token a cookie, so that the address need not have it."""
        given = await _json_of(request)
        if not self._guard.is_token(str(given.get("token", ""))):
            error = "the token is wrong; open the address that smarts-bench view printed"
            return JSONResponse({"error": error}, status_code=401)
        answer = JSONResponse({})
        value = self._guard.cookie_value()
        answer.set_cookie(self._guard.cookie, value, httponly=True, samesite="strict")
        return answer

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


async def _json_of(request: Request) -> Mapping[str, Any]:
    """Return the JSON object that a request brings, empty if it brings none, or much more than a token."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _MOST_TOKEN_BYTES:
            return {}
    try:
        given = json.loads(body)
    except ValueError:
        return {}
    return given if isinstance(given, dict) else {}


def _name_of(host: str) -> str:
    """Return the name in a header `Host`, without the port."""
    return host[1 : host.find("]")] if host.startswith("[") else host.partition(":")[0]


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = socket.create_server((host, port), family=family, backlog=64)
    except (OSError, OverflowError) as error:
        is_unknown = getattr(error, "errno", 0) in (errno.EADDRNOTAVAIL, socket.EAI_NONAME)
        remedy = (
            f"give an address of this machine with --host, such as {LOOPBACK[0]}, or 0.0.0.0 for all"
            if is_unknown
            else "give another port with --port, or 0 for any that is free"
        )
        raise SmartsError(
            f"the server cannot listen: {getattr(error, 'strerror', None) or error}",
            place=f"{host}:{port}",
            remedy=remedy,
        ) from error
    # Connections have both, too: one that takes nothing is not kept for what it was to get, nor a publisher
    # in the list whose machine is gone.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _STANDSTILL)
    keep_alive(listener)
    return listener
