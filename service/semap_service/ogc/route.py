"""Routes of OGC API, where what a client got wrong is answered by 400 (OGC API Features, part 1, 7.5)."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from http import HTTPStatus
from typing import Any

from fastapi import Request, Response, params
from fastapi.dependencies.utils import get_flat_params
from fastapi.exceptions import RequestValidationError

from semap.errors import InvalidInput
from semap_service.documents.problem import Place
from semap_service.http.etag import TaggedRoute
from semap_service.http.problem import places, problem_response

KIND = "invalid-input"


class OgcRoute(TaggedRoute):
    """A tagged route that knows all its parameters, and refuses others."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        answer = super().get_route_handler()
        known = {
            each.alias
            for each in get_flat_params(self.dependant)
            if isinstance(each.field_info, params.Query)
        }

        async def strict(request: Request) -> Response:
            unknown = sorted(set(request.query_params) - known)
            if unknown:
                return _refusal(
                    request,
                    f"There is no parameter {unknown[0]}.",
                    f"There are {', '.join(sorted(known))}." if known else "Leave it out.",
                    [Place(where=f"query.{unknown[0]}", message="there is no such parameter")],
                )
            try:
                return await answer(request)
            except RequestValidationError as error:
                wrong, more = places(error)
                detail = "; ".join(f"{each.where}: {each.message}" for each in wrong[:3])
                return _refusal(request, detail, "Correct what `errors` names; see /api.", wrong, more)
            except InvalidInput as error:
                found = [Place(where=error.where, message=str(error))] if error.where else []
                return _refusal(request, str(error), error.remedy, found)

        return strict


def _refusal(request: Request, detail: str, remedy: str, errors: list[Place], more: int = 0) -> Response:
    return problem_response(
        request.url.path,
        HTTPStatus.BAD_REQUEST,
        detail,
        kind=KIND,
        remedy=remedy,
        errors=errors,
        more_errors=more,
    )
