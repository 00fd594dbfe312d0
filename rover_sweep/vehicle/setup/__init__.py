"""A rover brought to what identification needs: applet, parameters, reboots."""
