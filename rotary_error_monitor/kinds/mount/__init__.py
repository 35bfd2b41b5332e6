"""Two-axis mounts of telescopes: pointing files, held against the stars."""
