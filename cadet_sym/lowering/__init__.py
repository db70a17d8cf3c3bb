"""From SymPy to CasADi: the only place that knows both."""
