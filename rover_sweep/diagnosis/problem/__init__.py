"""The least-squares problem of a diagnosis: noise floor, residuals, solver, signatures."""
