"""Checks of every request before anything reads it: token, origin, size."""

import secrets

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST = 100_000_000
"""Of a request's body, in bytes."""

TOO_LARGE = f"The log is above {LARGEST // 1_000_000} MB: use `yawrate tune`, or a part of it."

HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src data:; connect-src 'self'; frame-src 'self'; form-action 'none'; base-uri 'none'; "
    "frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
"""Of every response that does not say otherwise: it loads nothing but this server's own files."""


class TooLargeError(Exception):
    """A body that goes on beyond `LARGEST` bytes."""


class Guard:
    """Refuse requests without the token, of other pages, or too large, without reading them.

    The token is the first part of the path and is compared in constant time.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        self.app, self.token = app, token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on with a count of the bytes that arrive."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = scope["path"].split("/")[1] if "/" in scope["path"] else ""
        own = {None, f"http://{headers.get('host')}"}
        if not secrets.compare_digest(given.encode(), self.token):
            refusal = refused(403, "The address lacks the token that `yawrate app` printed.")
        elif scope["method"] not in ("GET", "HEAD") and headers.get("origin") not in own:
            refusal = refused(403, "Another page asked for this.")
        elif not _within(headers.get("content-length")):
            refusal = refused(413, TOO_LARGE)
        else:
            await self.app(scope, _counted(receive), _with_headers(send))
            return
        await refusal(scope, receive, _with_headers(send))


def refused(status: int, words: str) -> JSONResponse:
    """One line for the user."""
    return JSONResponse({"error": words}, status)


def _within(length: str | None) -> bool:
    return length is None or (length.isdecimal() and int(length) <= LARGEST)


def _counted(receive: Receive) -> Receive:
    arrived = 0

    async def counted() -> Message:
        nonlocal arrived
        message = await receive()
        arrived += len(message.get("body", b""))
        if arrived > LARGEST:
            raise TooLargeError
        return message

    return counted


def _with_headers(send: Send) -> Send:
    async def completed(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {name for name, _ in message["headers"]}
            further = ((k.encode(), v.encode()) for k, v in HEADERS.items())
            message["headers"] = [
                *message["headers"],
                *((name, value) for name, value in further if name not in present),
            ]
        await send(message)

    return completed
