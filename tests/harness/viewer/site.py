"""The page served in this process, on a free port, by the server that users get; and requests to it."""

import gc
import http.client
import itertools
import json
import struct
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import uvicorn

from harness.command.look_commands import bound, config_of, hosts_of
from harness.machine.device import use_threads
from harness.viewer.server import application
from harness.viewer.shown_run import ShownRun

BYTES_PER_PIXEL = 12
generations = itertools.count(1)
ORBIT = {"azimuth": 0.7, "elevation": 0.4, "distance": 4.0, "target": [0, 0, 0]}


def unpacked(stream: bytes) -> list[tuple[dict[str, Any], bytes]]:
    messages, at = [], 0
    while at + 4 <= len(stream):
        length = struct.unpack_from("<I", stream, at)[0]
        header = json.loads(stream[at + 4 : at + 4 + length])
        start, at = at + 4 + length, at + 4 + length + BYTES_PER_PIXEL * header["pixels"]
        if at > len(stream):
            break
        messages.append((header, stream[start:at]))
    return messages


@dataclass(frozen=True)
class Site:
    port: int
    shown: ShownRun
    worker: ThreadPoolExecutor

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def ask(self, verb: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Return status, headers and body; names of `headers` have `_` for `-`."""
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            line.request(verb, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
            answer = line.getresponse()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
        finally:
            line.close()

    def json(self, path: str) -> Any:
        status, _, body = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def render(self, **changes: Any) -> tuple[int, bytes]:
        status, _, body = self.ask("POST", "/render", wanted(**changes), content_type="application/json")
        return status, body

    def messages(self, **changes: Any) -> list[tuple[dict[str, Any], bytes]]:
        status, body = self.render(**changes)
        assert status == 200, body
        return unpacked(body)


def wanted(**changes: Any) -> bytes:
    """Return a valid request, newer than all before, with changes; a value of None leaves the key out."""
    request = {
        "client": "a test",
        "generation": next(generations),
        "scene": "ball",
        "methods": ["nerf", "qnerf"],
        "place": ORBIT,
        "attention": {"kind": "foveal", "row": 0.5, "column": 0.5},
        **changes,
    }
    return json.dumps({name: value for name, value in request.items() if value is not None}).encode()


@contextmanager
def served(shown: ShownRun) -> Iterator[Site]:
    listening = bound("127.0.0.1", 0)
    worker = ThreadPoolExecutor(1, initializer=use_threads, initargs=(1,))
    config = config_of(application(shown, worker, hosts_of("127.0.0.1")))
    config.timeout_graceful_shutdown = 5  # with 0, the loop can end before it has closed its connections
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    port = listening.getsockname()[1]
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield Site(port, shown, worker)
    server.should_exit = True
    thread.join(20)
    assert not thread.is_alive()
    worker.shutdown()
    # a socket that the loop did not close would warn in a later test, when it is collected
    gc.collect()
