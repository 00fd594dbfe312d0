"""Text files of other exporters: text above, below and between the names and the numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.errors import DataRefused
from rover_sweep.logs.readers.text_table import TextTable, read_text_table

ROWS = [f"{n / 10:.1f},{n % 7}.5,{-n}.25" for n in range(60)]


def read(folder: Path, *lines: str) -> TextTable:
    path = folder / "drive.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_text_table(path)


RACE = (
    '"Format","Some CSV File",,,"Workbook",""',
    '"Log Date","01/01/2020",,,"Origin Time","0.000","s"',
    '"Sample Rate","100.000","Hz"',
    '"Range","entire outing","0"',
    "",
    "",
)


@pytest.mark.parametrize(
    ("above", "names"),
    [
        (("t,steer,rate",), ("t", "steer", "rate")),
        ((*RACE, '"t","steer","rate"', '"s","deg","deg/s"', ""), ("t [s]", "steer [deg]", "rate [deg/s]")),
        (("t,steer,rate", "C1,C1,C1", "s,rad,rad/s"), ("t [s]", "steer [rad]", "rate [rad/s]")),
        (("s,rad,rad/s", "t,steer,rate", "C1,C1,C1"), ("t [s]", "steer [rad]", "rate [rad/s]")),
        (("Logger 1.2", "Driver: A, B, C, D", "", "t,steer,rate,"), ("t", "steer", "rate")),
        (("Logger 1.2",), ("column 1", "column 2", "column 3")),
        ((), ("column 1", "column 2", "column 3")),
    ],
    ids=["names", "race logger", "device and units", "units above", "a comma more", "no names", "bare"],
)
def test_names_and_units_are_found_in_any_lines_above(
    above: tuple[str, ...], names: tuple[str, ...], tmp_path: Path
) -> None:
    found = read(tmp_path, *above, *ROWS)
    assert found.names == names
    assert [len(cells) for cells in found.cells] == [60, 60, 60]
    assert found.cells[2][59] == "-59.25"


def test_lines_below_and_cut_lines_are_left_out_with_their_place(tmp_path: Path) -> None:
    found = read(tmp_path, "t,steer,rate", *ROWS, *ROWS, "12.1,3", "", "End of the recording")
    assert len(found.cells[0]) == 120
    assert [note.text for note in found.notes] == [
        "drive.csv: 2 lines have another number of columns and were left out; the first is line 122, "
        "with 2 of 3"
    ]
    with pytest.raises(DataRefused, match="line 5 has 2 of 3 columns"):
        read(tmp_path, "t,steer,rate", *ROWS[:3], "12.1,3", *ROWS[3:])


def test_a_text_column_is_kept_and_rows_that_end_with_a_comma_are_read(tmp_path: Path) -> None:
    found = read(tmp_path, "t,frame,steer,rate", *(row.replace(",", ",base,", 1) + "," for row in ROWS))
    assert found.names == ("t", "frame", "steer", "rate")
    assert set(found.cells[1]) == {"base"}
