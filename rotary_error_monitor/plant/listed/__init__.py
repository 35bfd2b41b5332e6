"""What kinds of listed sensors see of the true stage, by exact geometry: one file a kind, with a function `seen`."""
