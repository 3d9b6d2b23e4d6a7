"""The page over HTTP: access control, answers, and the streaming and cancelling of renders."""

import asyncio
import socket
import sys
import traceback
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from harness.viewer.requests import LARGEST_BODY, BadRequest, ViewRequest, parsed, view_number
from harness.viewer.shown_run import ShownRun
from harness.viewer.wire import message

PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
FILES = {"/": "index.html", **{f"/{file.name}": file.name for file in PAGE.iterdir() if file.suffix in TYPES}}
"""Map path → file; a request can read no other file."""
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
MOST_CLIENTS = 64
MOST_STREAMS = 8
"""The maximum number of views in rendering: each holds its pictures in memory."""
BODY_SECONDS = 10.0

Made = TypeVar("Made")


@dataclass
class Desk:
    """The requests in progress, all of whose work is done in one thread, piece by piece."""

    shown: ShownRun
    worker: ThreadPoolExecutor
    newest: OrderedDict[str, int] = field(default_factory=OrderedDict)
    """Map page → the generation of its newest request."""
    streams: int = 0

    async def done(self, work: Callable[..., Made], *arguments: object) -> Made:
        return await asyncio.get_running_loop().run_in_executor(self.worker, work, *arguments)

    def enter(self, asked: ViewRequest) -> None:
        """Register a request, which cancels the page's earlier one; raises `BadRequest` if it is not newer."""
        if asked.generation <= (known := self.newest.get(asked.client, -1)):
            raise BadRequest(f"generation {asked.generation}: this page has asked for number {known} already", 409)
        self.newest[asked.client] = asked.generation
        self.newest.move_to_end(asked.client)
        while len(self.newest) > MOST_CLIENTS:
            self.newest.popitem(last=False)

    async def stream(self, asked: ViewRequest, gone: Callable[[], Awaitable[bool]]) -> AsyncIterator[bytes]:
        messages = self.shown.messages(asked)
        try:
            while not await gone():
                if self.newest.get(asked.client) != asked.generation:
                    yield message("given up")
                    break
                piece = await self.done(_next_piece, messages)
                if piece is None:
                    break
                yield piece
        finally:
            with suppress(RuntimeError):  # the worker has ended with the program
                self.worker.submit(messages.close)


class Streamed(StreamingResponse):
    """A stream that makes room for another one at its end, even if its first piece was never taken."""

    def __init__(self, desk: Desk, pieces: AsyncIterator[bytes]) -> None:
        super().__init__(pieces, media_type="application/octet-stream")
        self.desk = desk

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self.desk.streams -= 1


class Announced(uvicorn.Server):
    """A server that calls `announce` once it answers."""

    def __init__(self, config: uvicorn.Config, announce: Callable[[], None]) -> None:
        super().__init__(config)
        self.announce = announce

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.announce()


def _next_piece(messages: Iterator[bytes]) -> bytes | None:
    try:
        return next(messages, None)
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        return message("broken", note=f"{type(error).__name__} while rendering; the terminal has the details.")


def application(shown: ShownRun, worker: ThreadPoolExecutor, hosts: list[str]) -> Starlette:
    """Return the application, which answers only to these names in the `Host` header."""
    desk = Desk(shown, worker)

    async def run(request: Request) -> Response:
        return JSONResponse(shown.listing())

    async def scene(request: Request) -> Response:
        return JSONResponse(await desk.done(shown.scene_listing, request.query_params.get("scene", "")))

    async def truth(request: Request) -> Response:
        view = view_number(request.query_params.get("view"))
        message = await desk.done(shown.truth_message, request.query_params.get("scene", ""), view)
        return Response(message, media_type="application/octet-stream")

    async def render(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            return PlainTextResponse("send JSON, with its content type", 415)
        if desk.streams >= MOST_STREAMS:
            raise BadRequest(f"{MOST_STREAMS} views are being rendered already: ask again in a moment", 503)
        desk.streams += 1
        try:
            asked = parsed(await _body(request))
            await desk.done(shown.checked, asked)
            desk.enter(asked)
        except BaseException:
            desk.streams -= 1
            raise
        return Streamed(desk, desk.stream(asked, request.is_disconnected))

    routes = [
        *(Route(path, _file(PAGE / name), methods=["GET"]) for path, name in FILES.items()),
        Route("/run.json", run, methods=["GET"]),
        Route("/scene.json", scene, methods=["GET"]),
        Route("/truth", truth, methods=["GET"]),
        Route("/render", render, methods=["POST"]),
    ]
    middleware = [Middleware(Guard), Middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)]
    return Starlette(routes=routes, middleware=middleware, exception_handlers={BadRequest: _refuse, Exception: _break})


async def _refuse(request: Request, reason: Exception) -> Response:
    assert isinstance(reason, BadRequest)
    return PlainTextResponse(str(reason), reason.status)


async def _break(request: Request, error: Exception) -> Response:
    traceback.print_exception(error, file=sys.stderr)
    return PlainTextResponse(f"{type(error).__name__}; the terminal has the details", 500)


async def _body(request: Request) -> bytes:
    body = b""
    try:
        async with asyncio.timeout(BODY_SECONDS):
            async for part in request.stream():
                body += part
                if len(body) > LARGEST_BODY:
                    raise BadRequest(f"the request has more than {LARGEST_BODY} bytes")
    except TimeoutError as error:
        raise BadRequest(f"the request did not arrive within {BODY_SECONDS:g} seconds", 408) from error
    return body


def _file(path: Path) -> Callable[[Request], Awaitable[Response]]:
    content = path.read_bytes()

    async def answer(request: Request) -> Response:
        return Response(content, media_type=TYPES[path.suffix])

    return answer


class Guard:
    """A filter that adds `HEADERS` and refuses requests of other sites' pages, as rendering costs work."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(part: Message) -> None:
            if part["type"] == "http.response.start":
                added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                part = {**part, "headers": [*part.get("headers", []), *added]}
            await send(part)

        headers = Headers(scope=scope)
        own = f"http://{headers.get('host')}"
        foreign = headers.get("origin", own) != own or headers.get("sec-fetch-site") == "cross-site"
        app = PlainTextResponse("another site's page may not ask", 403) if foreign else self.app
        await app(scope, receive, with_headers)
