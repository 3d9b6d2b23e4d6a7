"""The page over HTTP: who may ask, what is answered, and how a render is streamed and given up."""

import asyncio
import sys
import traceback
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from harness.viewer.asked import LARGEST_BODY, Asked, BadRequest, parsed, view_number
from harness.viewer.shown_run import ShownRun
from harness.viewer.wire import message

PAGE = Path(__file__).parent / "page"
FILES = {
    "/": ("index.html", "text/html"),
    "/viewer.css": ("viewer.css", "text/css"),
    "/viewer.js": ("viewer.js", "text/javascript"),
    "/camera.js": ("camera.js", "text/javascript"),
    "/panel.js": ("panel.js", "text/javascript"),
    "/stream.js": ("stream.js", "text/javascript"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
"""Path → file and type: nothing else is read from the disk for a request."""
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
"""Pages whose newest request is remembered."""

Made = TypeVar("Made")


@dataclass
class Desk:
    """Takes requests and has them done by one thread, a piece of work at a time."""

    shown: ShownRun
    worker: ThreadPoolExecutor
    newest: OrderedDict[str, int] = field(default_factory=OrderedDict)
    """Page → the generation of its newest request."""

    async def done(self, work: Callable[..., Made], *arguments: Any) -> Made:
        return await asyncio.get_running_loop().run_in_executor(self.worker, work, *arguments)

    def enter(self, asked: Asked) -> None:
        """Whatever the page asked for before is given up after the call of rays that it is at."""
        self.newest[asked.client] = max(asked.generation, self.newest.pop(asked.client, -1))
        while len(self.newest) > MOST_CLIENTS:
            self.newest.popitem(last=False)

    def wanted(self, asked: Asked) -> bool:
        return self.newest.get(asked.client) == asked.generation

    async def stream(self, asked: Asked, gone: Callable[[], Any]) -> AsyncIterator[bytes]:
        messages = self.shown.messages(asked)
        try:
            while self.wanted(asked) and not await gone():
                piece = await self.done(_next_piece, messages)
                if piece is None:
                    break
                yield piece
        finally:
            with suppress(RuntimeError):  # the worker has ended with the program
                self.worker.submit(messages.close)


def _next_piece(messages: Iterator[bytes]) -> bytes | None:
    try:
        return next(messages, None)
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        return message("broken", note=f"{type(error).__name__} while rendering; the terminal has the details.")


def application(shown: ShownRun, worker: ThreadPoolExecutor, hosts: list[str]) -> Starlette:
    """`hosts`: the names under which the page may be asked for; any other `Host` header is refused."""
    desk = Desk(shown, worker)

    async def run(request: Request) -> Response:
        return JSONResponse(shown.listing())

    async def scene(request: Request) -> Response:
        return JSONResponse(await desk.done(shown.scene_listing, request.query_params.get("scene", "")))

    async def truth(request: Request) -> Response:
        view = view_number(request.query_params.get("view"))
        found = await desk.done(shown.truth_message, request.query_params.get("scene", ""), view)
        return Response(found, media_type="application/octet-stream")

    async def render(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
            return PlainTextResponse("send JSON, with its content type", 415)
        origin = request.headers.get("origin")
        if origin is not None and origin != f"http://{request.headers.get('host')}":
            return PlainTextResponse("another page may not ask for views", 403)
        asked = parsed(await _body(request))
        await desk.done(shown.checked, asked)
        desk.enter(asked)
        return StreamingResponse(desk.stream(asked, request.is_disconnected), media_type="application/octet-stream")

    routes = [
        *(Route(path, _file(*what), methods=["GET"]) for path, what in FILES.items()),
        Route("/run.json", run, methods=["GET"]),
        Route("/scene.json", scene, methods=["GET"]),
        Route("/truth", truth, methods=["GET"]),
        Route("/render", render, methods=["POST"]),
    ]
    refusals = {BadRequest: _refused, Exception: _broken}
    middleware = [Middleware(SafeHeaders), Middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)]
    return Starlette(routes=routes, middleware=middleware, exception_handlers=refusals)


async def _refused(request: Request, mistake: Exception) -> Response:
    return PlainTextResponse(str(mistake), 400)


async def _broken(request: Request, error: Exception) -> Response:
    traceback.print_exception(error, file=sys.stderr)
    return PlainTextResponse(f"{type(error).__name__}; the terminal has the details", 500)


async def _body(request: Request) -> bytes:
    """No more than is allowed is ever kept."""
    found = b""
    async for part in request.stream():
        found += part
        if len(found) > LARGEST_BODY:
            raise BadRequest(f"the request has more than {LARGEST_BODY} bytes")
    return found


def _file(name: str, kind: str) -> Callable[[Request], Any]:
    content = (PAGE / name).read_bytes()

    async def answer(request: Request) -> Response:
        return Response(content, media_type=kind)

    return answer


class SafeHeaders:
    """Puts `HEADERS` on every answer, refusals as well."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(part: Message) -> None:
            if part["type"] == "http.response.start":
                added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                part = {**part, "headers": [*part.get("headers", []), *added]}
            await send(part)

        await self.app(scope, receive, with_headers)
