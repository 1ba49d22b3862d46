"""Of whom a piece of work is: who asks and what they may, and the id of their request."""
