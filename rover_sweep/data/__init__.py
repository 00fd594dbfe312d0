"""What flows between the rooms: recordings, geometry, the vehicle file, intervals, result tables."""
