"""Commands with a module of their own; `passerby.cli` registers them."""
