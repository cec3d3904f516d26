"""`python -m symid`: the command line."""

from symid.cli.main import main

__all__: tuple[str, ...] = ()

if __name__ == "__main__":
    main()
