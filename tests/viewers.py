"""The server of the viewer, run in a thread, and requests to it."""

import http.client
import threading
from contextlib import closing, contextmanager
from typing import Any

from websockets.sync.client import ClientConnection, connect

from smarts.envision.server import ViewServer

PAGE = (
    "<!doctype html><html><head><title>E</title><style>p{}</style></head>"
    "<body><!--EPISODE--><script type=module>let a = 1;</script></body></html>"
)


@contextmanager
def serving(library=None, **options):
    """Yield a server that answers until the block ends."""
    server = ViewServer(library, **{"port": 0, "page": PAGE} | options)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(20)
        assert not thread.is_alive()


def viewer(server, **options) -> ClientConnection:
    """Return a connection as a browser's page has one; it may be closed with messages unread."""
    given: dict[str, Any] = {"origin": f"http://127.0.0.1:{server.port}", "max_size": None, **options}
    return _connected(f"ws://127.0.0.1:{server.port}/live", **given)


def publisher(server, **options) -> ClientConnection:
    """Return a connection as a process with simulations has one."""
    return _connected(f"ws://127.0.0.1:{server.port}/publish", **options)


def _connected(address, **options) -> ClientConnection:
    # No pings: while kernels compile, the server answers none.
    given: dict[str, Any] = {"close_timeout": 0.2, "ping_interval": None, **options}
    return connect(address, **given)


def ask(server, path, *, method="GET", body=None, **headers):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(connection):
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
