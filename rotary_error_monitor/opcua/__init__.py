"""The cell as an OPC UA address space: names, units and quality of its values, and the server that offers them."""
