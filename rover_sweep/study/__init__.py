"""The paper's comparison of three model structures, repeated on a virtual rover."""
