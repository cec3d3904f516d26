"""From a robot description to exact dynamics, fast code and identified parameters."""

__all__ = ["__version__"]

__version__ = "0.1.0"
