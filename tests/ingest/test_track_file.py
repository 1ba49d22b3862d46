"""Reading files of tracks: the usual forms, units, and what goes wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from semap_ingest.track_file import Layout, fingerprint, read_tracks

from semap.errors import InvalidInput
from semap.timeline.stamp import parse_stamp

NOON_US = parse_stamp("2026-01-31T12:00:00Z")


def write(folder: Path, text: str, name: str = "walk.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_usual_names_and_iso_stamps(tmp_path: Path) -> None:
    path = write(tmp_path, "track,stamp,x_m,y_m,z_m,std_m\n"
                 "ann,2026-01-31T12:00:00Z,1,2,0.5,0.1\n"
                 "bob,2026-01-31T13:00:00.25+01:00,3,4,,\n")  # fmt: skip
    tracks = read_tracks(path, Layout())
    assert tracks.names == ("ann", "bob")
    assert tracks.stamp_us.tolist() == [NOON_US, NOON_US + 250_000]
    assert tracks.x_m.tolist() == [1, 3]
    np.testing.assert_array_equal(tracks.z_m, [0.5, np.nan])
    np.testing.assert_array_equal(tracks.std_m, [0.1, np.nan])
    assert tracks.findings == ()


def test_a_covariance_becomes_an_ellipse(tmp_path: Path) -> None:
    path = write(tmp_path, "track,stamp,x,y,vx,vxy,vy\n"
                 "a,1,0,0,200,100,200\na,2,0,0,,,\na,3,0,0,400,0,400\na,4,0,0,1,1.0000001,1\n")  # fmt: skip
    columns = {"var-x": "vx", "cov-xy": "vxy", "var-y": "vy"}
    tracks = read_tracks(path, Layout(columns=columns, stamp_unit="s", unit="cm"))
    np.testing.assert_allclose(tracks.std_m, [0.03**0.5, np.nan, 0.2, 0.0002**0.5], rtol=1e-6)
    np.testing.assert_allclose(tracks.std_across_m, [0.01**0.5, np.nan, np.nan, 0], atol=1e-9)
    np.testing.assert_allclose(tracks.std_yaw_rad, [np.pi / 4, np.nan, np.nan, np.pi / 4])


EXACT = "track,stamp,x,y,var_x_m2,cov_xy_m2,var_y_m2\na,1,0,0,1,0,1\n"


@pytest.mark.parametrize("cells", ["1,2,1", "-1,0,1", "nan,nan,nan", "1,,1", "1,0,inf", "1,nan,1", "0,0.1,0"])
def test_what_is_no_covariance_is_left_out_with_its_line(tmp_path: Path, cells: str) -> None:
    tracks = read_tracks(write(tmp_path, f"{EXACT}b,2,0,0,{cells}\n"), Layout(stamp_unit="s"))
    assert tracks.names == ("a",)
    (told,) = tracks.left_out.lines()
    assert told.startswith("walk.csv, line 3: ")
    assert (
        "no finite number" in told if {"nan", "inf"} & set(cells.split(",")) else "is no covariance" in told
    )


def test_white_space_frames_and_centimetres_without_header(tmp_path: Path) -> None:
    path = write(tmp_path, "# frames\n\n7 50 100 -60 176\n7 25 0 0 0\n", "walk.txt")
    layout = Layout(names=("track", "frame", "x", "y", "z"), columns={"stamp": "frame"}, stamp_unit="25fps",
                    epoch_us=NOON_US, unit="cm")  # fmt: skip
    tracks = read_tracks(path, layout)
    assert tracks.names == ("7",)
    assert tracks.stamp_us.tolist() == [NOON_US + 1_000_000, NOON_US + 2_000_000]
    np.testing.assert_allclose(tracks.y_m, [0, -0.6])
    assert [f.action for f in tracks.findings] == ["note"]


@pytest.mark.parametrize(("unit", "text"), [("s", "1628008099.976"), ("ms", "1628008099976"),
                                            ("us", "1628008099976000"), ("ns", "1.628008099976e+18")])  # fmt: skip
def test_units_of_stamps(tmp_path: Path, unit: str, text: str) -> None:
    path = write(tmp_path, f"t;x;y\n{text};1;1\n")
    tracks = read_tracks(path, Layout(track="robot", stamp_unit=unit))
    assert tracks.stamp_us.tolist() == [1_628_008_099_976_000]


def test_rows_that_cannot_be_used_are_left_out_and_told(tmp_path: Path) -> None:
    path = write(tmp_path, "track,t,x,y\n" "a,1,1,1\n" "a,2,nan,1\n" "# a pause\n" "a,3,1,\n" "a,,1,1\n" "a,1,9,9\n"
                 "a,4,1e9,1\n" ",5,1,1\n" "a,6,1,-inf\n" "a,7,1\n" "a,1e300,1,1\n" "a,0,5,5\n" "a,1,1,1\n")  # fmt: skip
    tracks = read_tracks(path, Layout(stamp_unit="s"))
    assert tracks.stamp_us.tolist() == [0, 1_000_000]
    assert tracks.x_m.tolist() == [5, 1]
    assert [f.subject for f in tracks.findings] == ["1 rows", "the order of rows"]
    assert tracks.left_out.count == 9
    assert [line.partition(". ")[0] for line in tracks.left_out.lines()] == [
        "walk.csv, line 3: x is nan, no finite number",
        "walk.csv, line 5: there is no y",
        "walk.csv, line 6: there is no stamp",
        "walk.csv, line 7: its track has another place at the same stamp in walk.csv, line 2",
        "walk.csv, line 8: x is 1e+09 m, and semap holds places up to 10,000,000 m from the origin",
        "walk.csv, line 9: the track has no name",
        "walk.csv, line 10: y is -inf, no finite number",
        "walk.csv, line 11: 3 values where 4 are expected",
        "walk.csv, line 12: the stamp 1e300 in s is not within the years 1800 to 9998",
    ]


@pytest.mark.parametrize(
    ("text", "layout", "message"),
    [
        ("", Layout(), "no states"),
        ("track,stamp,x,y\n", Layout(), "no states"),
        ("1,2,3\n4,5,6\n", Layout(), "no header"),
        ("track,stamp,x\na,1,1\n", Layout(stamp_unit="s"), "no column for the y"),
        ("stamp,x,y\n1,1,1\n", Layout(stamp_unit="s"), "no column for the track"),
        ("track,stamp,x,y\na,1,1,1\n", Layout(columns={"x": "easting"}), "'easting'"),
        ("track,stamp,x,y,var_x_m2\na,1,1,1,1\n", Layout(stamp_unit="s"), "no cov-xy, var-y"),
        (
            "track,stamp,x,y,std,var_x_m2,cov_xy_m2,var_y_m2\na,1,1,1,1,1,0,1\n",
            Layout(stamp_unit="s"),
            "a standard deviation and a covariance",
        ),
        ("track,stamp,x,y\na,yesterday,1,1\n", Layout(), "ISO 8601"),
        ("track,stamp,x,y\na,2026-01-31T12:00:00,1,1\n", Layout(), "no offset"),
        ("track,stamp,x,y\na,1,one,1\n", Layout(stamp_unit="s"), "'one' is not a number"),
        ('track,stamp,x,y\na,1,1,1\n"a,2,1,1\n', Layout(stamp_unit="s"), "line 3: its quotes"),
        ("track,stamp,x,x,y\na,1,1,1,1\n", Layout(stamp_unit="s"), "several columns are called 'x'"),
        ("track,stamp,x,y\na,0001-01-01T00:00:00Z,1,1\n", Layout(), "not within the years 1800 to 9998"),
        ("track,stamp,x,y\na,1,1,1\n", Layout(stamp_unit="s", timezone="UTC"), "have no zone"),
        ("track,stamp,x,y\na,1,1,1\n", Layout(timezone="Mars/Olympus"), "no time zone 'Mars/Olympus'"),
        ("stamp,x,y\n1,1,1\n", Layout(stamp_unit="s", track=" "), "--track: the name"),
        ("track,stamp,x,y\na,1,1,1\n", Layout(stamp_unit="fortnight"), "'fortnight'"),
        ("track,stamp,x,y\na,1,1,1\n", Layout(stamp_unit="s", unit="furlong"), "'furlong'"),
        ("track,stamp,x,y\na,1,nan,1\n", Layout(stamp_unit="s"), "finite"),
        ("\0\1\2\xff\n\0", Layout(), "column"),
    ],
)
def test_what_cannot_be_read_is_told_with_its_remedy(
    tmp_path: Path, text: str, layout: Layout, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message) as wrong:
        read_tracks(write(tmp_path, text), layout)
    assert wrong.value.remedy


def test_of_many_rows_that_cannot_be_used_the_first_are_told(tmp_path: Path) -> None:
    rows = "".join(f"a,{n},{'nan' if n % 3 else 1},1\n" for n in range(90))
    told = read_tracks(write(tmp_path, "track,t,x,y\n" + rows), Layout(stamp_unit="s")).left_out
    assert told.count == 60
    assert [line.split(":")[0] for line in told.lines()[:20]] == [
        f"walk.csv, line {n + 2}" for n in range(90) if n % 3
    ][:20]
    assert told.lines()[20:] == ["and 40 more"]


@pytest.mark.parametrize("name", ["a\0b", "\0", "J\udcfcrgen", "x" * 201, " "])
def test_names_that_cannot_be_stored(tmp_path: Path, name: str) -> None:
    path = tmp_path / "walk.csv"
    path.write_bytes(f"track,t,x,y\na,1,1,1\n{name},1,1,1\n".encode(errors="surrogateescape"))
    tracks = read_tracks(path, Layout(stamp_unit="s"))
    assert tracks.names == ("a",)
    assert [line.partition(":")[0] for line in tracks.left_out.lines()] == ["walk.csv, line 3"]


def test_utf_16_is_read_as_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("track\tt\tx\ty\nJürgen\t1\t2\t3\n", encoding="utf-16")
    assert read_tracks(path, Layout(stamp_unit="s")).names == ("Jürgen",)


def test_stamps_without_a_zone_are_those_of_the_zone_that_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, "track,stamp,x,y\n"
                 "a,2026-01-31T13:00:00,1,1\na,2026-07-31T14:00:00,2,1\na,2026-01-31T12:00:01Z,3,1\n"
                 "a,2026-03-29T02:30:00,1,1\na,2026-10-25T02:30:00,1,1\n")  # fmt: skip
    tracks = read_tracks(path, Layout(timezone="Europe/Berlin"))
    assert tracks.x_m.tolist() == [1, 3, 2]
    assert tracks.stamp_us.tolist() == [NOON_US, NOON_US + 1_000_000, parse_stamp("2026-07-31T12:00:00Z")]
    assert [line.split(" is not one moment in ")[0] for line in tracks.left_out.lines()] == [
        "walk.csv, line 5: '2026-03-29T02:30:00'", "walk.csv, line 6: '2026-10-25T02:30:00'",
    ]  # fmt: skip
    assert read_tracks(path, Layout(timezone="+01:00")).stamp_us[0] == NOON_US
    assert "--timezone" in read_tracks(path, Layout()).left_out.lines()[0]


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no file"):
        read_tracks(tmp_path / "nowhere.csv", Layout())


def test_parquet_gives_what_csv_gives(tmp_path: Path) -> None:
    csv_path = write(
        tmp_path,
        "track,stamp,x,y,z,var_x_m2,cov_xy_m2,var_y_m2\n"
        "b,2026-01-31T12:00:01Z,1.5,2,,0.25,0,1\na,2026-01-31T12:00:00Z,3,4,1,,,\n",
    )
    table = pyarrow.table({
        "track": ["b", "a"],
        "stamp": pyarrow.array([NOON_US + 1_000_000, NOON_US], pyarrow.timestamp("us", "UTC")),
        "x": [1.5, 3.0], "y": [2, 4], "z": [None, 1.0],
        "var_x_m2": [0.25, None], "cov_xy_m2": [0.0, None], "var_y_m2": [1, None],
    })  # fmt: skip
    parquet.write_table(table, tmp_path / "walk.parquet")
    from_csv, from_parquet = read_tracks(csv_path, Layout()), read_tracks(tmp_path / "walk.parquet", Layout())
    assert from_parquet.names == from_csv.names == ("a", "b")
    for name in ("track", "stamp_us", "x_m", "y_m", "z_m", "std_m", "std_across_m", "std_yaw_rad"):
        np.testing.assert_array_equal(getattr(from_parquet, name), getattr(from_csv, name))
    np.testing.assert_array_equal(from_parquet.std_m, [np.nan, 1])
    np.testing.assert_array_equal(from_parquet.std_across_m, [np.nan, 0.5])
    np.testing.assert_array_equal(from_parquet.std_yaw_rad, [np.nan, np.pi / 2])


def test_parquet_rows_that_cannot_be_used_are_told_by_number(tmp_path: Path) -> None:
    naive = pyarrow.array([NOON_US, None, NOON_US + 1], pyarrow.timestamp("us"))
    table = pyarrow.table(
        {"track": ["a", "a", None], "stamp": naive, "x": [1.0, 1.0, 1.0], "y": [1.0, 1.0, 1.0]}
    )
    parquet.write_table(table, tmp_path / "walk.parquet")
    tracks = read_tracks(tmp_path / "walk.parquet", Layout(timezone="UTC"))
    assert tracks.stamp_us.tolist() == [NOON_US]
    assert [line.partition(". ")[0] for line in tracks.left_out.lines()] == [
        "walk.parquet, row 2: there is no stamp", "walk.parquet, row 3: the track has no name",
    ]  # fmt: skip
    with pytest.raises(InvalidInput, match=r"row 1: .* has no offset from UTC"):
        read_tracks(tmp_path / "walk.parquet", Layout())


def test_a_broken_parquet_file(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="Parquet"):
        read_tracks(write(tmp_path, "PAR1 no", "walk.parquet"), Layout())


def test_the_fingerprint_is_that_of_bytes_and_layout(tmp_path: Path) -> None:
    path = write(tmp_path, "track,stamp,x,y\n")
    same = write(tmp_path, "track,stamp,x,y\n", "copy.csv")
    assert fingerprint(path, Layout()) == fingerprint(same, Layout())
    assert fingerprint(path, Layout()) != fingerprint(path, Layout(unit="cm"))
    path.write_text("track,stamp,x,y\n\n")
    assert fingerprint(path, Layout()) != fingerprint(same, Layout())
