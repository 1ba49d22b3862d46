"""`semap doctor`: finds what is wrong and says the remedy.

Each check looks at one thing and gives what it finds; nothing found is fine. `examination` runs them all,
each by itself: one that cannot be made says so, and the others go on. Nothing is changed anywhere.
"""
