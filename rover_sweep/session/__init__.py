"""The folder of a session: the planned and driven runs, the fetched logs, and the runs still to drive.

    session.json   description of the session, written as a whole after every change
    rover.toml     copy of the vehicle file
    NAME.tlog      telemetry of each run; connect.tlog: between the runs; fetch.tlog: while fetching logs
    logNUMBER.BIN  the vehicle's logs

All names in it are relative, so that the folder can be moved. Without session.json the runs are found from
their tlogs.
"""
