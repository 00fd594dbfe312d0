"""The screens, one file each; every screen is drawn from the `State`."""
