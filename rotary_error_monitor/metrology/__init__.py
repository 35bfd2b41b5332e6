"""Pure formulas: from readings to error motions and figures."""
