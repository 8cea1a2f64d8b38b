"""``python -m mr_damper`` is the command ``mr-damper``."""

from mr_damper._cli import main

if __name__ == "__main__":
    main()
