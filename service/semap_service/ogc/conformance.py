"""Which requirements classes hold here."""

from __future__ import annotations

FEATURES = "http://www.opengis.net/spec/ogcapi-features-{}/1.0/conf/{}"
COMMON = "http://www.opengis.net/spec/ogcapi-common-1/1.0/conf/{}"
CQL2 = "http://www.opengis.net/spec/cql2/1.0/conf/{}"

CLASSES = (
    *(COMMON.format(each) for each in ("core", "landing-page", "json")),
    "http://www.opengis.net/spec/ogcapi-common-2/1.0/conf/collections",
    *(FEATURES.format(1, each) for each in ("core", "oas30", "geojson")),
    FEATURES.format(2, "crs"),
    *(FEATURES.format(3, each) for each in ("queryables", "filter", "features-filter")),
    *(
        CQL2.format(each)
        for each in (
            "cql2-text",
            "cql2-json",
            "basic-cql2",
            "advanced-comparison-operators",
            "case-insensitive-comparison",
            "accent-insensitive-comparison",
            "basic-spatial-functions",
            "basic-spatial-functions-plus",
            "spatial-functions",
            "temporal-functions",
            "array-functions",
            "property-property",
            "arithmetic",
        )
    ),
    "http://www.opengis.net/spec/ogcapi-features-8/1.0/conf/sortables",
    "http://www.opengis.net/spec/ogcapi-features-8/1.0/conf/features-sorting",
)
