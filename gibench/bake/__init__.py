"""What is computed ahead: probes, relight samples, transport, compression."""
