"""`python -m pliant`: the command line, also where its program is not on the path."""

from pliant.cli.main import main

if __name__ == "__main__":
    main()
