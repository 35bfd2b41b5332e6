"""The live page for the person at the machine: what it says, how it is drawn, and the server that serves it."""
