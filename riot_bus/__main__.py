"""`python -m riot_bus` is `riot`."""

from riot_bus.cli.main import run

if __name__ == "__main__":
    run()
