"""The screens, a file each; every one is a picture of the one `State`."""
