"""Hard cases, put to every force model: where each stands, and where and why it does not."""
