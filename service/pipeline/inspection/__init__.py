"""What an input is, before anything is made of it."""
