"""Continuous queries written in SQL: a SELECT over documented views becomes a declaration, or is refused."""

from semap.query_text.declaration import declaration_of
from semap.query_text.views import view_name

__all__ = ["declaration_of", "view_name"]
