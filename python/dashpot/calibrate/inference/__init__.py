"""What an estimate is worth: intervals, profiles, identifiability, draws."""
