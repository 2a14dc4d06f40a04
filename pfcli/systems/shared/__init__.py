"""What systems share: their contract, and the parts that several of them are made of."""
