"""What import-linter does not see: a circle that goes through a package and what is in it."""

from __future__ import annotations

import grimp
import networkx


def test_no_module_imports_what_imports_it() -> None:
    graph = grimp.build_graph("semap", "semap_ingest", "semap_service")
    imports = networkx.DiGraph(
        (module, found)
        for module in graph.modules
        for found in graph.find_modules_directly_imported_by(module)
    )
    assert imports.number_of_edges() > 2000
    assert [sorted(each) for each in networkx.strongly_connected_components(imports) if len(each) > 1] == []
