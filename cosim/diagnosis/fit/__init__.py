"""What a plant predicts for given recordings, how it may err, and one supposition fitted to them."""
