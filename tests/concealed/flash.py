"""A small writer of ArduPilot DataFlash logs: packed records of numpy, FMT first, then merged by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

HEAD = b"\xa3\x95"

# Format characters as in ArduPilot's LogStructure.h; c, C, e hold hundredths, L 1e-7 degrees.
PACKED = {
    "b": "<i1",
    "B": "<u1",
    "M": "<u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
    "n": "S4",
    "N": "S16",
    "Z": "S64",
    "c": "<i2",
    "C": "<u2",
    "e": "<i4",
    "E": "<u4",
    "L": "<i4",
}
SCALE = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


@dataclass(frozen=True)
class Layout:
    """One message type: number, name, format characters and labels, as its FMT message says them."""

    number: int
    name: str
    formats: str
    labels: str

    @property
    def dtype(self) -> np.dtype[Any]:
        names = self.labels.split(",")
        fields = [(name, PACKED[char]) for name, char in zip(names, self.formats, strict=True)]
        return np.dtype([("head", "S2"), ("number", "u1"), *fields])

    def records(self, columns: Mapping[str, ArrayLike]) -> NDArray[Any]:
        """Packed records (n,) of `columns`, each (n,) or a constant; what is not given is 0."""
        n = max(np.size(column) for column in columns.values())
        out = np.zeros(n, self.dtype)
        out["head"], out["number"] = HEAD, self.number
        for name, char in zip(self.labels.split(","), self.formats, strict=True):
            if name in columns:
                values = np.asarray(columns[name])
                out[name] = np.round(values * SCALE[char]) if char in SCALE else _whole(values, char)
        return out


def _whole(values: NDArray[Any], char: str) -> NDArray[Any]:
    return np.round(values) if char in "bBMhHiI" and values.dtype.kind == "f" else values


FMT = Layout(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
LAYOUTS = {
    layout.name: layout
    for layout in (
        Layout(72, "ATT", "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF"),
        Layout(44, "XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
        Layout(163, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
        Layout(32, "PARM", "QNff", "TimeUS,Name,Value,Default"),
        Layout(
            94, "GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"
        ),
        Layout(59, "MSG", "QZ", "TimeUS,Message"),
        Layout(60, "RCIN", "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"),
        Layout(62, "RCOU", "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"),
        Layout(181, "EV", "QB", "TimeUS,Id"),
        Layout(186, "ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
        Layout(122, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
        Layout(206, "VER", "QBHBBBBIZHBB", "TimeUS,BT,BST,Maj,Min,Pat,FWT,GH,FWS,APJ,BU,FV"),
        Layout(177, "DSF", "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv"),
        Layout(250, "SWEP", "QBBfffff", "TimeUS,Run,St,T,Cmd,Out,VN,VE"),
    )
}


def _declarations() -> bytes:
    rows = [FMT, *LAYOUTS.values()]
    return FMT.records(
        {
            "Type": [row.number for row in rows],
            "Length": [row.dtype.itemsize for row in rows],
            "Name": np.array([row.name.encode() for row in rows]),
            "Format": np.array([row.formats.encode() for row in rows]),
            "Columns": np.array([row.labels.encode() for row in rows]),
        }
    ).tobytes()


def log_bytes(messages: Sequence[tuple[str, Mapping[str, ArrayLike]]]) -> bytes:
    """The whole log: declarations, then the messages of all types in the order of their TimeUS.

    messages: (type name, {label: values}); TimeUS in whole microseconds. Equal stamps keep the order given.
    """
    tables = [LAYOUTS[name].records(columns) for name, columns in messages]
    order = np.argsort(np.concatenate([table["TimeUS"] for table in tables]), kind="stable")
    pieces = [piece for table in tables for piece in _pieces(table)]
    return _declarations() + b"".join([pieces[k] for k in order])


def _pieces(table: NDArray[Any]) -> list[bytes]:
    size, whole = table.dtype.itemsize, table.tobytes()
    return [whole[k : k + size] for k in range(0, len(whole), size)]
