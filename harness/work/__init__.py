"""Work: batches through the store, runs of replicas, and where they are drawn."""
