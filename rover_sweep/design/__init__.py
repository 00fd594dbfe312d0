"""A manoeuvre on paper: what it demands of servo, tyres, space and clocks, and advice before it is driven."""
