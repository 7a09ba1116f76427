"""gibench: a benchmark suite for real-time diffuse global illumination in OpenCL."""

__version__ = "0.1.0"
