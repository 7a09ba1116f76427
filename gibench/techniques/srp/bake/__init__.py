"""SRP's bake: probes, relight samples, transport, compression."""
