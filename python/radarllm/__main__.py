"""``python -m radarllm`` is the command ``radarllm``."""

from ._command import main

if __name__ == "__main__":
    main()
