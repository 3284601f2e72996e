"""Cases of the benchmark of sites of many cameras."""
