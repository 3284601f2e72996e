"""Small generated examples of published data sets, in their own layouts."""
