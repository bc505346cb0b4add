"""Every error as one sentence in JSON: `{"error": "What was wrong, what was got, what to do."}`."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from dipcg.app.jobs import Busy, sentence
from dipcg.app.training_folder import NoTraining
from dipcg.workers.process import BuildError

# Sentences for the errors that FastAPI and Starlette raise themselves.
SENTENCES = {
    "Not Found": "There is nothing at this address.",
    "Method Not Allowed": "This address does not take this method.",
    "Content Too Large": "The request is too large.",
    "There was an error parsing the body": "The body is no JSON that can be read.",
}


def add_error_handlers(app: FastAPI) -> None:
    """Let an application answer errors in one sentence each."""
    app.add_exception_handler(HTTPException, _of_http)
    app.add_exception_handler(RequestValidationError, _of_validation)
    app.add_exception_handler(ClientDisconnect, _of_nobody)
    app.add_exception_handler(ValueError, _of(422))
    app.add_exception_handler(BuildError, _of(422))
    app.add_exception_handler(NoTraining, _of(404))
    app.add_exception_handler(Busy, _of(503))
    app.add_exception_handler(Exception, _of(500))


def _answer(status: int, words: str, headers: Any = None) -> JSONResponse:
    return JSONResponse({"error": words}, status, headers)


def _of(status: int) -> Any:
    async def handle(_: Request, error: Exception) -> JSONResponse:
        return _answer(status, sentence(error))

    return handle


async def _of_nobody(_: Request, error: Exception) -> Response:
    """The client is gone, and nobody reads this."""
    return Response(status_code=400)


async def _of_http(_: Request, error: Any) -> JSONResponse:
    return _answer(error.status_code, SENTENCES.get(error.detail, str(error.detail)), error.headers)


async def _of_validation(_: Request, error: Any) -> JSONResponse:
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"] if part != "body")
    words = str(first["msg"]).removeprefix("Value error, ").rstrip(".")
    return _answer(422, f"{where}: {words}." if where else f"{words}.")
