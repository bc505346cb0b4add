"""`python -m dipcg.cli`, for launchers that start a module."""

from dipcg.cli import main

if __name__ == "__main__":
    main()
