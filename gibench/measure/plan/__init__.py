"""What is to be measured: configurations, cameras, memory that fits, when to stop."""
