"""Pages of results: how figures become Markdown, how a page keeps the parts that are not run, and what a stopped run keeps."""
