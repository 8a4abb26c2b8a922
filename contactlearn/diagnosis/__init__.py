"""From measurements and a contact model to a named missing effect, or an honest "cannot be told"."""
