"""What one device does, for its owner to hand in; imports speed, training and plan."""
