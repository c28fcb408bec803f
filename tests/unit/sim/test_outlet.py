"""The connection to a viewer's server, against a real WebSocket server without our code."""

import os
import threading
import time
from contextlib import contextmanager

import pytest
from websockets.sync.server import serve

from smarts.sim import outlet
from smarts.sim.outlet import Address, Outlet
from smarts.stream.container import unpack

LIMIT = 30.0


class Server:
    """Keeps what it receives while `reads` is set."""

    def __init__(self):
        self.messages, self.requests, self.reads = [], [], threading.Event()
        self.reads.set()

    def take(self, connection):
        self.requests.append(connection.request)
        while True:
            self.reads.wait()
            try:
                self.messages.append(unpack(connection.recv()))
            except Exception:
                return


@contextmanager
def running(port=0):
    handler = Server()
    with serve(handler.take, "127.0.0.1", port, compression=None, max_queue=1, max_size=None) as server:
        threading.Thread(target=server.serve_forever).start()
        handler.port = server.socket.getsockname()[1]
        yield handler
        handler.reads.set()


@pytest.fixture
def fast(monkeypatch):
    monkeypatch.setattr(outlet, "_RETRY", 0.05)


def wait(condition):
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def opened(server):
    made = Outlet(Address("127.0.0.1", server.port))
    wait(lambda: made.is_open)
    return made


def message(number, size=0):
    return {"type": "x", "n": number, "d": bytes(size)}


def numbers(server):
    return [each["n"] for each in server.messages]


def test_messages_arrive_in_order():
    with running() as server:
        sender = opened(server)
        for number in range(100):
            sender.put(message(number), sender.epoch)
        wait(lambda: len(server.messages) == 100)
        sender.close()
        assert numbers(server) == [*range(100)]


def test_a_server_that_does_not_read_costs_messages_and_no_time():
    with running() as server:
        sender = opened(server)
        server.reads.clear()
        epoch, put, begun = sender.epoch, 0, time.monotonic()
        while sender.epoch < epoch + 3:
            sender.put(message(put, 10_000), sender.epoch)
            put += 1
        assert time.monotonic() - begun < LIMIT
        server.reads.set()
        wait(lambda: sender.put(message(-1), sender.epoch) or -1 in numbers(server))
        sender.close()
        found = [number for number in numbers(server) if number >= 0]
        # Some are missing; those that came are whole and in order.
        assert len(found) < put
        assert found == sorted(set(found))
        assert len(server.requests) == 1


@pytest.mark.usefixtures("fast")
def test_a_server_that_ends_and_comes_back_is_found_again():
    with running() as server:
        sender, port = opened(server), server.port
        epoch = sender.epoch
    wait(lambda: not sender.is_open)
    sender.put(message(0), sender.epoch)
    with running(port) as server:
        wait(lambda: sender.is_open)
        assert sender.epoch > epoch
        sender.put(message(0), epoch)  # what builds on something lost is not sent
        sender.put(message(1), sender.epoch)
        wait(lambda: server.messages)
        sender.close()
        assert numbers(server) == [1]


def test_a_process_that_was_forked_off_does_not_disturb():
    with running() as server:
        sender = opened(server)
        sender.put(message(0), sender.epoch)
        child = os.fork()
        if not child:
            sender.put(message(7), sender.epoch)
            sender.close()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        sender.put(message(1), sender.epoch)
        wait(lambda: len(server.messages) == 2)
        sender.close()
        assert numbers(server) == [0, 1]
