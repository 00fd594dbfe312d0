"""The folder of a session, which explains itself: what was planned, driven and fetched, and what is to drive.

    session.json   what is what, written whole after every change
    rover.toml     copy of the vehicle file
    NAME.tlog      telemetry of each run; connect.tlog: between the runs; fetch.tlog: of fetching logs
    logNUMBER.BIN  the vehicle's own logs

All names in it are relative, so that it can be carried to another machine. session.json may be lost: the
runs are then found from their tlogs.
"""
