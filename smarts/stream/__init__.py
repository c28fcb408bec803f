"""What a browser gets: episodes and running simulations as sequences of binary messages."""
