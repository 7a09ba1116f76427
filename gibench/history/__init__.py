"""A history of runs on one or several machines: kept in DuckDB or Parquet, searched for steps."""
