"""Material cards of other programs: their text for a law, and the law that a card states."""
