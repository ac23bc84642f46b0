"""Speed and scale of edvo, measured beside its peers in the same run."""
