"""The surgeon's side: a movement, sampled and sent."""
