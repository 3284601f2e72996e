"""The evidence: `passerby benchmark` measures every claim anew and writes it down as pages of tables and plots."""
