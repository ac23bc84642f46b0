"""What each command takes; what it does is in the module of the same name one folder up."""
