"""`python -m heavebond`: the command line, of the Python that is named."""

from heavebond.cli import main

if __name__ == "__main__":
    main(prog_name="heavebond")
