"""`python -m opid` is the `opid` command."""

from opid.cli import main

if __name__ == "__main__":
    main()
