"""How fast every stage is, beside other libraries and the machine's limits."""
