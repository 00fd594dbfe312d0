"""The DataFlash messages that the embedded rover writes, as ArduRover 4.6.3 lays them out.

Copied from the FMT, FMTU, UNIT and MULT records of the recordings of the real firmware.
"""

from __future__ import annotations

from sitl.flash_log.dataflash_writer import LogFormat

SCRIPT_TYPE_FIRST = 250  # scripts' messages take the free types downwards from here
PWM14 = ",".join(f"C{n}" for n in range(1, 15))

FORMATS = {
    fmt.name: fmt
    for fmt in (
        LogFormat(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
        LogFormat(118, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
        LogFormat(119, "UNIT", "QbZ", "TimeUS,Id,Label", "s--", "F--"),
        LogFormat(120, "MULT", "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
        LogFormat(32, "PARM", "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
        LogFormat(59, "MSG", "QZ", "TimeUS,Message", "s-", "F-"),
        LogFormat(
            206,
            "VER",
            "QBHBBBBIZHBB",
            "TimeUS,BT,BST,Maj,Min,Pat,FWT,GH,FWS,APJ,BU,FV",
            "s-----------",
            "F-----------",
        ),
        LogFormat(
            163,
            "IMU",
            "QBffffffIIfBBHH",
            "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
            "s#EEEooo--O--zz",
            "F-000000-----00",
        ),
        LogFormat(161, "ACC", "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ", "s#sooo", "F-F000"),
        LogFormat(162, "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ", "s#sEEE", "F-F000"),
        LogFormat(
            72,
            "ATT",
            "QffffffB",
            "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF",
            "sddddhh-",
            "F000000-",
        ),
        LogFormat(
            44,
            "XKF1",
            "QBccCfffffffccce",
            "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
            "s#ddhnnnnmmmkkkm",
            "F-BBB0000000BBBB",
        ),
        LogFormat(60, "RCIN", "Q" + "H" * 14, "TimeUS," + PWM14, "s" + "Y" * 14, "F" + "-" * 14),
        LogFormat(62, "RCOU", "Q" + "H" * 14, "TimeUS," + PWM14, "s" + "Y" * 14, "F" + "-" * 14),
        LogFormat(
            2,
            "STER",
            "Qhfffff",
            "TimeUS,SteerIn,SteerOut,DesLatAcc,LatAcc,DesTurnRate,TurnRate",
            "s--ookk",
            "F--0000",
        ),
        LogFormat(0, "THR", "Qhffff", "TimeUS,ThrIn,ThrOut,DesSpeed,Speed,AccX", "s--nno", "F--000"),
        LogFormat(
            94,
            "GPS",
            "QBBIHBcLLeffffB",
            "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
            "s#-s-S-DUmnhnh-",
            "F--C-0BGGB000--",
        ),
        LogFormat(177, "DSF", "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv", "s--b---", "F--0---"),
        LogFormat(122, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
        LogFormat(186, "ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method", "s----", "F----"),
        LogFormat(181, "EV", "QB", "TimeUS,Id", "s-", "F-"),
        LogFormat(184, "ERR", "QBB", "TimeUS,Subsys,ECode", "s--", "F--"),
    )
}

UNITS = {
    "-": "",
    "?": "UNKNOWN",
    "A": "A",
    "d": "deg",
    "b": "B",
    "k": "deg/s",
    "D": "deglatitude",
    "E": "rad/s",
    "h": "degheading",
    "m": "m",
    "n": "m/s",
    "o": "m/s/s",
    "O": "degC",
    "%": "%",
    "S": "satellites",
    "s": "s",
    "U": "deglongitude",
    "Y": "us",
    "z": "Hz",
    "#": "instance",
}
MULTIPLIERS = {
    "-": 0.0,
    "?": 1.0,
    "2": 100.0,
    "1": 10.0,
    "0": 1.0,
    "A": 1e-1,
    "B": 1e-2,
    "C": 1e-3,
    "D": 1e-4,
    "E": 1e-5,
    "F": 1e-6,
    "G": 1e-7,
    "I": 1e-9,
    "!": 3.6,
    "/": 3600.0,
}
