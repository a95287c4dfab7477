"""The command ``radarllm``."""

from __future__ import annotations

import signal
import sys

from . import _native


def main() -> None:
    """Run the command with the arguments of this process and exit with its code."""
    # Python's own handler would wait until the command ends.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native._command(["radarllm", *sys.argv[1:]]))
