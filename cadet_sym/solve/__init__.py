"""Solvers for the compiled moment equations: transients, stationary moments, branches of them, sensitivities."""
