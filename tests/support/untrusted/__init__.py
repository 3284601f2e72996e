"""Sound examples of every file that is read, and what harms them."""
