"""The steps of `scripts/release.py`, outside the wheel."""
