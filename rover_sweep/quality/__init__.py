"""Data that look fine and are not: one file for each check, all called by `faults.faults_of`."""
