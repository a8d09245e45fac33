"""`python -m opid.cli`."""

from opid.cli import main

if __name__ == "__main__":
    main()
