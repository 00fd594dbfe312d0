"""What a screen is fed from and asks: a vehicle while it is driven, or a recording that is played."""
