"""The rover as physics: tyres, axles, servo, sensors, road, and the variant files that describe it."""
