"""The command line of benchmarks that take no arguments."""

from __future__ import annotations

import argparse


def takes_no_arguments(description: str | None) -> None:
    """Answer --help with a script's docstring, and refuse any other argument."""
    argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
