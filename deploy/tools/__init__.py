"""Commands on scenarios, recordings and run folders, without a run."""
