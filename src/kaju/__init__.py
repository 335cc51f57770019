"""kaju: agents that carry load through a body."""

__version__ = "0.1.0"
