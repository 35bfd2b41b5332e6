"""Analysis of a recording: error motion values, positioning, drift, comparison, and health of the streams."""
