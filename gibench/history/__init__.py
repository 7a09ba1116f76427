"""A history of runs: kept in DuckDB or Parquet, searched for steps, shared in single files."""
