"""Reports: they run the rest and tabulate."""
