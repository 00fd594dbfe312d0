"""What a model is worth on runs that neither its fit nor its choice used."""
