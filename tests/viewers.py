"""The server of the viewer, run in a thread, and requests to it."""

import http.client
import threading
from contextlib import contextmanager
from socket import IPPROTO_TCP, TCP_INFO

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


def ask(server, path, *, method="GET", body=None, **headers):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def received_bytes(connection):
    """Return how many bytes have come to a WebSocket, of `tcpi_bytes_received` in struct tcp_info."""
    info = connection.socket.getsockopt(IPPROTO_TCP, TCP_INFO, 256)
    return int.from_bytes(info[128:136], "little")
