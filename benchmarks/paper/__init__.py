"""The published evaluation anew: errors under noise, faults and scarcity, beside the paper's figures and other matchers.

`benchmarks/run_paper.py` writes one page of tables and plots for each part of `parts.PARTS`.
"""
