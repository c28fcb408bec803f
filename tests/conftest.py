"""What all tests share; lies here so that `games` can be imported from anywhere below."""
