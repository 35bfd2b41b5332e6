"""Who may speak and listen in a cell: least-privilege policies, keys, and whether security is in effect."""
