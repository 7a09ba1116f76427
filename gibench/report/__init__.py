"""Tables, reports and images."""
