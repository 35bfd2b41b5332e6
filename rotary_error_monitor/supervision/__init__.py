"""Starting a cell without launch files: the nodes that a parameter file names, and who keeps them running."""
