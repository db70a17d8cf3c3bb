"""What a user writes down: vehicle, ground, travel, initial state and run make a Model."""
