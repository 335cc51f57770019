"""`kaju watch`: agents in Python, watched in browsers on the same machine.

One page, one websocket a session; a session is a model of its own. Sessions share nothing but
the scene they begin with, read no files, and are dropped when nobody has asked them anything
for a while. Only pages that this server has sent may talk to it: other hosts' names (DNS
rebinding) and other pages' requests (cross-site websockets) are refused. The address carries a
token, so that other users of the machine, who can reach the port as well, stay out.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import webbrowser
from typing import TYPE_CHECKING

from kaju.errors import ParameterError, needing
from kaju.model.rheology.creep_model import CreepModel

from .export import live_page, packed_page, page_html
from .live import Session, Watched, sessions_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

ADDRESS = "127.0.0.1"
HOSTS = (ADDRESS, "localhost")
IDLE = 1800.0
"""Sessions that ask nothing for so long (s) are dropped."""
MOST_SESSIONS = 64
LARGEST_MESSAGE = 8_000_000
"""Bytes of a message: a million cells as base64, and loads."""
REFUSED, GONE, FULL = 1008, 1001, 1013
"""Codes with which websockets are closed: of another page, idle, too many."""

_SERVER = "kaju watch needs a server: pip install 'kaju[watch]'"


def watch(
    of: Watched | CreepModel, port: int = 8000, *, browser: bool = True, idle: float = IDLE
) -> None:
    """Show agents at work in a browser, until interrupted (Ctrl+C).

    Every browser window is a session with a model of its own, that of `of` begun anew. The
    server listens to this machine only.

    Parameters
    ----------
    of : Scene, LoadModel, ElasticModel or CreepModel
        A scene with a prescribed or an elastic rule. A model may have agents of your own. What
        creeps is run to its last time, and played.
    port : int
        0 takes any that is free.
    browser : bool
        Whether to open a browser window.
    idle : float
        Sessions that ask nothing for so long (s) are dropped.

    Raises
    ------
    MissingExtraError
        If Starlette or uvicorn are not installed.
    ParameterError
        If it is none of these, or the port is taken.

    Examples
    --------
    >>> from kaju import Scene, watch
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> watch(scene)  # doctest: +SKIP
    """
    with needing(_SERVER):
        import uvicorn

    token = secrets.token_urlsafe(16)
    app = watch_app(of, idle=idle, token=token)
    listening = _listen(port)
    address = f"http://{ADDRESS}:{listening.getsockname()[1]}/?token={token}"
    print(f"watch at {address} (Ctrl+C ends it)", flush=True)  # noqa: T201
    if browser:
        webbrowser.open(address)
    config = uvicorn.Config(
        app, log_level="warning", ws_max_size=LARGEST_MESSAGE, timeout_graceful_shutdown=1
    )
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listening])


def watch_app(of: Watched | CreepModel, idle: float = IDLE, token: str = "") -> Starlette:
    """Return the application that `watch` serves, for servers of your own.

    Parameters
    ----------
    of, idle
        As for `watch`.
    token : str
        What addresses must carry as ``?token=…``; unless given, everybody who reaches the
        server may watch.
    """
    with needing(_SERVER):
        from starlette.applications import Starlette
        from starlette.middleware import Middleware
        from starlette.middleware.trustedhost import TrustedHostMiddleware
        from starlette.responses import HTMLResponse, PlainTextResponse
        from starlette.routing import Route, WebSocketRoute

    begin: Callable[[], Session] = Session
    if isinstance(of, CreepModel):  # its times are computed at once, and the page plays them
        html = page_html(packed_page(of.again(of.subject)), "kaju watch")
    else:
        begin = sessions_of(of)
        html = live_page(begin().opening())

    def has_token(asks: Request | WebSocket) -> bool:
        given = asks.query_params.get("token", "").encode()
        return not token or secrets.compare_digest(given, token.encode())

    async def page(request: Request) -> Response:
        if not has_token(request):
            return PlainTextResponse(_STRANGER, 403, _HEADERS)
        return HTMLResponse(html, headers=_HEADERS)

    sessions = Sessions(idle)

    async def session(websocket: WebSocket) -> None:
        if not (_same_origin(websocket) and has_token(websocket)):
            await websocket.close(REFUSED)
            return
        await sessions.serve(websocket, begin())

    return Starlette(
        routes=[Route("/", page), WebSocketRoute("/session", session)],
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=list(HOSTS))],
    )


_STRANGER = """This page is for whoever started `kaju watch`: open the address that it printed.
"""
_HEADERS = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Sessions:
    """Open pages; each is answered in a thread, so that none waits for another."""

    def __init__(self, idle: float) -> None:
        self.idle = idle
        self.open = 0

    async def serve(self, websocket: WebSocket, run: Session) -> None:
        """Answer one websocket until it is closed or idle."""
        from starlette.websockets import WebSocketDisconnect

        await websocket.accept()
        if self.open >= MOST_SESSIONS:
            await websocket.close(FULL, f"{MOST_SESSIONS} pages are open already: close one")
            return
        self.open += 1
        try:
            while True:
                frame = await asyncio.wait_for(websocket.receive(), self.idle)
                if frame["type"] == "websocket.disconnect":
                    return
                # A binary frame is read like a text one; what is no JSON gets an answer too.
                message = frame.get("text") or frame.get("bytes", b"").decode(errors="replace")
                await websocket.send_bytes(await asyncio.to_thread(run.answer, message))
        except TimeoutError:
            await websocket.close(GONE, "nothing was asked for a long time: load the page again")
        except (WebSocketDisconnect, RuntimeError):  # closed, while it was answered perhaps
            pass
        finally:
            self.open -= 1


def _same_origin(websocket: WebSocket) -> bool:
    """Tell whether a page of this very server asks; browsers always say whose page it is."""
    origin = websocket.headers.get("origin")
    return origin is not None and origin == f"http://{websocket.headers.get('host')}"


def _listen(port: int) -> socket.socket:
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
        listening.listen(128)  # browsers that come before the server is ready wait
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or error
        raise ParameterError(f"port: {port} cannot be used ({reason}); take another") from error
    return listening
