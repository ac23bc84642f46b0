"""``python -m edvo``: what ``edvo`` does, where its script is not on the path."""

from edvo.cli import main

if __name__ == "__main__":
    main()
