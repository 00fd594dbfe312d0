"""The source of a screen's data and answers: a driven vehicle, or a played recording."""
