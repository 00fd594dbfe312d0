"""A manoeuvre before it is driven: its demands on servo, tyres, space and sampling rates, and advice."""
