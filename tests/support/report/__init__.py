"""Pages and drawings of the report, taken apart."""
