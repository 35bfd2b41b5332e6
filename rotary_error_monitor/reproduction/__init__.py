"""The procedures of the papers, on simulations with the papers' own numbers, through the commands that users have."""
