"""The page's server: requests to calls, one at a time.

===========================  ==========================================================
``GET /``, ``/app.js`` …     the page
``GET /choices``             the tuners' names
``POST /logs?name=``         a log, as the body; its number and how it was understood
``POST /logs/1``             the form; how the log is understood with it
``POST /logs/1/answer``      the form; the answer
``GET /logs/1/report``       the answer's report
``GET /logs/1/files/json``   a file: ``report``, ``json``, ``c``, ``matlab`` or ``st``
``DELETE /logs/1``           forget the log
===========================  ==========================================================

All of them lie below ``/TOKEN``.  What tunes is imported after the page was sent.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route

from tuners.app.guard import TOO_LARGE, Guard, TooLargeError, refused
from tuners.app.uploads import Upload, Uploads

T = TypeVar("T")

HOSTS = ["127.0.0.1", "localhost"]

PAGE = {
    "": ("tuners.app", "page/index.html", "text/html"),
    "app.js": ("tuners.app", "page/app.js", "text/javascript"),
    "app.css": ("tuners.app", "page/app.css", "text/css"),
    "uplot.js": ("tuners.cli", "report/templates/uplot/uPlot.iife.min.js", "text/javascript"),
    "uplot.css": ("tuners.cli", "report/templates/uplot/uPlot.min.css", "text/css"),
}
"""Package, file and type by address."""

REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data:; form-action 'none'; base-uri 'none'; "
    "frame-ancestors 'self'"
)
"""The report is one file with scripts of its own and must not reach this server."""


def application(token: str, own: tuple[str, ...] = ()) -> Starlette:
    """The server for one run; its logs are gone when it ends.

    Parameters
    ----------
    own : tuple of str
        Files of tuners that the page offers beside those of the package; the first is the default.
    """
    routes = [
        *(Route(f"/{name}", _page(*source)) for name, source in PAGE.items()),
        Route("/choices", _choices),
        Route("/logs", _upload, methods=["POST"]),
        Route("/logs/{number:int}", _understood, methods=["POST"]),
        Route("/logs/{number:int}", _remove, methods=["DELETE"]),
        Route("/logs/{number:int}/answer", _answered, methods=["POST"]),
        Route("/logs/{number:int}/report", _report),
        Route("/logs/{number:int}/files/{target:str}", _file),
    ]
    server = Starlette(
        routes=[Mount("/{token}", routes=routes)],
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=HOSTS, www_redirect=False),
            Middleware(Guard, token=token),
        ],
        exception_handlers={
            TooLargeError: _too_large,
            ClientDisconnect: _broken_off,
            HTTPException: _not_found,
            Exception: _failed,
        },
        lifespan=_lifespan,
    )
    server.state.own = own
    return server


@asynccontextmanager
async def _lifespan(app: Starlette) -> AsyncIterator[None]:
    """A folder for the logs, and one thread that does all the work: kernels share their memory."""
    worker = ThreadPoolExecutor(max_workers=1)
    with TemporaryDirectory(prefix="yawrate-app-") as folder:
        app.state.uploads, app.state.worker = Uploads(Path(folder)), worker
        try:
            yield
        finally:
            worker.shutdown(wait=False, cancel_futures=True)


async def _work(request: Request, call: Callable[[Any], T]) -> T:
    """Call a function of `tuners.app.answers`, which is imported in the thread that works."""

    def called() -> T:
        from tuners.app import answers

        return call(answers)

    return await asyncio.get_running_loop().run_in_executor(request.app.state.worker, called)


def _page(package: str, file: str, kind: str) -> Callable[[Request], Any]:
    content = files(package).joinpath(file).read_bytes()

    async def sent(request: Request) -> Response:
        return Response(content, media_type=kind)

    return sent


async def _choices(request: Request) -> Response:
    own = request.app.state.own
    return JSONResponse(await _work(request, lambda answers: answers.choices(own)))


async def _upload(request: Request) -> Response:
    uploads: Uploads = request.app.state.uploads
    name = request.query_params.get("name", "")
    number, upload = await uploads.add(name, request.stream())
    own = request.app.state.own
    told = await _work(request, lambda answers: answers.understood(upload, {}, own))
    return JSONResponse({"number": number, **told})


async def _understood(request: Request) -> Response:
    upload, form, own = _log(request), await _form(request), request.app.state.own
    return JSONResponse(await _work(request, lambda answers: answers.understood(upload, form, own)))


async def _answered(request: Request) -> Response:
    upload, form, own = _log(request), await _form(request), request.app.state.own
    return JSONResponse(await _work(request, lambda answers: answers.answered(upload, form, own)))


async def _remove(request: Request) -> Response:
    _log(request)
    request.app.state.uploads.remove(request.path_params["number"])
    return Response(status_code=204)


async def _report(request: Request) -> Response:
    answer = _log(request).answer
    if answer is None:
        raise HTTPException(404)
    headers = {"content-security-policy": REPORT_POLICY}
    return Response(answer.report, media_type="text/html", headers=headers)


async def _file(request: Request) -> Response:
    upload, target = _log(request), request.path_params["target"]
    try:
        ending, content = await _work(request, lambda answers: answers.exported(upload, target))
    except KeyError:
        raise HTTPException(404) from None
    name = quote(Path(upload.name).stem + ending)
    headers = {"content-disposition": f"attachment; filename*=UTF-8''{name}"}
    return Response(content, media_type="application/octet-stream", headers=headers)


def _log(request: Request) -> Upload:
    uploads: Uploads = request.app.state.uploads
    try:
        return uploads[request.path_params["number"]]
    except KeyError:
        raise HTTPException(404) from None


async def _form(request: Request) -> dict[str, Any]:
    try:
        form = await request.json()
    except ValueError:
        raise HTTPException(400) from None
    if not isinstance(form, dict):
        raise HTTPException(400)
    return form


async def _too_large(request: Request, error: Exception) -> Response:
    return refused(413, TOO_LARGE)


async def _broken_off(request: Request, error: Exception) -> Response:
    return refused(400, "The log did not arrive whole.")


async def _not_found(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return refused(error.status_code, "There is nothing here.")


async def _failed(request: Request, error: Exception) -> Response:
    return refused(500, "The program failed: the terminal in which it runs says how.")
