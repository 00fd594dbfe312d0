"""How well a model predicts runs that neither its fit nor its selection used."""
