"""Analysis of recordings: error motion values, positioning, drift, comparison, health of the streams, trends."""
