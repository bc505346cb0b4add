"""What every plugin promises, checked for whatever the registry finds."""
