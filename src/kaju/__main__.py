"""Lets `python -m kaju` do what the command `kaju` does."""

from kaju.cli import main

if __name__ == "__main__":
    main()
