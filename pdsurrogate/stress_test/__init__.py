"""Hard cases and required properties, tested on every force model; failures are reported with their reasons."""
