"""Speed and error of every force model, measured and tabulated."""
